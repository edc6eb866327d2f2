"""Packs many arrays into two, because passing an array to a compiled function costs as much as testing a line
against the walls. Inside, the parts are views of the two arrays and cost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.system.kernels import kernel


class Packed(NamedTuple):
    """`longs` begins with a table of (first, length) of each part: the parts of `floats`, then its own."""

    longs: Longs
    floats: Floats


def pack(floats: Sequence[Any], longs: Sequence[Any]) -> Packed:
    """Pack arrays of any shape. Parts are numbered from 0, those of `floats` first."""
    head = 2 * (len(floats) + len(longs))
    flat = [np.asarray(part, np.int64).ravel() for part in longs]
    table = [_table(floats, 0), _table(flat, head)]
    return Packed(
        np.concatenate([*table, *flat]).astype(np.int64),
        np.concatenate([np.empty(0), *(np.asarray(part, float).ravel() for part in floats)]),
    )


def _table(parts: Sequence[Any], first: int) -> Longs:
    lengths = np.array([part.size for part in parts], np.int64)
    return np.column_stack([first + np.cumsum(lengths) - lengths, lengths]).ravel()


@kernel
def rows(packed: Packed, part: int, columns: int) -> Floats:
    """A part of `floats` as an array with this number of columns."""
    first, length = packed.longs[2 * part], packed.longs[2 * part + 1]
    return packed.floats[first : first + length].reshape(length // columns if columns else 0, columns)


@kernel
def numbers(packed: Packed, part: int) -> Longs:
    """A part of `longs`."""
    first, length = packed.longs[2 * part], packed.longs[2 * part + 1]
    return packed.longs[first : first + length]

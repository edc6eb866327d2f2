"""Packs many arrays into two, because passing an array to a compiled function costs as much as testing a line
against the walls. Inside, the parts are views of the two arrays and cost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs


class Packed(NamedTuple):
    """`longs` begins with bounds: the parts of `floats` are floats[longs[0]:longs[1]], floats[longs[1]:longs[2]] and so
    on, then those of `longs` likewise."""

    longs: Longs
    floats: Floats


def pack(floats: Sequence[Any], longs: Sequence[Any]) -> Packed:
    """Pack arrays of any shape."""
    head = len(floats) + len(longs) + 2
    bounds = [_bounds(floats, 0), _bounds(longs, head)]
    return Packed(
        np.concatenate([*bounds, *(np.asarray(part).ravel() for part in longs)]).astype(np.int64),
        np.concatenate([np.empty(0), *(np.asarray(part, float).ravel() for part in floats)]),
    )


def _bounds(parts: Sequence[Any], first: int) -> Longs:
    return first + np.cumsum([0, *(np.size(part) for part in parts)], dtype=np.int64)

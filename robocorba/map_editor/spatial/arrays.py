"""Types of arrays that many modules name, and connected parts; this module imports nothing else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


def connected_parts(one: Longs, other: Longs, size: int) -> Longs:
    """The part (size,) of each of `size` nodes, where links (n,) from `one` to `other` connect them in both directions.
    Parts are numbered by their first nodes."""
    first = np.arange(size)  # of the part of each node, as far as it is known
    while len(apart := np.flatnonzero(first[one] != first[other])):
        a, b = first[one[apart]], first[other[apart]]
        np.minimum.at(first, np.maximum(a, b), np.minimum(a, b))
        while (first != first[first]).any():
            first = first[first]
    return np.unique(first, return_inverse=True)[1].reshape(-1)

"""Points along the obstacles for the Voronoi diagram: as dense as passages are narrow, so that their number follows the
content of a floor and not its size."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.grids import segments_of
from robocorba.map_editor.topology.roadmap import Array

#: Maximum distance of neighbouring sites on an obstacle, as a share of the distance d to the nearest other obstacle. No
#: point is farther than 0.1 d from a site then, which is 0.2 of its distance d / 2 to the medial axis. Below 0.252 the
#: Voronoi diagram of samples keeps the connections of smooth curves (Amenta, Bern and Eppstein, The crust and the
#: beta-skeleton, 1998).
SPACING_SHARE = 0.2


def sites_of(outlines: Sequence[BaseGeometry], radius_m: float) -> tuple[Array, csr_array]:
    """Sites (n, 2) [m] along the straight sides of obstacles, and which of them lie on which side (n, sides)."""
    segments = segments_of(np.array(outlines, object))[0]
    segments = segments[np.hypot(*(segments[:, 2:] - segments[:, :2]).T) > 0.0]
    pieces, of = _pieces(segments, radius_m)
    ends = np.round(pieces.reshape(-1, 2), 7)  # sites that agree to 0.1 µm are one
    sites, number = np.unique(ends, axis=0, return_inverse=True)
    member = np.unique(np.column_stack([number.reshape(-1), np.repeat(of, 2)]), axis=0)
    on = csr_array((np.ones(len(member), np.int32), member.T), (len(sites), max(len(segments), 1)))
    return sites, on


def _pieces(segments: Array, radius_m: float) -> tuple[Array, NDArray[np.int64]]:
    """The segments (n, 4) in pieces (m, 4) between neighbouring sites, and the segment of each piece.

    Long pieces are halved until no other segment is near: each length is tested against points on all segments whose
    spacing is the half of it."""
    lengths = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    # A passage for the robot is two radii wide, so 0.4 radii are SPACING_SHARE of the narrowest one. Longer, if there
    # would be more than about 200,000 sites.
    shortest = max(0.4 * radius_m, float(lengths.sum()) / 200_000)
    # Four to eight pieces each at first, so that the last halves are hardly shorter than necessary.
    halvings = np.maximum(np.floor(np.log2(lengths / shortest)) - 2, 0)
    parts = np.maximum(np.ceil(lengths / (shortest * 2**halvings) - 1e-9), 1).astype(np.int64)
    of = np.repeat(np.arange(len(segments)), parts)
    todo = np.hstack([_along(segments, parts, of, 0), _along(segments, parts, of, 1)])
    done, done_of = [np.empty((0, 4))], [np.empty(0, np.int64)]
    while len(todo):
        length = np.hypot(*(todo[:, 2:] - todo[:, :2]).T)
        longest = float(length.max())
        is_short = length <= shortest * (1 + 1e-9)
        is_next = ~is_short & (length > longest / 2)
        splits = np.zeros(len(todo), bool)
        if is_next.any():
            splits[is_next] = _is_near_others(todo[is_next], of[is_next], segments, longest / 2)
        stays = is_short | (is_next & ~splits)
        done.append(todo[stays])
        done_of.append(of[stays])
        halves, half_of = todo[splits], np.repeat(of[splits], 2)
        middle = (halves[:, :2] + halves[:, 2:]) / 2
        halves = np.stack([np.hstack([halves[:, :2], middle]), np.hstack([middle, halves[:, 2:]])], 1).reshape(-1, 4)
        rest = ~stays & ~splits
        todo, of = np.concatenate([todo[rest], halves]), np.concatenate([of[rest], half_of])
    return np.concatenate(done), np.concatenate(done_of)


def _is_near_others(pieces: Array, of: NDArray[np.int64], segments: Array, spacing_m: float) -> NDArray[np.bool_]:
    """Whether another segment is so near to each piece, up to twice `spacing_m` long, that it must be halved."""
    lengths = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    parts = np.maximum(np.ceil(lengths / spacing_m), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(segments)), parts + 1)
    points = _along(segments, parts, owner, 0)
    length = np.hypot(*(pieces[:, 2:] - pieces[:, :2]).T)
    reach = length / SPACING_SHARE + spacing_m / 2
    # On its own segment are at most this many points within the largest reach: one more is another's.
    own = math.ceil(2 * float(reach.max()) / spacing_m) + 2
    count = min(own + 1, len(points))
    middle = (pieces[:, :2] + pieces[:, 2:]) / 2
    apart, found = cKDTree(points).query(middle, k=[*range(1, count + 1)], distance_upper_bound=float(reach.max()))
    is_other = (apart <= reach[:, None]) & (owner[np.minimum(found, len(owner) - 1)] != of[:, None])
    return is_other.any(axis=1)


def _along(segments: Array, parts: NDArray[np.int64], owner: NDArray[np.int64], first: int) -> Array:
    """Points (n, 2) that divide the segments into so many equal parts, one after the other from number `first` on;
    `owner` (n,) is the segment of each."""
    step = first + np.arange(len(owner)) - np.searchsorted(owner, owner)
    share = (step / parts[owner])[:, None]
    points: Array = segments[owner, :2] * (1 - share) + segments[owner, 2:] * share
    return points

"""A body among the obstacles of a floor: how near is it to them at a pose, may it go from one pose to another?

A body is any shape in its own frame, seen as capsules: lines with a radius. Its border is made of lines without one.
Distances are exact. On the way from pose to pose it goes straight and turns evenly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from shapely import Polygon

from robocorba.kernels import kernel
from robocorba.planning.space import line_clearance
from robocorba.spatial.grids import Floats, Grid, segments_of

#: Looked at on the way are poses between which no point of the body moves farther than this, m: nowhere in between is
#: it nearer to anything by more than half of that.
STEP_M = 0.01
#: A regular polygon with at least so many sides counts as the circle around it.
ROUND_SIDES = 16
#: Poses that are looked at on one way at most are those of this many halvings.
_DEPTH = 24


class Body(NamedTuple):
    """capsules (n, 5): a line's x, y, x, y in the body's frame and its radius, m; reach: of the farthest point, m."""

    capsules: Floats
    reach: float


def body_of(outline: Polygon, rounded: list[tuple[float, float, float, float, float]]) -> Body:
    """A polygon with capsules beside it."""
    lines = segments_of(np.array([outline], object))[0]
    from_origin = np.hypot(lines[:, 0], lines[:, 1])
    if len(lines) >= ROUND_SIDES and np.ptp(from_origin) < 1e-3:
        lines = np.empty((0, 4))  # a circle
        rounded = [*rounded, (0.0, 0.0, 0.0, 0.0, float(from_origin.max()))]
    edges = np.hstack([lines, np.zeros((len(lines), 1))])
    capsules = np.vstack([np.array(rounded, float).reshape(-1, 5), edges])
    ends = np.hypot(capsules[:, 0:4:2], capsules[:, 1:4:2]).max(axis=1)
    return Body(capsules, float((ends + capsules[:, 4]).max()))


@kernel
def body_clearance(grid: Grid, capsules: Floats, x: float, y: float, heading: float, most: float) -> float:
    """How far a body is from the nearest obstacle, m; `most` where that is farther, 0 or less where they meet.

    A body that encloses an obstacle without touching it does not see it: none gets there without touching it."""
    cos, sin = math.cos(heading), math.sin(heading)
    best = most
    for i in range(capsules.shape[0]):
        ax, ay, bx, by, radius = capsules[i]
        distance, nearest = line_clearance(
            grid,
            x + cos * ax - sin * ay,
            y + sin * ax + cos * ay,
            x + cos * bx - sin * by,
            y + sin * bx + cos * by,
            best + radius,
        )
        if nearest >= 0:
            best = distance - radius
            if best <= 0.0:
                return best
    return best


@kernel
def body_passes(
    grid: Grid, capsules: Floats, reach: float, a: Floats, b: Floats, at_a: float, at_b: float, margin: float
) -> bool:
    """Whether a body keeps `margin` on its way from pose a to b (x, y, heading), where it has these clearances, m."""
    if at_a < margin or at_b < margin:
        return False
    moves = math.hypot(b[0] - a[0], b[1] - a[1]) + reach * abs(b[2] - a[2])
    begins, ends = np.empty(_DEPTH), np.empty(_DEPTH)
    near_begin, near_end = np.empty(_DEPTH), np.empty(_DEPTH)
    begins[0], ends[0], near_begin[0], near_end[0] = 0.0, 1.0, at_a, at_b
    most = max(2.0 * margin, moves)
    depth = 1
    while depth:
        depth -= 1
        begin, end, first, last = begins[depth], ends[depth], near_begin[depth], near_end[depth]
        # Each end is so far from everything that this part of the way stays clear, or short enough.
        if first + last - 2.0 * margin >= moves * (end - begin) or moves * (end - begin) <= STEP_M:
            continue
        if depth + 2 > _DEPTH:
            return False
        t = 0.5 * (begin + end)
        middle = body_clearance(
            grid,
            capsules,
            a[0] + t * (b[0] - a[0]),
            a[1] + t * (b[1] - a[1]),
            a[2] + t * (b[2] - a[2]),
            min(most, margin + moves * (end - begin)),
        )
        if middle < margin:
            return False
        begins[depth], ends[depth], near_begin[depth], near_end[depth] = t, end, middle, last
        begins[depth + 1], ends[depth + 1], near_begin[depth + 1], near_end[depth + 1] = begin, t, first, middle
        depth += 2
    return True

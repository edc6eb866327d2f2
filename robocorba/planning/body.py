"""Clearance of a rigid body among the obstacles of a floor, and whether the body can move from one pose to another.

A body is a set of capsules in its own frame: line segments with a radius. The sides of its outline are capsules of
radius 0. Distances are exact. Between two poses the body moves straight and turns at a constant rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from shapely import Polygon

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.grids import Grid, segments_of
from robocorba.planning.space import line_clearance
from robocorba.system.kernels import inner_kernel, kernel

#: Poses are tested until no point of the body moves farther than this between two of them [m]. In between, the
#: clearance is smaller by at most half of it.
STEP_M = 0.01


class CapsuleBody(NamedTuple):
    """capsules (n, 5): x, y, x, y of a line segment in the body's frame and its radius [m]; reach: distance of the
    farthest point from the origin [m]."""

    capsules: Floats
    reach: float


def body_of(outline: Polygon, rounded: list[tuple[float, float, float, float, float]]) -> CapsuleBody:
    """The body with this outline [m] and further capsules `rounded` (x, y, x, y, radius in m)."""
    lines = segments_of(np.array([outline], object))[0]
    from_origin = np.hypot(lines[:, 0], lines[:, 1])
    if len(lines) >= 16 and np.ptp(from_origin) < 1e-3:  # a regular polygon becomes its circumscribed circle
        lines = np.empty((0, 4))
        rounded = [*rounded, (0.0, 0.0, 0.0, 0.0, float(from_origin.max()))]
    edges = np.hstack([lines, np.zeros((len(lines), 1))])
    capsules = np.vstack([np.array(rounded, float).reshape(-1, 5), edges])
    ends = np.hypot(capsules[:, 0:4:2], capsules[:, 1:4:2]).max(axis=1)
    return CapsuleBody(capsules, float((ends + capsules[:, 4]).max()))


@inner_kernel
def body_clearance(grid: Grid, body: CapsuleBody, x: float, y: float, heading: float, cap: float) -> float:
    """Distance from a body at a pose [m, rad] to the nearest obstacle [m], at most `cap`; 0 or less where they overlap.

    An obstacle that the body encloses without touching it is not detected; no motion leads there without a
    collision."""
    cos, sin = math.cos(heading), math.sin(heading)
    best = cap
    for i in range(body.capsules.shape[0]):
        ax, ay, bx, by, radius = body.capsules[i]
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
    grid: Grid, body: CapsuleBody, a: Floats, b: Floats, clear_a: float, clear_b: float, margin: float
) -> bool:
    """Whether a body keeps `margin` [m] on the motion between poses a and b (x, y, heading), at which it has these
    clearances [m]."""
    if clear_a < margin or clear_b < margin:
        return False
    travel_m = math.hypot(b[0] - a[0], b[1] - a[1]) + body.reach * abs(b[2] - a[2])
    max_depth = 24  # of halvings: 80 km down to STEP_M
    begins, ends = np.empty(max_depth), np.empty(max_depth)
    clear_begin, clear_end = np.empty(max_depth), np.empty(max_depth)
    begins[0], ends[0], clear_begin[0], clear_end[0] = 0.0, 1.0, clear_a, clear_b
    cap = max(2.0 * margin, travel_m)
    depth = 1
    while depth:
        depth -= 1
        begin, end, first, last = begins[depth], ends[depth], clear_begin[depth], clear_end[depth]
        # The clearances at both ends cover this part of the motion, or it is short enough.
        if first + last - 2.0 * margin >= travel_m * (end - begin) or travel_m * (end - begin) <= STEP_M:
            continue
        if depth + 2 > max_depth:
            return False
        t = 0.5 * (begin + end)
        middle = body_clearance(
            grid,
            body,
            a[0] + t * (b[0] - a[0]),
            a[1] + t * (b[1] - a[1]),
            a[2] + t * (b[2] - a[2]),
            min(cap, margin + travel_m * (end - begin)),
        )
        if middle < margin:
            return False
        begins[depth], ends[depth], clear_begin[depth], clear_end[depth] = t, end, middle, last
        begins[depth + 1], ends[depth + 1] = begin, t
        clear_begin[depth + 1], clear_end[depth + 1] = first, middle
        depth += 2
    return True

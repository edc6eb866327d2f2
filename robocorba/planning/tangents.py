"""Circles around vertices, and the lines that touch them: the parts of shortest paths of a round robot.

The centre of a robot that turns at vertex v moves on a circle around v. A *turn* is +1 counter-clockwise (v on its
left) and -1 clockwise. Points on the circle are angles from `low[v]`, where the walls that meet in v begin to leave
room: the arc of v. At heading h the robot is at the angle h - turn * pi / 2, in the direction of turn * (sin h, -cos
h).
"""

from __future__ import annotations

import math

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.grids import Grid, column_of, row_of
from robocorba.planning.floor_mesh import SAME_RAD
from robocorba.planning.segments import point_segment_distance2
from robocorba.planning.space import line_free
from robocorba.system.kernels import inner_kernel

#: Angle for each of the outer tangent lines that replace an arc [rad]: the path is at most 0.33 % longer.
SIDE_RAD = math.pi / 16


@inner_kernel
def free_arc(
    grid: Grid, x: float, y: float, low: float, span: float, radius: float, same_m: float
) -> tuple[float, float, bool]:
    """The part of a vertex's arc that no end of another wall blocks, as angles from `low` (the second below the
    first if nothing is left), and whether no other obstacle is near enough to block a part of it."""
    segments, start, items, frame = grid
    near = 2.0 * radius
    reach = near * 1.01 + same_m
    first, last, alone = 0.0, span, True
    columns = int(frame[3])
    for _ in range(8):
        moved = False
        for row in range(row_of(frame, y - reach), row_of(frame, y + reach) + 1):
            for column in range(column_of(frame, x - reach), column_of(frame, x + reach) + 1):
                cell = row * columns + column
                for i in range(start[cell], start[cell + 1]):
                    ax, ay, bx, by = segments[items[i]]
                    far_a, far_b = math.hypot(ax - x, ay - y), math.hypot(bx - x, by - y)
                    if far_a > same_m and far_b > same_m and alone:
                        alone = point_segment_distance2(x, y, ax, ay, bx, by) > reach * reach
                    for end in range(2):
                        ex, ey, far = (ax, ay, far_a) if end == 0 else (bx, by, far_b)
                        if far <= same_m or far >= near:
                            continue
                        wide = math.acos(far / near) - SAME_RAD
                        middle = (math.atan2(ey - y, ex - x) - low) % (2 * math.pi)
                        for turn in range(-1, 2):
                            left = middle - wide + turn * 2 * math.pi
                            right = middle + wide + turn * 2 * math.pi
                            if left < first < right:
                                first, moved = right, True
                            if left < last < right:
                                last, moved = left, True
        if not moved or last < first:
            break
    return first, last, alone


@inner_kernel
def tangent(dx: float, dy: float, radius: float, turn_here: int, turn_there: int) -> tuple[float, float, float]:
    """Heading as a unit vector, and length [m], of the line that leaves this circle with one turn and touches the
    circle (dx, dy) away with another; a turn of 0 is a point. The length is negative if there is no such line."""
    apart = math.hypot(dx, dy)
    if apart == 0.0:
        return 0.0, 0.0, -1.0
    sine = (turn_here - turn_there) * radius / apart
    if abs(sine) > 1.0:
        if abs(sine) * apart > apart + 1e-9:
            return 0.0, 0.0, -1.0
        sine = math.copysign(1.0, sine)
    cosine = math.sqrt(1.0 - sine * sine)
    ux, uy = dx / apart, dy / apart
    return ux * cosine - uy * sine, ux * sine + uy * cosine, apart * cosine


@inner_kernel
def arc_corners(
    x: float, y: float, radius: float, begin: float, end: float, corners: Floats, count: int, write: bool
) -> int:
    """Append to the first `count` corners those of the outer tangent lines that replace an arc around (x, y) from one
    angle to another [rad]; without `write` only count them. Returns the new number of corners."""
    turned = end - begin
    if abs(turned) < 1e-12:
        return count
    sides = math.ceil(abs(turned) / SIDE_RAD)
    step = turned / sides
    far = radius / math.cos(step / 2)
    if write:
        for i in range(sides):
            angle = begin + (i + 0.5) * step
            corners[count + i, 0], corners[count + i, 1] = x + far * math.cos(angle), y + far * math.sin(angle)
    return count + sides


@inner_kernel
def arc_is_free(grid: Grid, x: float, y: float, turn_radius: float, begin: float, end: float, radius: float) -> bool:
    """Whether a robot of `radius` can drive the lines of `arc_corners` and those that lead to and from them."""
    turned = end - begin
    if abs(turned) < 1e-12:
        return True
    sides = math.ceil(abs(turned) / SIDE_RAD)
    step = turned / sides
    far = turn_radius / math.cos(step / 2)
    ax, ay = x + turn_radius * math.cos(begin), y + turn_radius * math.sin(begin)
    for i in range(sides + 1):
        if i < sides:
            angle, away = begin + (i + 0.5) * step, far
        else:
            angle, away = end, turn_radius
        bx, by = x + away * math.cos(angle), y + away * math.sin(angle)
        if not line_free(grid, ax, ay, bx, by, radius):
            return False
        ax, ay = bx, by
    return True

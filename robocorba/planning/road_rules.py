"""The rules of path edges for drives beside the topological map: direction, clearance, navigation graph, speed limit.

A drive follows an edge where it is nearer to it than the robot's radius for more than the robot's diameter. Edges that
have a rule are `lanes` (n, LANE_COLUMNS), one for each two nodes: the ends [m], the largest radius of a robot that may
follow it from the first end to the second and back (inf: any, NOBODY: none), the speed limits in these two directions
[m/s] (inf: none), and 1 if a drive that the edge is closed for must not cross it either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.model import PathEdge
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.space import TOUCH_M
from robocorba.system.kernels import inner_kernel, kernel

#: Columns of lanes after the ends; those of the direction back follow those of the direction there.
WIDEST, SPEED, CROSSING, LANE_COLUMNS = 4, 6, 8, 9
#: The largest radius that may follow an edge that is closed.
NOBODY = -1.0
NO_LANES: Floats = np.empty((0, LANE_COLUMNS))


class RoadRules(NamedTuple):
    """The lanes of all floors, those of floor f are lanes[first[f]:first[f + 1]]."""

    lanes: Floats
    first: Longs


def road_rules(lanes: Sequence[Floats]) -> RoadRules:
    """The lanes of the floors in floor order."""
    first = np.cumsum([0, *map(len, lanes)], dtype=np.int64)
    return RoadRules(np.concatenate([NO_LANES, *lanes]), first)


def make_lanes(edges: list[PathEdge], ends: Longs, xy: Floats, graph: str = "") -> Floats:
    """The lanes of a floor's edges between nodes `ends` (n, 2) at `xy` [m], for a navigation graph ("": all edges)."""
    if not any(edge.one_way or edge.clearance or edge.speed_limit or (graph and edge.graphs) for edge in edges):
        return NO_LANES
    is_open = np.array([not graph or not edge.graphs or graph in edge.graphs for edge in edges], bool)
    one_way = np.array([edge.one_way for edge in edges], bool)
    widest = np.where(is_open, [edge.clearance or math.inf for edge in edges], NOBODY)
    speed = np.where(is_open, [edge.speed_limit or math.inf for edge in edges], 0.0)
    low, high = ends.min(axis=1), ends.max(axis=1)
    is_back = ends[:, 0] > ends[:, 1]
    pairs, number = np.unique(low * len(xy) + high, return_inverse=True)
    number = number.reshape(-1)
    lanes = np.zeros((len(pairs), LANE_COLUMNS))
    lanes[:, :2], lanes[:, 2:4] = xy[pairs // len(xy)], xy[pairs % len(xy)]
    lanes[:, WIDEST : WIDEST + 2] = NOBODY
    for direction, runs in ((0, ~one_way | ~is_back), (1, ~one_way | is_back)):
        np.maximum.at(lanes[:, WIDEST + direction], number[runs], widest[runs])
        np.maximum.at(lanes[:, SPEED + direction], number[runs], speed[runs])
    closed = lanes[:, SPEED : SPEED + 2] == 0.0
    lanes[:, SPEED : SPEED + 2][closed] = math.inf
    has_rule = np.isfinite(lanes[:, WIDEST : SPEED + 2]).any(axis=1)
    return lanes[has_rule & (np.hypot(*(lanes[:, 2:4] - lanes[:, :2]).T) > 0.0)]


@kernel
def lanes_on(rules: RoadRules, floor: int) -> Floats:
    """The lanes of a floor."""
    return rules.lanes[rules.first[floor] : rules.first[floor + 1]]


@kernel
def followed(
    lanes: Floats, i: int, ax: float, ay: float, bx: float, by: float, radius: float
) -> tuple[float, float, int]:
    """The shares of the drive from a to b between which it follows lane i, and the direction: 0 from the lane's first
    end to the second, 1 back. Equal shares if it does not follow it."""
    px, py, qx, qy = lanes[i, 0], lanes[i, 1], lanes[i, 2], lanes[i, 3]
    if (
        max(ax, bx) + radius < min(px, qx)
        or min(ax, bx) - radius > max(px, qx)
        or max(ay, by) + radius < min(py, qy)
        or min(ay, by) - radius > max(py, qy)
    ):
        return 0.0, 0.0, 0  # most lanes are elsewhere
    length = math.hypot(qx - px, qy - py)
    ux, uy = (qx - px) / length, (qy - py) / length
    along_a, along_b = (ax - px) * ux + (ay - py) * uy, (bx - px) * ux + (by - py) * uy
    direction = 0 if along_b >= along_a else 1
    if abs(along_b - along_a) <= 2.0 * radius + TOUCH_M:
        return 0.0, 0.0, direction
    beside_a, beside_b = (ay - py) * ux - (ax - px) * uy, (by - py) * ux - (bx - px) * uy
    reach = max(radius - TOUCH_M, 0.0)
    first, last = 0.0, 1.0
    for at_a, at_b, low, high in ((along_a, along_b, 0.0, length), (beside_a, beside_b, -reach, reach)):
        step = at_b - at_a
        if step == 0.0:
            if at_a < low or at_a > high:
                return 0.0, 0.0, direction
            continue
        enter, leave = (low - at_a) / step, (high - at_a) / step
        first, last = max(first, min(enter, leave)), min(last, max(enter, leave))
    if (last - first) * abs(along_b - along_a) > 2.0 * radius + TOUCH_M:
        return first, last, direction
    return 0.0, 0.0, direction


@kernel
def is_closed(lanes: Floats, i: int, direction: int, radius: float) -> bool:
    """Whether a robot of this radius [m] must not follow lane i in a direction."""
    return radius > lanes[i, WIDEST + direction] + TOUCH_M


@kernel
def breaks_rule(lanes: Floats, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Whether the drive from a to b follows a lane that is closed in its direction, or crosses one that it must not."""
    for i in range(lanes.shape[0]):
        there, back = is_closed(lanes, i, 0, radius), is_closed(lanes, i, 1, radius)
        if not there and not back:
            continue
        if there and back and lanes[i, CROSSING] > 0.0 and _crosses(lanes, i, ax, ay, bx, by):
            return True
        first, last, direction = followed(lanes, i, ax, ay, bx, by, radius)
        if last > first and is_closed(lanes, i, direction, radius):
            return True
    return False


@kernel
def path_breaks_rule(lanes: Floats, points: Floats, radius: float) -> bool:
    """Whether a drive along points (k, 2) breaks a rule; points in a straight line count as one drive."""
    begin = 0
    for k in range(1, points.shape[0]):
        if k + 1 < points.shape[0]:
            ax, ay = points[k, 0] - points[begin, 0], points[k, 1] - points[begin, 1]
            bx, by = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
            if (
                abs(ax * by - ay * bx) <= TOUCH_M * (math.hypot(ax, ay) + math.hypot(bx, by))
                and ax * bx + ay * by >= 0.0
            ):
                continue
        if breaks_rule(lanes, points[begin, 0], points[begin, 1], points[k, 0], points[k, 1], radius):
            return True
        begin = k
    return False


@inner_kernel
def _crosses(lanes: Floats, i: int, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether the line ab crosses lane i; to end on it is not to cross it."""
    px, py, qx, qy = lanes[i, 0], lanes[i, 1], lanes[i, 2], lanes[i, 3]
    length = math.hypot(qx - px, qy - py)
    ux, uy = (qx - px) / length, (qy - py) / length
    beside_a, beside_b = (ay - py) * ux - (ax - px) * uy, (by - py) * ux - (bx - px) * uy
    if min(abs(beside_a), abs(beside_b)) <= TOUCH_M or (beside_a > 0.0) == (beside_b > 0.0):
        return False
    share = beside_a / (beside_a - beside_b)
    along = (ax + share * (bx - ax) - px) * ux + (ay + share * (by - ay) - py) * uy
    return TOUCH_M < along < length - TOUCH_M


@kernel
def tie_lanes(lanes: Floats, x: float, y: float, radius: float) -> Floats:
    """The lanes for drives that connect a place to the roadmap: they must not cross closed lanes either, except those
    on which a robot at the place stands."""
    found, is_copy = lanes, False
    for i in range(lanes.shape[0]):
        if not (is_closed(lanes, i, 0, radius) and is_closed(lanes, i, 1, radius)):
            continue
        px, py, qx, qy = lanes[i, 0], lanes[i, 1], lanes[i, 2], lanes[i, 3]
        dx, dy = qx - px, qy - py
        share = min(max(((x - px) * dx + (y - py) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        if math.hypot(px + share * dx - x, py + share * dy - y) > radius:
            if not is_copy:
                found, is_copy = lanes.copy(), True
            found[i, CROSSING] = 1.0
    return found


@inner_kernel
def is_slowed(lanes: Floats, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Whether the drive from a to b follows a lane that has a speed limit in its direction."""
    for i in range(lanes.shape[0]):
        if lanes[i, SPEED] < np.inf or lanes[i, SPEED + 1] < np.inf:
            first, last, direction = followed(lanes, i, ax, ay, bx, by, radius)
            if last > first and lanes[i, SPEED + direction] < np.inf:
                return True
    return False


@inner_kernel
def limits_along(lanes: Floats, ax: float, ay: float, bx: float, by: float, radius: float) -> tuple[Floats, Floats]:
    """The drive from a to b in parts with the same speed limit: the shares at which they end, and the limits [m/s]."""
    count = 0
    spans = np.empty((lanes.shape[0], 3))
    for i in range(lanes.shape[0]):
        if lanes[i, SPEED] < np.inf or lanes[i, SPEED + 1] < np.inf:
            first, last, direction = followed(lanes, i, ax, ay, bx, by, radius)
            if last > first and lanes[i, SPEED + direction] < np.inf:
                spans[count, 0], spans[count, 1], spans[count, 2] = first, last, lanes[i, SPEED + direction]
                count += 1
    marks = np.ones(2 * count + 1)  # sorted while they are few: numba's sort compiles for longer than all of this
    for i in range(2 * count):
        mark, at = spans[i // 2, i % 2], i
        while at > 0 and marks[at - 1] > mark:
            marks[at] = marks[at - 1]
            at -= 1
        marks[at] = mark
    ends, limits = np.empty(marks.shape[0]), np.empty(marks.shape[0])
    size, before = 0, 0.0
    for mark in marks:
        if mark <= before + TOUCH_M:
            continue
        limit = np.inf
        for i in range(count):
            if spans[i, 0] <= (before + mark) / 2.0 <= spans[i, 1]:
                limit = min(limit, spans[i, 2])
        if size and limits[size - 1] == limit:
            size -= 1
        ends[size], limits[size] = mark, limit
        size += 1
        before = mark
    return ends[:size], limits[:size]


@kernel
def slowed_length(lanes: Floats, points: Floats, radius: float, speed: float) -> float:
    """The length [m] that a robot would drive at `speed` [m/s] in the time that it takes along points (k, 2)."""
    total = 0.0
    for k in range(points.shape[0] - 1):
        ax, ay = points[k]
        bx, by = points[k + 1]
        length = math.hypot(bx - ax, by - ay)
        if not is_slowed(lanes, ax, ay, bx, by, radius):
            total += length
            continue
        ends, limits = limits_along(lanes, ax, ay, bx, by, radius)
        before = 0.0
        for i in range(ends.shape[0]):
            total += (ends[i] - before) * length * speed / min(speed, limits[i])
            before = ends[i]
    return total


def closing_walls(lanes: Floats, radius_m: float, places: list[XY]) -> list[tuple[XY, XY]]:
    """Walls along the lanes that are closed in a direction for this radius [m], with gaps for robots at `places`."""
    found: list[tuple[XY, XY]] = []
    for i, lane in enumerate(lanes.tolist()):
        if not (is_closed(lanes, i, 0, radius_m) or is_closed(lanes, i, 1, radius_m)):
            continue
        (px, py), (qx, qy) = lane[:2], lane[2:4]
        length = math.hypot(qx - px, qy - py)
        ux, uy = (qx - px) / length, (qy - py) / length
        parts = [(0.0, length)]
        for x, y in places:
            along, beside = (x - px) * ux + (y - py) * uy, (y - py) * ux - (x - px) * uy
            if abs(beside) < radius_m:
                half = math.sqrt(radius_m**2 - beside**2)
                gap = along - half, along + half
                parts = [cut for low, high in parts for cut in ((low, min(high, gap[0])), (max(low, gap[1]), high))]
        found += [
            ((px + low * ux, py + low * uy), (px + high * ux, py + high * uy)) for low, high in parts if high > low
        ]
    return found

"""A* over circles around vertices and the lines that touch them; tangent_graph.py explains the idea.

The search finds the lines from a vertex when it first reaches it, and keeps them. It tests whether a line is free
when it takes the line, which it does for few of them, and keeps the result.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.planning.dead_ends import DeadEnds, stamp_exit_route
from robocorba.planning.road_rules import breaks_rule
from robocorba.planning.space import line_free
from robocorba.planning.tangents import SAME_RAD, arc_corners, arc_is_free, free_arc, tangent
from robocorba.planning.triangulation import Mesh, doubled
from robocorba.planning.visible_region import Scratch, seen_from
from robocorba.system.kernels import inner_kernel, kernel

#: Statuses of a search.
DONE, NO_ROOM, NO_BUDGET = range(3)
#: States of an arc and of a line.
UNKNOWN, FREE, BLOCKED = range(3)
#: Number of goals beyond which the search uses no heuristic.
MAX_AIMED_GOALS = 8
#: Angles [rad] and lengths [m] that differ by less are equal: below the rounding of a long path.
SAME_ARC_RAD, SAME_M = 1e-9, 1e-12
#: Work of testing a line [visited triangles].
LINE_WORK = 8


class Lines(NamedTuple):
    """Lines from the circles of vertices, in the order found: those of vertex v with turn +1 are first[2 v]:first[2 v]
    + number[2 v] (number -1: not yet searched), those with turn -1 the same of 2 v + 1.

    to: 2 w for the circle of w with turn +1, 2 w + 1 with turn -1; leave, arrive: angles on the two arcs [rad];
    length [m]; state: UNKNOWN, FREE or BLOCKED; used: number of lines."""

    first: Longs
    number: Longs
    to: Longs
    leave: Floats
    arrive: Floats
    length: Floats
    state: NDArray[np.int8]
    used: Longs


class Arcs(NamedTuple):
    """The arcs of vertices: `low` is the begin of each and `span` its length [rad] (negative: none), from the walls
    that meet there; `ends` (n, 4) are unit vectors to the ends of the part that can be free for the radius; `state`
    is UNKNOWN, FREE (no other obstacle is near) or BLOCKED; `usable` is whether a free part exists."""

    low: Floats
    span: Floats
    ends: Floats
    state: NDArray[np.int8]
    usable: NDArray[np.bool_]


class Labels(NamedTuple):
    """What one search knows: the least cost [m] to the end of each line; for each circle the angle of an earlier
    arrival and its cost minus its arc; the first link from each circle to a goal. An entry is valid if its epoch is
    the search's."""

    cost: Floats
    cost_epoch: Longs
    angle: Floats
    offset: Floats
    circle_epoch: Longs
    link: Longs
    link_epoch: Longs
    epoch: Longs


class Radii(NamedTuple):
    """Radius of the robot, and of the circles on which it turns, which is not smaller [m]. Ends of walls less than
    `same_m` apart are one vertex. reach_m: how far inside a dead end a passing path may turn, see dead_ends.py."""

    robot: float
    turn: float
    same_m: float
    reach_m: float


@inner_kernel
def _determine_arc(arcs: Arcs, xy: Floats, grid: Grid, v: int, radii: Radii) -> bool:
    """Determine once which part of a vertex's arc is free; returns whether there is one."""
    if arcs.state[v] == UNKNOWN:
        first, last, alone = free_arc(grid, xy[v, 0], xy[v, 1], arcs.low[v], arcs.span[v], radii.turn, radii.same_m)
        arcs.ends[v, 0], arcs.ends[v, 1] = math.cos(arcs.low[v] + first), math.sin(arcs.low[v] + first)
        arcs.ends[v, 2], arcs.ends[v, 3] = math.cos(arcs.low[v] + last), math.sin(arcs.low[v] + last)
        arcs.usable[v] = last >= first - SAME_RAD
        arcs.state[v] = FREE if alone else BLOCKED
    return arcs.usable[v]


@inner_kernel
def _on_arc(arcs: Arcs, v: int, ex: float, ey: float) -> bool:
    """Whether the free part of the arc of v contains the direction of the unit vector e."""
    ax, ay, bx, by = arcs.ends[v]
    return (
        ax * ey - ay * ex >= -SAME_RAD
        and ex * by - ey * bx >= -SAME_RAD
        and (ax + bx) * ex + (ay + by) * ey >= -SAME_RAD
    )


@inner_kernel
def _angle(arcs: Arcs, v: int, ex: float, ey: float) -> float:
    """The angle of the direction of the unit vector e on the arc of v."""
    angle = (math.atan2(ey, ex) - arcs.low[v]) % (2 * math.pi)
    if angle > arcs.span[v]:  # rounded to before the begin or beyond the end
        return 0.0 if angle > math.pi + arcs.span[v] / 2 else arcs.span[v]
    return angle


@inner_kernel
def _find_lines(
    mesh: Mesh, xy: Floats, grid: Grid, lines: Lines, arcs: Arcs, scratch: Scratch, v: int, radii: Radii
) -> int:
    """Add the lines from vertex v; returns the work done, -1 if there is no room."""
    seen, visited = seen_from(mesh, xy, v, 0.0, 0.0, scratch)
    count = 0
    for i in range(seen):
        w = scratch.seen[i]
        if arcs.span[w] > 0.0 and _determine_arc(arcs, xy, grid, w, radii):
            scratch.seen[count] = w
            count += 1
    if lines.used[0] + 4 * count > lines.to.shape[0]:
        return -1
    at = lines.used[0]
    for side in range(2):
        turn = 1 - 2 * side
        lines.first[2 * v + side] = at
        for i in range(count):
            w = scratch.seen[i]
            dx, dy = xy[w, 0] - xy[v, 0], xy[w, 1] - xy[v, 1]
            for other in range(2):
                hx, hy, length = tangent(dx, dy, radii.turn, turn, 1 - 2 * other)
                if length < 0.0 or not _on_arc(arcs, v, turn * hy, -turn * hx):
                    continue
                there = 1 - 2 * other
                if not _on_arc(arcs, w, there * hy, -there * hx):
                    continue
                lines.to[at], lines.length[at] = 2 * w + other, length
                lines.leave[at] = _angle(arcs, v, turn * hy, -turn * hx)
                lines.arrive[at] = _angle(arcs, w, there * hy, -there * hx)
                lines.state[at] = UNKNOWN
                at += 1
        lines.number[2 * v + side] = at - lines.first[2 * v + side]
    lines.used[0] = at
    return visited + 4 * seen


@inner_kernel
def _enqueue(
    queue: list[tuple[float, int]],
    records: Floats,
    size: int,
    estimate: float,
    parent: int,
    target: int,
    leave: float,
    arrive: float,
    line: int,
    cost: float,
) -> Floats:
    """Write record `size` of a line and queue it; returns the records, enlarged if necessary.

    A record is the previous record, the circle reached (or -1 - goal), the angle at which the previous circle was
    left, the angle of arrival, the line (or -1), and the cost at arrival [m]."""
    if size == records.shape[0]:
        records = doubled(records)
    records[size, 0], records[size, 1], records[size, 2] = parent, target, leave
    records[size, 3], records[size, 4], records[size, 5] = arrive, line, cost
    heapq.heappush(queue, (estimate, size))
    return records


@inner_kernel
def _may_turn_at(arcs: Arcs, ends: DeadEnds, xy: Floats, grid: Grid, v: int, epoch: int, radii: Radii) -> bool:
    """Whether a path of this search may turn at a vertex."""
    if arcs.span[v] <= 0.0 or not (ends.near_core[v] or ends.stamp[v] == epoch):
        return False
    return _determine_arc(arcs, xy, grid, v, radii)


@inner_kernel
def _link_goal(
    mesh: Mesh,
    xy: Floats,
    grid: Grid,
    arcs: Arcs,
    labels: Labels,
    scratch: Scratch,
    ends: DeadEnds,
    start_x: float,
    start_y: float,
    goals: Floats,
    goal: int,
    limit: float,
    radii: Radii,
    links: Floats,
    linked: int,
) -> tuple[Floats, int, int]:
    """Link the circles that see a goal to it. A link is the next link of its circle (or -1), the goal, the angle at
    which the circle is left, and the length [m]. Returns the links, their number, and the work done."""
    epoch = labels.epoch[0]
    gx, gy = goals[goal]
    seen, visited = seen_from(mesh, xy, np.int64(-1), gx, gy, scratch)
    for i in range(seen):
        v = scratch.seen[i]
        if _least_length_via(xy, v, start_x, start_y, goals[goal : goal + 1], radii.turn) > limit:
            continue
        if not _may_turn_at(arcs, ends, xy, grid, v, epoch, radii):
            continue
        for side in range(2):
            turn = 1 - 2 * side
            hx, hy, length = tangent(gx - xy[v, 0], gy - xy[v, 1], radii.turn, turn, 0)
            if length < 0.0 or not _on_arc(arcs, v, turn * hy, -turn * hx):
                continue
            circle = 2 * v + side
            if linked == links.shape[0]:
                links = doubled(links)
            links[linked, 0] = labels.link[circle] if labels.link_epoch[circle] == epoch else -1
            links[linked, 1], links[linked, 3] = goal, length
            links[linked, 2] = _angle(arcs, v, turn * hy, -turn * hx)
            labels.link[circle], labels.link_epoch[circle] = linked, epoch
            linked += 1
    return links, linked, visited + 4 * seen


@kernel
def search(
    mesh: Mesh,
    xy: Floats,
    grid: Grid,
    lines: Lines,
    arcs: Arcs,
    labels: Labels,
    scratch: Scratch,
    ends: DeadEnds,
    start_x: float,
    start_y: float,
    goals: Floats,
    enough: int,
    limit: float,
    lanes: Floats,
    outbound: bool,
    radii: Radii,
    budget: int,
) -> tuple[int, Floats, Longs, Floats]:
    """Status, lengths [m] of the shortest paths from the start to the `enough` nearest goals (n, 2), inf for the
    others, first index (n + 1) of the corners of each, and the corners (k, 2), ends included.

    No path is longer than `limit` or breaks a rule of `lanes` (m, LANE_COLUMNS), driven from the start or, if
    not `outbound`, to it. The search ends with NO_BUDGET after `budget` units of work, and with NO_ROOM if `lines`
    is full."""
    wanted = goals.shape[0]
    found = np.full(wanted, np.inf)
    found_by = np.full(wanted, -1, np.int64)
    labels.epoch[0] += 1
    epoch = labels.epoch[0]
    stamp_exit_route(mesh, xy, ends, start_x, start_y, radii.reach_m, epoch)
    for g in range(wanted):
        stamp_exit_route(mesh, xy, ends, goals[g, 0], goals[g, 1], radii.reach_m, epoch)
    records, size = np.empty((256, 6)), 0
    links, linked = np.empty((64, 4)), 0
    queue = [(0.0, 0) for _ in range(0)]
    aimed = goals if wanted <= MAX_AIMED_GOALS else goals[:0]

    seen, visited = seen_from(mesh, xy, np.int64(-1), start_x, start_y, scratch)
    work = visited + 4 * seen
    for i in range(seen):
        v = scratch.seen[i]
        if _least_length_via(xy, v, start_x, start_y, aimed, radii.turn) > limit:
            continue
        if not _may_turn_at(arcs, ends, xy, grid, v, epoch, radii):
            continue
        for side in range(2):
            turn = 1 - 2 * side
            hx, hy, length = tangent(xy[v, 0] - start_x, xy[v, 1] - start_y, radii.turn, 0, turn)
            if length < 0.0 or not _on_arc(arcs, v, turn * hy, -turn * hx):
                continue
            angle = _angle(arcs, v, turn * hy, -turn * hx)
            estimate = length + _distance_to_go(aimed, xy, arcs, v, angle, radii.turn)
            if estimate <= limit:
                records = _enqueue(queue, records, size, estimate, -1, 2 * v + side, 0.0, angle, -1, length)
                size += 1
    has_start_lines = size > 0
    for g in range(wanted):
        length = math.hypot(goals[g, 0] - start_x, goals[g, 1] - start_y)
        if length <= limit:
            records = _enqueue(queue, records, size, length, -1, -1 - g, 0.0, 0.0, -1, length)
            size += 1
        if has_start_lines:
            links, linked, done = _link_goal(
                mesh, xy, grid, arcs, labels, scratch, ends, start_x, start_y, goals, g, limit, radii, links, linked
            )
            work += done

    complete, status = 0, DONE
    while queue and complete < enough:
        if work > budget:
            status = NO_BUDGET
            break
        _, record = heapq.heappop(queue)
        parent, target, line = int(records[record, 0]), int(records[record, 1]), int(records[record, 4])
        cost = records[record, 5]
        if target < 0 and cost >= found[-1 - target]:
            continue
        ax, ay, bx, by = start_x, start_y, 0.0, 0.0
        if parent >= 0:
            ax, ay = _point_on_arc(xy, arcs, int(records[parent, 1]) // 2, records[record, 2], radii.turn)
        if target < 0:
            bx, by = goals[-1 - target]
        else:
            bx, by = _point_on_arc(xy, arcs, target // 2, records[record, 3], radii.turn)
        if line < 0 or lines.state[line] == UNKNOWN:
            work += LINE_WORK
            free = line_free(grid, ax, ay, bx, by, radii.robot)
            if line >= 0:
                lines.state[line] = FREE if free else BLOCKED
        else:
            free = lines.state[line] == FREE
        if free and lanes.shape[0]:
            if outbound:
                free = not breaks_rule(lanes, ax, ay, bx, by, radii.robot)
            else:
                free = not breaks_rule(lanes, bx, by, ax, ay, radii.robot)
        if not free:
            continue
        if target < 0:
            found[-1 - target], found_by[-1 - target] = cost, record
            complete += 1
            continue
        v, turn = target // 2, 1 - 2 * (target % 2)
        angle = records[record, 3]
        alone = arcs.state[v] == FREE
        if alone and _is_dominated(arcs, labels, target, angle, cost, radii.turn):
            continue
        if lines.number[target] < 0:
            done = _find_lines(mesh, xy, grid, lines, arcs, scratch, v, radii)
            if done < 0:
                status = NO_ROOM
                break
            work += done
        begin = arcs.low[v] + angle
        link = labels.link[target] if labels.link_epoch[target] == epoch else -1
        while link >= 0:
            leave, goal = links[link, 2], int(links[link, 1])
            turned = turn * (leave - angle)
            total = cost + radii.turn * max(turned, 0.0) + links[link, 3]
            link = int(links[link, 0])
            if turned < -SAME_ARC_RAD or total >= found[goal] or total > limit:
                continue
            if alone or arc_is_free(grid, xy[v, 0], xy[v, 1], radii.turn, begin, arcs.low[v] + leave, radii.robot):
                records = _enqueue(queue, records, size, total, record, -1 - goal, leave, 0.0, -1, total)
                size += 1
        first = lines.first[target]
        work += lines.number[target]
        for i in range(first, first + lines.number[target]):
            w, leave = lines.to[i] // 2, lines.leave[i]
            if lines.state[i] == BLOCKED or not (ends.near_core[w] or ends.stamp[w] == epoch):
                continue
            turned = turn * (leave - angle)
            total = cost + radii.turn * max(turned, 0.0) + lines.length[i]
            if turned < -SAME_ARC_RAD or (labels.cost_epoch[i] == epoch and labels.cost[i] <= total + SAME_M):
                continue
            estimate = total + _distance_to_go(aimed, xy, arcs, w, lines.arrive[i], radii.turn)
            if estimate > limit:
                continue
            if not alone:
                work += LINE_WORK
                if not arc_is_free(grid, xy[v, 0], xy[v, 1], radii.turn, begin, arcs.low[v] + leave, radii.robot):
                    continue
            labels.cost[i], labels.cost_epoch[i] = total, epoch
            records = _enqueue(queue, records, size, estimate, record, lines.to[i], leave, lines.arrive[i], i, total)
            size += 1
    corners, first_corner = _corners(xy, arcs, records, found_by, start_x, start_y, goals, radii.turn)
    return status, found, first_corner, corners


@inner_kernel
def _is_dominated(arcs: Arcs, labels: Labels, circle: int, angle: float, cost: float, radius: float) -> bool:
    """Whether an earlier arrival reaches everything on a free arc at most as expensively; else this one is recorded."""
    passed = angle if circle % 2 == 0 else arcs.span[circle // 2] - angle
    offset = cost - radius * passed
    if labels.circle_epoch[circle] == labels.epoch[0]:
        if labels.angle[circle] <= passed + SAME_M and labels.offset[circle] <= offset + SAME_M:
            return True
        if passed > labels.angle[circle] or offset > labels.offset[circle]:
            return False
    labels.circle_epoch[circle] = labels.epoch[0]
    labels.angle[circle], labels.offset[circle] = passed, offset
    return False


@inner_kernel
def _least_length_via(xy: Floats, v: int, x: float, y: float, goals: Floats, radius: float) -> float:
    """Lower bound of a path from (x, y) over the circle of a vertex to the nearest goal [m]; 0 without goals."""
    return _nearest_m(goals, xy[v, 0], xy[v, 1]) + math.hypot(xy[v, 0] - x, xy[v, 1] - y) - 2.0 * radius


@inner_kernel
def _point_on_arc(xy: Floats, arcs: Arcs, v: int, angle: float, radius: float) -> tuple[float, float]:
    """The point at an angle of a vertex's arc."""
    angle += arcs.low[v]
    return xy[v, 0] + radius * math.cos(angle), xy[v, 1] + radius * math.sin(angle)


@inner_kernel
def _distance_to_go(goals: Floats, xy: Floats, arcs: Arcs, v: int, angle: float, radius: float) -> float:
    """Lower bound of the distance from a point on an arc to the nearest goal [m]; 0 without goals."""
    if not goals.shape[0]:
        return 0.0
    x, y = _point_on_arc(xy, arcs, v, angle, radius)
    return _nearest_m(goals, x, y)


@inner_kernel
def _nearest_m(goals: Floats, x: float, y: float) -> float:
    """Distance from a point to the nearest goal [m]; 0 without goals."""
    least = np.inf if goals.shape[0] else 0.0
    for g in range(goals.shape[0]):
        least = min(least, math.hypot(goals[g, 0] - x, goals[g, 1] - y))
    return least


@inner_kernel
def _corners(
    xy: Floats,
    arcs: Arcs,
    records: Floats,
    found_by: Longs,
    start_x: float,
    start_y: float,
    goals: Floats,
    radius: float,
) -> tuple[Floats, Longs]:
    """The corners of the paths found, ends included, concatenated, and the first index of each."""
    wanted = goals.shape[0]
    first = np.zeros(wanted + 1, np.int64)
    corners = np.empty((0, 2))
    for write in range(2):
        count = 0
        for g in range(wanted):
            first[g] = count
            if found_by[g] < 0:
                continue
            steps = 0
            record = found_by[g]
            while record >= 0:
                steps += 1
                record = int(records[record, 0])
            chain = np.empty(steps, np.int64)
            record = found_by[g]
            for i in range(steps - 1, -1, -1):
                chain[i] = record
                record = int(records[record, 0])
            if write:
                corners[count, 0], corners[count, 1] = start_x, start_y
            count += 1
            for i in range(steps - 1):
                v = int(records[chain[i], 1]) // 2
                count = arc_corners(
                    xy[v, 0],
                    xy[v, 1],
                    radius,
                    arcs.low[v] + records[chain[i], 3],
                    arcs.low[v] + records[chain[i + 1], 2],
                    corners,
                    count,
                    write == 1,
                )
            if write:
                corners[count, 0], corners[count, 1] = goals[g]
            count += 1
        first[wanted] = count
        if write == 0:
            corners = np.empty((count, 2))
    return corners, first

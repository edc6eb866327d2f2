"""The route of a rigid body on one floor: A* on a lattice of poses (x, y, heading), then shortening.

The goal is a pose of the lattice; the start is connected to the poses around it. The motion between two neighbours
is tested only when the search takes it: it never takes most of them.

Sources: A* with a weighted heuristic (Pohl 1970), which is the distance of a disc on the grid of points; motions tested
late as in Lazy PRM (Bohlin and Kavraki 2000); random shortcuts (Geraerts and Overmars 2007).
"""

from __future__ import annotations

import heapq
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.planning.body import CapsuleBody, body_clearance, body_passes
from robocorba.planning.space import line_clearance
from robocorba.system.kernels import inner_kernel, kernel

Bytes = NDArray[np.uint8]

#: Step of the lattice [m], and number of headings in a full turn.
STEP_M, HEADINGS = 0.10, 24
#: Maximum number of poses of a lattice; its step grows beyond that.
MAX_POSES = 30_000_000
#: Number of expanded poses after which a search ends.
MAX_EXPANDED = 3_000_000
#: A motion costs more if the clearance beyond the margin is less than this [m], at none twice as much.
COMFORT_CLEARANCE_M = 0.2
#: Weight of the heuristic: a route is found much sooner, and costs at most so many times as much as the best one.
HEURISTIC_WEIGHT = 1.5
#: Cost of turning by a radian, as a share of the body's reach.
TURN_COST = 0.5
#: Number of poses that the search still expands for further goals after it reached one.
POSES_AFTER_FIRST_GOAL = 20_000
#: Number of attempts to cut short between two random points of a route.
SHORTCUTS = 200
#: What the search knows of a pose: its clearance [m] (0: unknown, negative: less than the margin), least cost [m], and
#: parent (0: not reached, -1 - source, or 1 + previous pose).
POSE = np.dtype([("clearance", "f4"), ("cost", "f8"), ("parent", "i8")], align=True)


class Lattice(NamedTuple):
    """A lattice of poses: points in rows and columns, and at each point the same headings.

    x, y: lower corner [m]; heading: the first one [rad]; step [m]; open_m (rows, columns): distance from a point to
    the nearest obstacle [m], up to a limit."""

    x: float
    y: float
    heading: float
    step: float
    open_m: Floats


class LatticeRoute(NamedTuple):
    """A route (k, 3: x, y [m] and heading [rad]) to a goal, its cost [m], and the indices of its source and goal."""

    route: Floats
    cost: float
    source: int
    goal: int


class _Search(NamedTuple):
    """A search: what it knows of all poses (n,), POSE, and the points that it has reached (rows, columns)."""

    grid: Grid
    body: CapsuleBody
    margin_m: float
    lattice: Lattice
    to_goal_m: Floats
    goals: Longs
    poses: Any
    reached: Bytes


def lay_lattice(grid: Grid, box: tuple[float, float, float, float], anchor: Floats, far_m: float) -> Lattice:
    """A lattice through the pose `anchor` within x0, y0, x1, y1 [m]. far_m: limit of the distances to obstacles [m]."""
    x0, y0, x1, y1 = box
    step = max(STEP_M, math.sqrt((x1 - x0) * (y1 - y0) * HEADINGS / MAX_POSES))
    low_x = anchor[0] - step * math.floor((anchor[0] - x0) / step)
    low_y = anchor[1] - step * math.floor((anchor[1] - y0) / step)
    columns, rows = int((x1 - low_x) / step) + 1, int((y1 - low_y) / step) + 1
    lattice = Lattice(float(low_x), float(low_y), float(anchor[2]), step, np.empty((rows, columns)))
    _measure_open(grid, lattice, far_m)
    return lattice


def distances_to_goal(lattice: Lattice, goals: Floats, radius_m: float) -> Floats:
    """Distance from each point (rows, columns) to the nearest goal for a disc of this radius [m]; inf where it
    cannot reach one."""
    cells = [_cell(lattice, goal) for goal in goals]
    return _distances_to_goal(lattice, np.array(cells, np.int64).reshape(-1, 2), radius_m)


def find_routes(
    grid: Grid, body: CapsuleBody, lattice: Lattice, to_goal_m: Floats, sources: Floats, goals: Floats, margin_m: float
) -> tuple[list[LatticeRoute], Bytes]:
    """Routes on the lattice that keep `margin_m` from obstacles, from sources (n, 4: pose and initial cost) to goals
    (m, 3), and the points reached (rows, columns). to_goal_m: the result of `distances_to_goal` for the goals.

    The search ends without further routes after MAX_EXPANDED poses."""
    states = np.array([_state(lattice, goal) for goal in goals], np.int64)
    # numpy.zeros maps pages on first use: poses that the search never touches take no memory.
    poses, reached = np.zeros(lattice.open_m.size * HEADINGS, POSE), np.zeros(lattice.open_m.shape, np.uint8)
    search = _Search(grid, body, margin_m, lattice, to_goal_m, states, poses, reached)
    found = []
    for index in _reach_goals(search, sources).tolist():
        at, back = int(states[index]), [goals[index]]
        while poses["parent"][at] > 0:
            at = int(poses["parent"][at]) - 1
            back.append(np.array(_pose(lattice, at)))
        source = -int(poses["parent"][at]) - 1
        route = np.array([*back, sources[source, :3]][::-1])
        route[:, 2] = np.unwrap(route[:, 2])
        found.append(LatticeRoute(route, float(poses["cost"][states[index]]), source, index))
    return found, reached


@kernel
def shorten(grid: Grid, body: CapsuleBody, route: Floats, margin_m: float, preferred_m: float) -> Floats:
    """A shorter route with fewer poses, which keeps `preferred_m` wherever the given route does."""
    route = _skip(grid, body, margin_m, preferred_m, route)
    random, numbers = 12345, np.empty(4, np.int64)  # the same on every computer
    a, b = np.empty(3), np.empty(3)
    for _ in range(SHORTCUTS):
        last = route.shape[0] - 1
        if last < 2:
            break
        for k in range(4):  # by the generator that ISO C gives as an example of rand()
            random = (random * 1103515245 + 12345) % 2147483648
            numbers[k] = random // 65536
        i, j = numbers[0] % last, numbers[1] % last
        if i >= j:
            continue
        s, t = (numbers[2] % 1000) / 1000.0, (numbers[3] % 1000) / 1000.0
        for k in range(3):
            a[k] = route[i, k] + s * (route[i + 1, k] - route[i, k])
            b[k] = route[j, k] + t * (route[j + 1, k] - route[j, k])
        if _is_shortcut(grid, body, margin_m, preferred_m, route, i, j, a, b):
            shorter = np.empty((i + 3 + last - j, 3))
            for k in range(3):
                for v in range(i + 1):
                    shorter[v, k] = route[v, k]
                shorter[i + 1, k], shorter[i + 2, k] = a[k], b[k]
                for v in range(j + 1, last + 1):
                    shorter[i + 2 + v - j, k] = route[v, k]
            route = shorter
    return _skip(grid, body, margin_m, preferred_m, route)


def _cell(lattice: Lattice, pose: Floats) -> tuple[int, int]:
    rows, columns = lattice.open_m.shape
    column, row = round((pose[0] - lattice.x) / lattice.step), round((pose[1] - lattice.y) / lattice.step)
    return min(max(column, 0), columns - 1), min(max(row, 0), rows - 1)


def _state(lattice: Lattice, pose: Floats) -> int:
    column, row = _cell(lattice, pose)
    heading_index = round(math.remainder(pose[2] - lattice.heading, math.tau) / (math.tau / HEADINGS)) % HEADINGS
    return (row * lattice.open_m.shape[1] + column) * HEADINGS + heading_index


@kernel
def _pose(lattice: Lattice, state: int) -> tuple[float, float, float]:
    """The pose of a state: x, y, heading."""
    point, heading_index = divmod(state, HEADINGS)
    row, column = divmod(point, lattice.open_m.shape[1])
    heading = lattice.heading + heading_index * (math.tau / HEADINGS)
    return lattice.x + column * lattice.step, lattice.y + row * lattice.step, heading


@kernel
def _measure_open(grid: Grid, lattice: Lattice, cap: float) -> None:
    """Fill in `open_m`, at most `cap` [m]."""
    rows, columns = lattice.open_m.shape
    for row in range(rows):
        for column in range(columns):
            x, y = lattice.x + column * lattice.step, lattice.y + row * lattice.step
            lattice.open_m[row, column] = line_clearance(grid, x, y, x, y, cap)[0]


@kernel
def _distances_to_goal(lattice: Lattice, cells: Longs, radius: float) -> Floats:
    rows, columns = lattice.open_m.shape
    to_goal_m = np.full((rows, columns), np.inf)
    queue = [(0.0, 0) for _ in range(0)]
    for i in range(cells.shape[0]):
        column, row = cells[i]
        to_goal_m[row, column] = 0.0
        heapq.heappush(queue, (0.0, row * columns + column))
    while queue:
        so_far, at = heapq.heappop(queue)
        row, column = at // columns, at % columns
        if so_far > to_goal_m[row, column]:
            continue
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = row + down, column + right
                if 0 <= r < rows and 0 <= c < columns and lattice.open_m[r, c] >= radius:
                    total = so_far + lattice.step * math.sqrt(down * down + right * right)
                    if total < to_goal_m[r, c]:
                        to_goal_m[r, c] = total
                        heapq.heappush(queue, (total, r * columns + c))
    return to_goal_m


@kernel
def _reach_goals(search: _Search, sources: Floats) -> Longs:
    """Indices of the goals reached, in this order."""
    columns = search.lattice.open_m.shape[1]
    settled, number = np.empty(search.goals.shape[0], np.int64), 0
    # Estimate, cost, state, parent as in POSE, and whether the motion from the parent is known to be free.
    queue = [(0.0, 0.0, 0, 0, False) for _ in range(0)]
    _leave_sources(search, sources, queue)
    expansions_left, expanded = POSES_AFTER_FIRST_GOAL, 0
    while queue:
        _, cost, state, parent, is_free = heapq.heappop(queue)
        here = search.poses[state]
        if here.parent != 0 or _clearance_at(search, state) < 0.0:
            continue
        if not is_free and not _passes(search, sources, parent, state):
            continue
        here.parent, here.cost = parent, cost
        search.reached[state // HEADINGS // columns, state // HEADINGS % columns] = 1
        expanded += 1
        if expanded > MAX_EXPANDED:
            break
        for g in range(search.goals.shape[0]):
            if search.goals[g] == state:
                settled[number] = g
                number += 1
        if number == search.goals.shape[0]:
            break
        if number:
            expansions_left -= 1
            if expansions_left < 0:
                break
        _expand(search, state, queue)
    return settled[:number]


@inner_kernel
def _leave_sources(search: _Search, sources: Floats, queue: list[tuple[float, float, int, int, bool]]) -> None:
    """Queue the poses of the lattice around each source."""
    lattice, turn = search.lattice, math.tau / HEADINGS
    rows, columns = lattice.open_m.shape
    for s in range(sources.shape[0]):
        column = math.floor((sources[s, 0] - lattice.x) / lattice.step)
        row = math.floor((sources[s, 1] - lattice.y) / lattice.step)
        heading_index = math.floor((sources[s, 2] - lattice.heading) / turn)
        for r in range(max(row - 1, 0), min(row + 3, rows)):
            for c in range(max(column - 1, 0), min(column + 3, columns)):
                for k in range(heading_index - 1, heading_index + 3):
                    if search.to_goal_m[r, c] == np.inf:
                        continue
                    dx = lattice.x + c * lattice.step - sources[s, 0]
                    dy = lattice.y + r * lattice.step - sources[s, 1]
                    dh = TURN_COST * search.body.reach * (lattice.heading + k * turn - sources[s, 2])
                    cost = sources[s, 3] + math.sqrt(dx * dx + dy * dy + dh * dh)
                    estimate = cost + HEURISTIC_WEIGHT * search.to_goal_m[r, c]
                    state = (r * columns + c) * HEADINGS + k % HEADINGS
                    heapq.heappush(queue, (estimate, cost, state, -1 - s, False))


@inner_kernel
def _expand(search: _Search, state: int, queue: list[tuple[float, float, int, int, bool]]) -> None:
    """Queue the neighbours of a pose."""
    lattice, margin, turn = search.lattice, search.margin_m, math.tau / HEADINGS
    rows, columns = lattice.open_m.shape
    weight, here = TURN_COST * search.body.reach, search.poses[state]
    heading_index, row, column = state % HEADINGS, state // HEADINGS // columns, state // HEADINGS % columns
    for down in range(-1, 2):
        for right in range(-1, 2):
            r, c = row + down, column + right
            if r < 0 or r >= rows or c < 0 or c >= columns or search.to_goal_m[r, c] == np.inf:
                continue
            for by in range(-1, 2):
                k = (heading_index + by) % HEADINGS
                other = (r * columns + c) * HEADINGS + k
                there = search.poses[other]
                if other == state or there.parent != 0 or _clearance_at(search, other) < 0.0:
                    continue
                distance = lattice.step * math.sqrt(down * down + right * right)
                length = math.sqrt(distance * distance + weight * weight * turn * turn * by * by)
                room = min(here.clearance, there.clearance) - margin
                total = here.cost + length * (1.0 + max(0.0, 1.0 - room / COMFORT_CLEARANCE_M))
                if there.cost > 0.0 and total >= there.cost:
                    continue
                travel_m = distance + search.body.reach * turn * abs(by)
                is_known = here.clearance + there.clearance - 2.0 * margin >= travel_m
                if is_known:
                    there.cost = total
                rest = search.to_goal_m[r, c]
                if search.goals.shape[0] == 1:
                    steps_off = abs(k - search.goals[0] % HEADINGS)
                    off = weight * turn * min(steps_off, HEADINGS - steps_off)
                    rest = math.sqrt(rest * rest + off * off)
                heapq.heappush(queue, (total + HEURISTIC_WEIGHT * rest, total, other, state + 1, is_known))


@kernel
def _cap(search: _Search) -> float:
    """Clearance up to which the search distinguishes poses [m]."""
    return 2.0 * search.margin_m + COMFORT_CLEARANCE_M + 0.15


@inner_kernel
def _clearance_at(search: _Search, state: int) -> float:
    """Clearance of a pose [m], as in POSE, determined once."""
    found = search.poses[state]
    if found.clearance == 0.0:
        columns, cap = search.lattice.open_m.shape[1], _cap(search)
        point_m = search.lattice.open_m[state // HEADINGS // columns, state // HEADINGS % columns]
        clearance = cap
        if point_m - search.body.reach < cap:
            x, y, heading = _pose(search.lattice, state)
            clearance = body_clearance(search.grid, search.body, x, y, heading, cap)
        found.clearance = clearance if clearance >= search.margin_m else -1.0
    return found.clearance


@inner_kernel
def _passes(search: _Search, sources: Floats, parent: int, state: int) -> bool:
    """Whether the body can move to a pose from its parent."""
    a, b = np.empty(3), np.empty(3)
    b[0], b[1], b[2] = _pose(search.lattice, state)
    if parent < 0:
        a[0], a[1], a[2] = sources[-1 - parent, 0], sources[-1 - parent, 1], sources[-1 - parent, 2]
        clear_a = body_clearance(search.grid, search.body, a[0], a[1], a[2], _cap(search))
    else:
        a[0], a[1], a[2] = _pose(search.lattice, parent - 1)
        clear_a = search.poses[parent - 1].clearance
    off = b[2] - a[2]
    b[2] = a[2] + (off - math.tau * math.floor(off / math.tau + 0.5))
    clear_b = float(search.poses[state].clearance)
    return body_passes(search.grid, search.body, a, b, clear_a, clear_b, search.margin_m)


@inner_kernel
def _motion_cost(a: Floats, b: Floats, weight: float) -> float:
    """Cost of the straight motion between two poses [m], without the cost of narrow places."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (weight * (b[2] - a[2])) ** 2)


@inner_kernel
def _is_shortcut(
    grid: Grid, body: CapsuleBody, margin: float, preferred: float, route: Floats, i: int, j: int, a: Floats, b: Floats
) -> bool:
    """Whether the straight motion from a pose a of line i to a pose b of line j is free and worth while."""
    weight, cap = TURN_COST * body.reach, 2.0 * preferred + 0.2
    old = _motion_cost(a, route[i + 1], weight) + _motion_cost(route[j], b, weight)
    for v in range(i + 1, j):
        old += _motion_cost(route[v], route[v + 1], weight)
    if old - _motion_cost(a, b, weight) < 0.02 + 0.1 * max(2 - (j - i), 0):
        return False
    clear_a = body_clearance(grid, body, a[0], a[1], a[2], cap)
    clear_b = body_clearance(grid, body, b[0], b[1], b[2], cap)
    least = min(min(clear_a, clear_b), preferred)
    for v in range(i + 1, j + 1):
        least = min(least, body_clearance(grid, body, route[v, 0], route[v, 1], route[v, 2], preferred))
    return body_passes(grid, body, a, b, clear_a, clear_b, max(margin, least))


@inner_kernel
def _skip(grid: Grid, body: CapsuleBody, margin: float, preferred: float, route: Floats) -> Floats:
    """The route without the poses that the body can skip: from each pose to the farthest one within its reach."""
    count = route.shape[0]
    clearance = np.empty(count)
    for i in range(count):
        clearance[i] = body_clearance(grid, body, route[i, 0], route[i, 1], route[i, 2], 2.0 * preferred + 0.2)
    kept = np.empty((count, 3))
    number, i = 0, 0
    while True:
        for k in range(3):
            kept[number, k] = route[i, k]
        number += 1
        if i == count - 1:
            return kept[:number]
        j = count - 1
        while j > i + 1:
            least = preferred
            for v in range(i, j + 1):
                least = min(least, clearance[v])
            if body_passes(grid, body, route[i], route[j], clearance[i], clearance[j], max(margin, least)):
                break
            j -= 1
        i = j

"""The route of a rigid body on one floor: A* on a lattice of poses (x, y, heading), then shortening.

The goal is a pose of the lattice; the start is connected to the poses around it. The motion between two neighbours
is tested only when the search takes it: it never takes most of them.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.planning.body import CapsuleBody, body_clearance, body_passes
from robocorba.planning.space import nearest_segment
from robocorba.system.kernels import kernel

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

#: Step of the lattice [m], and number of headings in a full turn.
STEP_M, HEADINGS = 0.10, 24
#: Maximum number of poses of a lattice; its step grows beyond that.
MAX_POSES = 30_000_000
#: Number of expanded poses after which a search ends.
MAX_EXPANDED = 3_000_000
#: A motion costs more if the clearance beyond the margin is less than this [m].
COMFORT_CLEARANCE_M = 0.2
#: Additional share of the cost at no clearance beyond the margin.
NARROW_COST = 1.0
#: Weight of the heuristic (weighted A*): a good route is found sooner than the best one.
HEURISTIC_WEIGHT = 1.5
#: Cost of turning by a radian, as a share of the body's reach.
TURN_COST = 0.5
#: Number of poses that the search still expands for further goals after it reached one.
POSES_AFTER_FIRST_GOAL = 20_000
#: Number of attempts to cut short between two random points of a route.
SHORTCUTS = 200


class Lattice(NamedTuple):
    """A lattice of poses: points in rows and columns, and at each point the same headings.

    frame: x and y of the lower corner [m], first heading [rad], step [m], number of columns, rows, headings. open_m
    (rows, columns): distance from a point to the nearest obstacle [m], up to a limit."""

    frame: Floats
    open_m: Floats


class LatticeRoute(NamedTuple):
    """A route (k, 3: x, y [m] and heading [rad]) to a goal, its cost [m], and the indices of its source and goal."""

    route: Floats
    cost: float
    source: int
    goal: int


def lay_lattice(grid: Grid, box: tuple[float, float, float, float], anchor: Floats, far_m: float) -> Lattice:
    """A lattice through the pose `anchor` within x0, y0, x1, y1 [m]. far_m: limit of the distances to obstacles [m]."""
    x0, y0, x1, y1 = box
    step = max(STEP_M, math.sqrt((x1 - x0) * (y1 - y0) * HEADINGS / MAX_POSES))
    low_x = anchor[0] - step * math.floor((anchor[0] - x0) / step)
    low_y = anchor[1] - step * math.floor((anchor[1] - y0) / step)
    columns, rows = int((x1 - low_x) / step) + 1, int((y1 - low_y) / step) + 1
    frame = np.array([low_x, low_y, anchor[2], step, columns, rows, HEADINGS], float)
    return Lattice(frame, _open_distances(grid, frame, far_m))


def distances_to_goal(lattice: Lattice, goals: Floats, radius_m: float) -> Floats:
    """Distance from each point (rows, columns) to the nearest goal for a disc of this radius [m]; inf where it
    cannot reach one."""
    cells = [_cell(lattice, goal) for goal in goals]
    return _distances_to_goal(lattice.frame, lattice.open_m, np.array(cells, np.int64).reshape(-1, 2), radius_m)


def find_routes(
    grid: Grid,
    body: CapsuleBody,
    lattice: Lattice,
    to_goal_m: Floats,
    sources: Floats,
    goals: Floats,
    margin_m: float,
) -> tuple[list[LatticeRoute], Bytes]:
    """Routes on the lattice that keep `margin_m` from obstacles, from sources (n, 4: pose and initial cost) to goals
    (m, 3), and the points reached (rows, columns). to_goal_m: the result of `distances_to_goal` for the goals.

    The search ends without further routes after MAX_EXPANDED poses."""
    frame = lattice.frame
    states = np.array([_state(lattice, goal) for goal in goals], np.int64)
    weight = TURN_COST * body.reach
    count = lattice.open_m.size * HEADINGS
    # numpy.zeros maps pages on first use: poses that the search never touches take no memory.
    clearance, costs, parents = np.zeros(count, np.float32), np.zeros(count), np.zeros(count, np.int64)
    goals_reached, reached = _search(
        grid,
        body.capsules,
        body.reach,
        margin_m,
        frame,
        lattice.open_m,
        to_goal_m,
        sources,
        states,
        weight,
        clearance,
        costs,
        parents,
    )
    found = []
    for index in goals_reached.tolist():
        state, poses = int(states[index]), [goals[index]]
        at = state
        while parents[at] > 0:
            at = int(parents[at]) - 1
            poses.append(np.array(_pose(frame, at)))
        source = -int(parents[at]) - 1
        poses.append(sources[source, :3])
        found.append(LatticeRoute(unwrapped(np.array(poses[::-1])), float(costs[state]), source, index))
    return found, reached


def shorten(grid: Grid, body: CapsuleBody, route: Floats, margin_m: float, preferred_m: float) -> Floats:
    """A shorter route with fewer poses, which keeps `preferred_m` wherever the given route does."""
    return _shorten(grid, body.capsules, body.reach, margin_m, preferred_m, TURN_COST * body.reach, route)


def unwrapped(route: Floats) -> Floats:
    """The route with headings that never jump; the first pose is unchanged."""
    route = route.copy()
    for i in range(1, len(route)):
        route[i, 2] = route[i - 1, 2] + math.remainder(route[i, 2] - route[i - 1, 2], math.tau)
    return route


def _cell(lattice: Lattice, pose: Floats) -> tuple[int, int]:
    x0, y0, _, step, columns, rows, _ = lattice.frame.tolist()
    column, row = round((pose[0] - x0) / step), round((pose[1] - y0) / step)
    return min(max(column, 0), int(columns) - 1), min(max(row, 0), int(rows) - 1)


def _state(lattice: Lattice, pose: Floats) -> int:
    column, row = _cell(lattice, pose)
    heading_index = round(math.remainder(pose[2] - lattice.frame[2], math.tau) / (math.tau / HEADINGS)) % HEADINGS
    return (row * int(lattice.frame[4]) + column) * HEADINGS + heading_index


@kernel
def _pose(frame: Floats, state: int) -> tuple[float, float, float]:
    """The pose of a state: x, y, heading."""
    point, heading_index = divmod(state, int(frame[6]))
    row, column = divmod(point, int(frame[4]))
    return frame[0] + column * frame[3], frame[1] + row * frame[3], frame[2] + heading_index * (math.tau / frame[6])


@kernel
def _open_distances(grid: Grid, frame: Floats, cap: float) -> Floats:
    columns, rows = int(frame[4]), int(frame[5])
    found = np.empty((rows, columns))
    for row in range(rows):
        for column in range(columns):
            clearance, _ = nearest_segment(grid, frame[0] + column * frame[3], frame[1] + row * frame[3], cap)
            found[row, column] = clearance
    return found


@kernel
def _distances_to_goal(frame: Floats, open_m: Floats, cells: Longs, radius: float) -> Floats:
    rows, columns = open_m.shape
    to_goal_m = np.full((rows, columns), np.inf)
    queue = [(0.0, 0)]
    queue.pop()
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
                if 0 <= r < rows and 0 <= c < columns and open_m[r, c] >= radius:
                    total = so_far + frame[3] * math.sqrt(down * down + right * right)
                    if total < to_goal_m[r, c]:
                        to_goal_m[r, c] = total
                        heapq.heappush(queue, (total, r * columns + c))
    return to_goal_m


@kernel
def _search(
    grid: Grid,
    capsules: Floats,
    reach: float,
    margin: float,
    frame: Floats,
    open_m: Floats,
    to_goal_m: Floats,
    sources: Floats,
    goals: Longs,
    weight: float,
    clearance: Singles,
    costs: Floats,
    parents: Longs,
) -> tuple[Longs, Bytes]:
    """Indices of the goals reached, in this order, and points reached (rows, columns). The search fills in the arrays
    of the states: clearance (0: unknown, negative: less than the margin); costs; parents (0: not reached, -1 - source,
    or 1 + previous state). weight: cost of turning by a radian [m]."""
    step, columns, rows, headings = frame[3], int(frame[4]), int(frame[5]), int(frame[6])
    turn = math.tau / headings
    reached = np.zeros((rows, columns), np.uint8)
    settled = np.empty(goals.shape[0], np.int64)
    number = 0
    cap = 2.0 * margin + COMFORT_CLEARANCE_M + 0.15
    a, b = np.empty(3), np.empty(3)
    # Estimate, cost, pose, parent as above, and whether the motion from the parent is known to be free.
    queue = [(0.0, 0.0, 0, 0, False)]
    queue.pop()

    for s in range(sources.shape[0]):
        column = math.floor((sources[s, 0] - frame[0]) / step)
        row = math.floor((sources[s, 1] - frame[1]) / step)
        heading_index = math.floor((sources[s, 2] - frame[2]) / turn)
        for r in range(max(row - 1, 0), min(row + 3, rows)):
            for c in range(max(column - 1, 0), min(column + 3, columns)):
                for k in range(heading_index - 1, heading_index + 3):
                    if to_goal_m[r, c] == np.inf:
                        continue
                    dx, dy = frame[0] + c * step - sources[s, 0], frame[1] + r * step - sources[s, 1]
                    dh = weight * (frame[2] + k * turn - sources[s, 2])
                    cost = sources[s, 3] + math.sqrt(dx * dx + dy * dy + dh * dh)
                    state = (r * columns + c) * headings + k % headings
                    heapq.heappush(queue, (cost + HEURISTIC_WEIGHT * to_goal_m[r, c], cost, state, -1 - s, False))

    expansions_left, expanded = POSES_AFTER_FIRST_GOAL, 0
    while queue:
        _, cost, state, parent, is_free = heapq.heappop(queue)
        if parents[state] != 0:
            continue
        heading_index, point = state % headings, state // headings
        row, column = point // columns, point % columns
        b[0], b[1], b[2] = _pose(frame, state)
        if clearance[state] == 0.0:
            clearance[state] = _clearance(grid, capsules, reach, b, open_m[row, column], cap, margin)
        if clearance[state] < 0.0:
            continue
        if not is_free:
            if parent < 0:
                a[:] = sources[-1 - parent, :3]
                clear_a = body_clearance(grid, capsules, a[0], a[1], a[2], cap)
            else:
                a[0], a[1], a[2] = _pose(frame, parent - 1)
                clear_a = clearance[parent - 1]
            b[2] = a[2] + _wrapped(b[2] - a[2])
            if not body_passes(grid, capsules, reach, a, b, clear_a, clearance[state], margin):
                continue
        parents[state], costs[state] = parent, cost
        reached[row, column] = 1
        expanded += 1
        if expanded > MAX_EXPANDED:
            break
        for g in range(goals.shape[0]):
            if goals[g] == state:
                settled[number] = g
                number += 1
        if number == goals.shape[0]:
            break
        if number:
            expansions_left -= 1
            if expansions_left < 0:
                break
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = row + down, column + right
                if r < 0 or r >= rows or c < 0 or c >= columns or to_goal_m[r, c] == np.inf:
                    continue
                for by in range(-1, 2):
                    k = (heading_index + by) % headings
                    other = (r * columns + c) * headings + k
                    if other == state or parents[other] != 0 or clearance[other] < 0.0:
                        continue
                    if clearance[other] == 0.0:
                        b[0], b[1], b[2] = _pose(frame, other)
                        clearance[other] = _clearance(grid, capsules, reach, b, open_m[r, c], cap, margin)
                        if clearance[other] < 0.0:
                            continue
                    distance = step * math.sqrt(down * down + right * right)
                    travel_m = distance + reach * turn * abs(by)
                    length = math.sqrt(distance * distance + weight * weight * turn * turn * by * by)
                    room = min(clearance[state], clearance[other]) - margin
                    total = cost + length * (1.0 + NARROW_COST * max(0.0, 1.0 - room / COMFORT_CLEARANCE_M))
                    if costs[other] > 0.0 and total >= costs[other]:
                        continue
                    is_known = clearance[state] + clearance[other] - 2.0 * margin >= travel_m
                    if is_known:
                        costs[other] = total
                    rest = to_goal_m[r, c]
                    if goals.shape[0] == 1:
                        steps_off = abs(k - goals[0] % headings)
                        off = weight * turn * min(steps_off, headings - steps_off)
                        rest = math.sqrt(rest * rest + off * off)
                    heapq.heappush(queue, (total + HEURISTIC_WEIGHT * rest, total, other, state + 1, is_known))
    return settled[:number], reached


@kernel
def _clearance(
    grid: Grid, capsules: Floats, reach: float, pose: Floats, point_m: float, cap: float, margin: float
) -> float:
    """Clearance [m] up to `cap` of a body whose origin is `point_m` from the nearest obstacle; -1 if it is less than
    the margin."""
    if point_m - reach >= cap:
        return cap
    found = body_clearance(grid, capsules, pose[0], pose[1], pose[2], cap)
    return found if found >= margin else -1.0


@kernel
def _wrapped(angle: float) -> float:
    """The same angle between -pi and pi [rad]."""
    return angle - math.tau * math.floor(angle / math.tau + 0.5)


@kernel
def _motion_cost(a: Floats, b: Floats, weight: float) -> float:
    """Cost of the straight motion between two poses [m], without the cost of narrow places."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (weight * (b[2] - a[2])) ** 2)


@kernel
def _shorten(
    grid: Grid, capsules: Floats, reach: float, margin: float, preferred: float, weight: float, route: Floats
) -> Floats:
    route = _skip(grid, capsules, reach, margin, preferred, route)
    seed = 12345
    cap = 2.0 * preferred + 0.2
    a, b = np.empty(3), np.empty(3)
    for _ in range(SHORTCUTS):
        last = route.shape[0] - 1
        if last < 2:
            break
        # Two points on different lines, pseudo-random and the same on every computer.
        seed = (seed * 1103515245 + 12345) % 2147483648
        i = seed // 65536 % last
        seed = (seed * 1103515245 + 12345) % 2147483648
        j = seed // 65536 % last
        seed = (seed * 1103515245 + 12345) % 2147483648
        s = (seed // 65536 % 1000) / 1000.0
        seed = (seed * 1103515245 + 12345) % 2147483648
        t = (seed // 65536 % 1000) / 1000.0
        if i >= j:
            continue
        a[:] = route[i] + s * (route[i + 1] - route[i])
        b[:] = route[j] + t * (route[j + 1] - route[j])
        old = _motion_cost(a, route[i + 1], weight) + _motion_cost(route[j], b, weight)
        for v in range(i + 1, j):
            old += _motion_cost(route[v], route[v + 1], weight)
        extra = 2 - (j - i)
        if old - _motion_cost(a, b, weight) < 0.02 + 0.1 * max(extra, 0):
            continue
        clear_a = body_clearance(grid, capsules, a[0], a[1], a[2], cap)
        clear_b = body_clearance(grid, capsules, b[0], b[1], b[2], cap)
        least = min(min(clear_a, clear_b), preferred)
        for v in range(i + 1, j + 1):
            least = min(least, body_clearance(grid, capsules, route[v, 0], route[v, 1], route[v, 2], preferred))
        if body_passes(grid, capsules, reach, a, b, clear_a, clear_b, max(margin, least)):
            shortened = np.empty((i + 3 + last - j, 3))
            shortened[: i + 1] = route[: i + 1]
            shortened[i + 1] = a
            shortened[i + 2] = b
            shortened[i + 3 :] = route[j + 1 :]
            route = shortened
    return _skip(grid, capsules, reach, margin, preferred, route)


@kernel
def _skip(grid: Grid, capsules: Floats, reach: float, margin: float, preferred: float, route: Floats) -> Floats:
    """The route without the poses that the body can skip: from each pose to the farthest one within its reach."""
    count = route.shape[0]
    clearance = np.empty(count)
    for i in range(count):
        clearance[i] = body_clearance(grid, capsules, route[i, 0], route[i, 1], route[i, 2], 2.0 * preferred + 0.2)
    kept = np.empty((count, 3))
    kept[0] = route[0]
    number, i = 1, 0
    while i < count - 1:
        j = count - 1
        while j > i + 1:
            least = preferred
            for v in range(i, j + 1):
                least = min(least, clearance[v])
            if body_passes(grid, capsules, reach, route[i], route[j], clearance[i], clearance[j], max(margin, least)):
                break
            j -= 1
        kept[number] = route[j]
        number += 1
        i = j
    return kept[:number]

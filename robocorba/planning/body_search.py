"""The way of a body over one floor: A* among poses (x, y, heading) of a lattice, then shortened.

The lattice is laid through the goal, so that the goal is met exactly; the start is joined to the poses around it. Ways
between neighbours are looked at only when they turn out to be of use: most of them never do.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.kernels import kernel
from robocorba.planning.body import Body, body_clearance, body_passes
from robocorba.planning.space import nearest_segment
from robocorba.spatial.grids import Floats, Grid, Longs

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

#: Between neighbours of the lattice, m, and headings in a full turn.
STEP_M, HEADINGS = 0.10, 24
#: A lattice with more poses than this is made coarser.
MOST_POSES = 30_000_000
#: A search gives up after so many poses.
MOST_LOOKED = 3_000_000
#: A way costs more where less than this is left beside the body, m ...
ROOM_M = 0.2
#: ... by so much where nothing is.
NARROW_COST = 1.0
#: What is left is taken for this much more: good ways are found sooner than the very best.
GREED = 1.5
#: A radian costs as much as this share of the body's reach.
TURN_COST = 0.5
#: Once a goal is reached, others are looked for through so many more poses.
MORE_POSES = 20_000
#: How often a shortcut is tried between two points of a way.
SHORTCUTS = 200


class Lattice(NamedTuple):
    """frame: x, y of the lower corner, heading of the first layer, step in m, columns, rows, headings; open_m (rows,
    columns): how far a point is from the nearest obstacle, up to some limit."""

    frame: Floats
    open_m: Floats


class Found(NamedTuple):
    """A way (k, 3) to a goal: its cost, of which source and to which goal it leads."""

    way: Floats
    cost: float
    source: int
    goal: int


def lay_lattice(grid: Grid, box: tuple[float, float, float, float], anchor: Floats, far_m: float) -> Lattice:
    """A lattice through the pose `anchor` within x0, y0, x1, y1; far_m: beyond this, distances don't matter."""
    x0, y0, x1, y1 = box
    step = max(STEP_M, math.sqrt((x1 - x0) * (y1 - y0) * HEADINGS / MOST_POSES))
    low_x = anchor[0] - step * math.floor((anchor[0] - x0) / step)
    low_y = anchor[1] - step * math.floor((anchor[1] - y0) / step)
    columns, rows = int((x1 - low_x) / step) + 1, int((y1 - low_y) / step) + 1
    frame = np.array([low_x, low_y, anchor[2], step, columns, rows, HEADINGS], float)
    return Lattice(frame, _open(grid, frame, far_m))


def remaining(lattice: Lattice, goals: Floats, radius_m: float) -> Floats:
    """How far it is from each point (rows, columns) to the nearest goal for a disc of that radius, inf: it can't."""
    cells = [_cell(lattice, goal) for goal in goals]
    return _remaining(lattice.frame, lattice.open_m, np.array(cells, np.int64).reshape(-1, 2), radius_m)


def find_ways(
    grid: Grid,
    body: Body,
    lattice: Lattice,
    left: Floats,
    sources: Floats,
    goals: Floats,
    margin_m: float,
) -> tuple[list[Found], Bytes]:
    """Ways that keep `margin_m` from sources (n, 4: pose, and what it costs to be there) to goals (m, 3) on the
    lattice, and which points (rows, columns) were reached. left: what `remaining` says of the goals.

    Nothing is found where more than MOST_LOOKED poses would have to be looked at."""
    frame = lattice.frame
    states = np.array([_state(lattice, goal) for goal in goals], np.int64)
    weight = TURN_COST * body.reach
    count = lattice.open_m.size * HEADINGS
    # Made here, memory that is never looked at is never taken.
    near, costs, parents = np.zeros(count, np.float32), np.zeros(count), np.zeros(count, np.int64)
    settled, reached = _search(
        grid,
        body.capsules,
        body.reach,
        margin_m,
        frame,
        lattice.open_m,
        left,
        sources,
        states,
        weight,
        near,
        costs,
        parents,
    )
    found = []
    for index in settled.tolist():
        state, poses = int(states[index]), [goals[index]]
        at = state
        while parents[at] > 0:
            at = int(parents[at]) - 1
            poses.append(_pose(frame, at))
        source = -int(parents[at]) - 1
        poses.append(sources[source, :3])
        found.append(Found(unwrapped(np.array(poses[::-1])), float(costs[state]), source, index))
    return found, reached


def shorten(grid: Grid, body: Body, way: Floats, margin_m: float, wished_m: float) -> Floats:
    """A shorter way with fewer poses, which keeps `wished_m` wherever the one before did."""
    return _shorten(grid, body.capsules, body.reach, margin_m, wished_m, TURN_COST * body.reach, way)


def unwrapped(way: Floats) -> Floats:
    """Headings that never jump; the first pose stays as it is."""
    way = way.copy()
    for i in range(1, len(way)):
        way[i, 2] = way[i - 1, 2] + math.remainder(way[i, 2] - way[i - 1, 2], math.tau)
    return way


def _cell(lattice: Lattice, pose: Floats) -> tuple[int, int]:
    x0, y0, _, step, columns, rows, _ = lattice.frame.tolist()
    column, row = round((pose[0] - x0) / step), round((pose[1] - y0) / step)
    return min(max(column, 0), int(columns) - 1), min(max(row, 0), int(rows) - 1)


def _state(lattice: Lattice, pose: Floats) -> int:
    column, row = _cell(lattice, pose)
    layer = round(math.remainder(pose[2] - lattice.frame[2], math.tau) / (math.tau / HEADINGS)) % HEADINGS
    return (row * int(lattice.frame[4]) + column) * HEADINGS + layer


def _pose(frame: Floats, state: int) -> Floats:
    point, layer = divmod(state, int(frame[6]))
    row, column = divmod(point, int(frame[4]))
    return np.array([frame[0] + column * frame[3], frame[1] + row * frame[3], frame[2] + layer * math.tau / frame[6]])


@kernel
def _open(grid: Grid, frame: Floats, most: float) -> Floats:
    columns, rows = int(frame[4]), int(frame[5])
    found = np.empty((rows, columns))
    for row in range(rows):
        for column in range(columns):
            near, _ = nearest_segment(grid, frame[0] + column * frame[3], frame[1] + row * frame[3], most)
            found[row, column] = near
    return found


@kernel
def _remaining(frame: Floats, open_m: Floats, cells: Longs, radius: float) -> Floats:
    rows, columns = open_m.shape
    left = np.full((rows, columns), np.inf)
    queue = [(0.0, 0)]
    queue.pop()
    for i in range(cells.shape[0]):
        column, row = cells[i]
        left[row, column] = 0.0
        heapq.heappush(queue, (0.0, row * columns + column))
    while queue:
        so_far, at = heapq.heappop(queue)
        row, column = at // columns, at % columns
        if so_far > left[row, column]:
            continue
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = row + down, column + right
                if 0 <= r < rows and 0 <= c < columns and open_m[r, c] >= radius:
                    total = so_far + frame[3] * math.sqrt(down * down + right * right)
                    if total < left[r, c]:
                        left[r, c] = total
                        heapq.heappush(queue, (total, r * columns + c))
    return left


@kernel
def _search(
    grid: Grid,
    capsules: Floats,
    reach: float,
    margin: float,
    frame: Floats,
    open_m: Floats,
    left: Floats,
    sources: Floats,
    goals: Longs,
    weight: float,
    near: Singles,
    costs: Floats,
    parents: Longs,
) -> tuple[Longs, Bytes]:
    """Goals reached, in this order, and points reached. Filled in for each pose: near, its clearance, 0 where that is
    not known, negative where the body has no room; costs; parents, 0 where it was not reached, -1 - source, or 1 + the
    pose before."""
    step, columns, rows, layers = frame[3], int(frame[4]), int(frame[5]), int(frame[6])
    turn = math.tau / layers
    reached = np.zeros((rows, columns), np.uint8)
    settled = np.empty(goals.shape[0], np.int64)
    number = 0
    cap = 2.0 * margin + ROOM_M + 0.15
    a, b = np.empty(3), np.empty(3)
    # Estimate, cost, pose, parent as above, and whether the way from the parent is known to be free.
    queue = [(0.0, 0.0, 0, 0, False)]
    queue.pop()

    for s in range(sources.shape[0]):
        column = math.floor((sources[s, 0] - frame[0]) / step)
        row = math.floor((sources[s, 1] - frame[1]) / step)
        layer = math.floor((sources[s, 2] - frame[2]) / turn)
        for r in range(max(row - 1, 0), min(row + 3, rows)):
            for c in range(max(column - 1, 0), min(column + 3, columns)):
                for k in range(layer - 1, layer + 3):
                    if left[r, c] == np.inf:
                        continue
                    dx, dy = frame[0] + c * step - sources[s, 0], frame[1] + r * step - sources[s, 1]
                    dh = weight * (frame[2] + k * turn - sources[s, 2])
                    cost = sources[s, 3] + math.sqrt(dx * dx + dy * dy + dh * dh)
                    state = (r * columns + c) * layers + k % layers
                    heapq.heappush(queue, (cost + GREED * left[r, c], cost, state, -1 - s, False))

    more, looked = MORE_POSES, 0
    while queue:
        _, cost, state, parent, is_free = heapq.heappop(queue)
        if parents[state] != 0:
            continue
        layer, point = state % layers, state // layers
        row, column = point // columns, point % columns
        b[0], b[1], b[2] = frame[0] + column * step, frame[1] + row * step, frame[2] + layer * turn
        if near[state] == 0.0:
            near[state] = _near(grid, capsules, reach, b, open_m[row, column], cap, margin)
        if near[state] < 0.0:
            continue
        if not is_free:
            if parent < 0:
                a[:] = sources[-1 - parent, :3]
                at_a = body_clearance(grid, capsules, a[0], a[1], a[2], cap)
            else:
                before = parent - 1
                a[0] = frame[0] + (before // layers % columns) * step
                a[1] = frame[1] + (before // layers // columns) * step
                a[2] = frame[2] + (before % layers) * turn
                at_a = near[before]
            b[2] = a[2] + _remainder(b[2] - a[2])
            if not body_passes(grid, capsules, reach, a, b, at_a, near[state], margin):
                continue
        parents[state], costs[state] = parent, cost
        reached[row, column] = 1
        looked += 1
        if looked > MOST_LOOKED:
            break
        for g in range(goals.shape[0]):
            if goals[g] == state:
                settled[number] = g
                number += 1
        if number == goals.shape[0]:
            break
        if number:
            more -= 1
            if more < 0:
                break
        for down in range(-1, 2):
            for right in range(-1, 2):
                r, c = row + down, column + right
                if r < 0 or r >= rows or c < 0 or c >= columns or left[r, c] == np.inf:
                    continue
                for by in range(-1, 2):
                    k = (layer + by) % layers
                    other = (r * columns + c) * layers + k
                    if other == state or parents[other] != 0 or near[other] < 0.0:
                        continue
                    if near[other] == 0.0:
                        b[0], b[1], b[2] = frame[0] + c * step, frame[1] + r * step, frame[2] + k * turn
                        near[other] = _near(grid, capsules, reach, b, open_m[r, c], cap, margin)
                        if near[other] < 0.0:
                            continue
                    way = step * math.sqrt(down * down + right * right)
                    moves = way + reach * turn * abs(by)
                    length = math.sqrt(way * way + weight * weight * turn * turn * by * by)
                    room = min(near[state], near[other]) - margin
                    total = cost + length * (1.0 + NARROW_COST * max(0.0, 1.0 - room / ROOM_M))
                    if costs[other] > 0.0 and total >= costs[other]:
                        continue
                    is_known = near[state] + near[other] - 2.0 * margin >= moves
                    if is_known:
                        costs[other] = total
                    rest = left[r, c]
                    if goals.shape[0] == 1:
                        layers_off = abs(k - goals[0] % layers)
                        off = weight * turn * min(layers_off, layers - layers_off)
                        rest = math.sqrt(rest * rest + off * off)
                    heapq.heappush(queue, (total + GREED * rest, total, other, state + 1, is_known))
    return settled[:number], reached


@kernel
def _near(grid: Grid, capsules: Floats, reach: float, pose: Floats, point_m: float, cap: float, margin: float) -> float:
    """Clearance up to `cap` of a body whose origin is so far from the nearest obstacle; -1 where it has no room."""
    if point_m - reach >= cap:
        return cap
    found = body_clearance(grid, capsules, pose[0], pose[1], pose[2], cap)
    return found if found >= margin else -1.0


@kernel
def _remainder(angle: float) -> float:
    return angle - math.tau * math.floor(angle / math.tau + 0.5)


@kernel
def _length(a: Floats, b: Floats, weight: float) -> float:
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (weight * (b[2] - a[2])) ** 2)


@kernel
def _shorten(
    grid: Grid, capsules: Floats, reach: float, margin: float, wished: float, weight: float, way: Floats
) -> Floats:
    way = _skip(grid, capsules, reach, margin, wished, way)
    seed = 12345
    cap = 2.0 * wished + 0.2
    a, b = np.empty(3), np.empty(3)
    for _ in range(SHORTCUTS):
        last = way.shape[0] - 1
        if last < 2:
            break
        # Two points of different lines, the same ones on every computer.
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
        a[:] = way[i] + s * (way[i + 1] - way[i])
        b[:] = way[j] + t * (way[j + 1] - way[j])
        old = _length(a, way[i + 1], weight) + _length(way[j], b, weight)
        for v in range(i + 1, j):
            old += _length(way[v], way[v + 1], weight)
        extra = 2 - (j - i)
        if old - _length(a, b, weight) < 0.02 + 0.1 * max(extra, 0):
            continue
        at_a = body_clearance(grid, capsules, a[0], a[1], a[2], cap)
        at_b = body_clearance(grid, capsules, b[0], b[1], b[2], cap)
        least = min(min(at_a, at_b), wished)
        for v in range(i + 1, j + 1):
            least = min(least, body_clearance(grid, capsules, way[v, 0], way[v, 1], way[v, 2], wished))
        if body_passes(grid, capsules, reach, a, b, at_a, at_b, max(margin, least)):
            fresh = np.empty((i + 3 + last - j, 3))
            fresh[: i + 1] = way[: i + 1]
            fresh[i + 1] = a
            fresh[i + 2] = b
            fresh[i + 3 :] = way[j + 1 :]
            way = fresh
    return _skip(grid, capsules, reach, margin, wished, way)


@kernel
def _skip(grid: Grid, capsules: Floats, reach: float, margin: float, wished: float, way: Floats) -> Floats:
    """From each pose as far ahead as the body can go straight."""
    count = way.shape[0]
    near = np.empty(count)
    for i in range(count):
        near[i] = body_clearance(grid, capsules, way[i, 0], way[i, 1], way[i, 2], 2.0 * wished + 0.2)
    kept = np.empty((count, 3))
    kept[0] = way[0]
    number, i = 1, 0
    while i < count - 1:
        j = count - 1
        while j > i + 1:
            least = wished
            for v in range(i, j + 1):
                least = min(least, near[v])
            if body_passes(grid, capsules, reach, way[i], way[j], near[i], near[j], max(margin, least)):
                break
            j -= 1
        kept[number] = way[j]
        number += 1
        i = j
    return kept[:number]

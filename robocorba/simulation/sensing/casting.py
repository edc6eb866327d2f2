"""Ray casting for all rays of a fan at once: each visible segment shortens the rays between its two ends.

The search visits grid cells from the sensor outwards and skips cells that no ray reaches any more, so occluded cells
cost almost nothing. Distances are exact intersections; nothing is sampled.

Only `cast` calls other kernels with array arguments: such calls count references to all arrays, which took a quarter to
a third of a scan.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid, column_of, row_of
from robocorba.system.kernels import inner_kernel, kernel

#: Maximum error of `direction` [rad].
SLACK_RAD = 1e-3
#: Sine of the angle below which a segment counts as seen edge-on.
EDGE_ON = 1e-12
#: A fan of at most half a turn ignores points at least this far behind the sensor [m]; above rounding.
BEHIND_M = 1e-3
_TURN = 2 * math.pi


class Eye(NamedTuple):
    """A sensor during a scan: position [m], angle of the first ray [rad], rays per radian, range [m], and unit vector
    of the fan's middle, (0, 0) for a fan of more than half a turn."""

    x: float
    y: float
    start: float
    rays_per_rad: float
    range_m: float
    ahead_x: float
    ahead_y: float


@kernel
def direction(x: float, y: float) -> float:
    """atan2(y, x) within SLACK_RAD at a tenth of its cost; it only preselects rays.

    The polynomial for arctangents of 0 to 1 is that of https://math.stackexchange.com/a/1105038."""
    ax, ay = abs(x), abs(y)
    larger = max(ax, ay)
    if larger == 0.0:
        return 0.0
    a = min(ax, ay) / larger
    s = a * a
    angle = ((-0.0464964749 * s + 0.15931422) * s - 0.327622764) * s * a + a
    if ay > ax:
        angle = math.pi / 2 - angle
    if x < 0.0:
        angle = math.pi - angle
    return -angle if y < 0.0 else angle


@kernel
def spans(begin: float, width: float, rays_per_rad: float, count: int) -> tuple[int, int, int, int]:
    """Rays within `width` from angle `begin`, both relative to ray 0 [rad]: first and last ray of an interval, and of a
    second interval after a wrap past a full turn. An interval is empty if its last ray precedes its first."""
    begin -= _TURN * math.floor(begin / _TURN)
    low, high = begin * rays_per_rad, (begin + width) * rays_per_rad
    first = math.ceil(low) if low < count else count
    last = math.floor(high) if high < count else count - 1
    over = high - _TURN * rays_per_rad
    if over < 0.0:
        return int(first), int(last), 0, -1
    return int(first), int(last), 0, int(min(over, first - 1.0, count - 1.0))


@kernel
def shorten(grid: Grid, cell: int, visited: Longs, scan: int, eye: Eye, rays: Floats) -> None:
    """Shorten rays (3, n) to the segments of a cell; `visited` skips segments already tested in another cell.

    Ray k has the direction (rays[0, k], rays[1, k]) and the length rays[2, k]."""
    count = rays.shape[1]
    for at in range(grid.start[cell], grid.start[cell + 1]):
        i = grid.items[at]
        if visited[i] == scan:
            continue
        visited[i] = scan
        px, py = grid.segments[i, 0] - eye.x, grid.segments[i, 1] - eye.y
        qx, qy = grid.segments[i, 2] - eye.x, grid.segments[i, 3] - eye.y
        if (
            min(px, qx) >= eye.range_m
            or max(px, qx) <= -eye.range_m
            or min(py, qy) >= eye.range_m
            or max(py, qy) <= -eye.range_m
            or max(eye.ahead_x * px + eye.ahead_y * py, eye.ahead_x * qx + eye.ahead_y * qy) < -BEHIND_M
        ):
            continue
        dx, dy = qx - px, qy - py
        cross = px * dy - py * dx
        if cross < 0.0:
            px, py, qx, qy = qx, qy, px, py
            dx, dy, cross = -dx, -dy, -cross
        near, far = px * px + py * py, qx * qx + qy * qy
        is_edge_on = cross <= EDGE_ON * max(near, far)
        if is_edge_on:
            if px * qx + py * qy <= 0.0:  # the sensor is on it
                for k in range(count):
                    rays[2, k] = 0.0
                continue
            if far < near:
                px, py, near = qx, qy, far
            begin, width = direction(px, py), 0.0
        else:
            begin = direction(px, py)
            width = direction(qx, qy) - begin
            if width < -SLACK_RAD * 2:
                width += _TURN
        begin, width = begin - eye.start - SLACK_RAD, max(width, 0.0) + 2 * SLACK_RAD
        first, last, first2, last2 = spans(begin, width, eye.rays_per_rad, count)
        distance = math.sqrt(near)
        for _ in range(2):
            if is_edge_on:
                for k in range(first, last + 1):
                    if abs(px * rays[1, k] - py * rays[0, k]) <= EDGE_ON * 10 * distance:
                        rays[2, k] = min(rays[2, k], distance)
            else:
                while first <= last and px * rays[1, first] - py * rays[0, first] < 0.0:
                    first += 1
                while first <= last and rays[0, last] * qy - rays[1, last] * qx < 0.0:
                    last -= 1
                for k in range(first, last + 1):
                    rays[2, k] = min(rays[2, k], cross / (rays[0, k] * dy - rays[1, k] * dx))
            if last2 < 0:
                break
            first, last = first2, last2
            last2 = -1


@inner_kernel
def shorten_by_disc(px: float, py: float, radius: float, eye: Eye, rays: Floats) -> None:
    """Shorten rays (3, n) to a disc around p."""
    square = px * px + py * py
    if square <= radius * radius:
        rays[2] = 0.0
        return
    half = min(radius / math.sqrt(square), 1.0) * (math.pi / 2) + SLACK_RAD  # an upper bound of the arc sine
    first, last, first2, last2 = spans(direction(px, py) - eye.start - half, 2 * half, eye.rays_per_rad, rays.shape[1])
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            along = px * rays[0, k] + py * rays[1, k]
            inside = radius * radius - (square - along * along)
            if along > 0.0 and inside >= 0.0:
                rays[2, k] = min(rays[2, k], along - math.sqrt(inside))


@inner_kernel
def is_hidden(lx: float, ly: float, hx: float, hy: float, eye: Eye, rays: Floats) -> bool:
    """Whether no ray (3, n) reaches the box from (lx, ly) to (hx, hy), relative to the sensor and outside of it."""
    if max(eye.ahead_x * lx, eye.ahead_x * hx) + max(eye.ahead_y * ly, eye.ahead_y * hy) < -BEHIND_M:
        return True
    dx, dy = max(lx, -hx, 0.0), max(ly, -hy, 0.0)
    distance = math.sqrt(dx * dx + dy * dy)
    if distance >= eye.range_m:
        return True
    if lx > 0.0:
        bx, by, ex, ey = (hx, ly, lx, hy) if ly > 0.0 else ((lx, ly, hx, hy) if hy < 0.0 else (lx, ly, lx, hy))
    elif hx < 0.0:
        bx, by, ex, ey = (hx, hy, lx, ly) if ly > 0.0 else ((lx, hy, hx, ly) if hy < 0.0 else (hx, hy, hx, ly))
    else:
        bx, by, ex, ey = (hx, ly, lx, ly) if ly > 0.0 else (lx, hy, hx, hy)
    begin = direction(bx, by)
    width = direction(ex, ey) - begin
    if width < 0.0:
        width += _TURN
    begin, width = begin - eye.start - SLACK_RAD, width + 2 * SLACK_RAD
    first, last, first2, last2 = spans(begin, width, eye.rays_per_rad, rays.shape[1])
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            if rays[2, k] > distance:
                return False
    return True


class ObstacleGrids(NamedTuple):
    """Obstacles of a floor: static segments, moving segments, and the robots' discs (n, 4) of x, y, radius [m] and
    number, indexed as in Grid by `disc_start` and `disc_items`. All three grids share one frame."""

    static: Grid
    moving: Grid
    discs: Floats
    disc_start: Longs
    disc_items: Longs


@kernel
def cast(
    obstacles: ObstacleGrids,
    poses: Floats,
    own_robots: Longs,
    cosines: Floats,
    sines: Floats,
    first: float,
    step: float,
    range_m: float,
) -> Floats:
    """Distances (m, rays) [m]; `range_m` for a ray that hits nothing.

    poses: (m, 3) of the sensors. own_robots: (m,) numbers of the robots that they are mounted on, whose discs they
    ignore. cosines, sines: of the rays in the sensor's frame; ray k points to first + k * step, with a positive step
    [rad]."""
    static, moving, discs = obstacles.static, obstacles.moving, obstacles.discs
    frame = static.frame
    x0, y0, size, columns, rows = frame[0], frame[1], frame[2], int(frame[3]), int(frame[4])
    count = len(cosines)
    distances = np.empty((len(poses), count))
    visited = np.full(len(static.segments), -1, np.int64)
    visited_moving = np.full(len(moving.segments), -1, np.int64)
    visited_discs = np.full(len(discs), -1, np.int64)
    rays = np.empty((3, count))
    rays_per_rad, middle = 1.0 / step, first + (count - 1) * step / 2
    for scan in range(len(poses)):
        x, y, heading = poses[scan, 0], poses[scan, 1], poses[scan, 2]
        ch, sh = math.cos(heading), math.sin(heading)
        for k in range(count):
            rays[0, k] = ch * cosines[k] - sh * sines[k]
            rays[1, k] = sh * cosines[k] + ch * sines[k]
            rays[2, k] = range_m
        # A fan of at most half a turn sees nothing behind the sensor.
        is_narrow = (count - 1) * step <= math.pi + 1e-9
        ahead_x = math.cos(heading + middle) if is_narrow else 0.0
        ahead_y = math.sin(heading + middle) if is_narrow else 0.0
        eye = Eye(x, y, heading + first, rays_per_rad, range_m, ahead_x, ahead_y)
        column, row = column_of(frame, x), row_of(frame, y)
        first_far = 0  # rays before this one end within the rings visited so far
        for ring in range(max(columns, rows)):
            if ring > 0:  # this ring and all beyond lie outside a square around the sensor
                left, right = x - (x0 + (column - ring + 1) * size), x0 + (column + ring) * size - x
                below, above = y - (y0 + (row - ring + 1) * size), y0 + (row + ring) * size - y
                outside = min(left, right, below, above)
                while first_far < count and rays[2, first_far] <= outside:
                    first_far += 1
                if first_far == count:
                    break
            for cell_row in range(max(0, row - ring), min(rows - 1, row + ring) + 1):
                stride = 1 if ring == 0 or abs(cell_row - row) == ring else 2 * ring
                for cell_column in range(column - ring, column + ring + 1, stride):
                    if not 0 <= cell_column < columns:
                        continue
                    cell = cell_row * columns + cell_column
                    if (
                        static.start[cell] == static.start[cell + 1]
                        and moving.start[cell] == moving.start[cell + 1]
                        and obstacles.disc_start[cell] == obstacles.disc_start[cell + 1]
                    ):
                        continue
                    if ring > 0:
                        lx, ly = x0 + cell_column * size - x, y0 + cell_row * size - y
                        if is_hidden(lx, ly, lx + size, ly + size, eye, rays):
                            continue
                    shorten(static, cell, visited, scan, eye, rays)
                    shorten(moving, cell, visited_moving, scan, eye, rays)
                    for at in range(obstacles.disc_start[cell], obstacles.disc_start[cell + 1]):
                        i = obstacles.disc_items[at]
                        if visited_discs[i] != scan:
                            visited_discs[i] = scan
                            px, py, radius, number = discs[i, 0] - x, discs[i, 1] - y, discs[i, 2], discs[i, 3]
                            reach = range_m + radius
                            if number != own_robots[scan] and px * px + py * py < reach * reach:
                                shorten_by_disc(px, py, radius, eye, rays)
        for k in range(count):
            distances[scan, k] = rays[2, k]
    return distances

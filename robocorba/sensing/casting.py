"""Rays, all of a fan at once: each segment in sight shortens the rays between its two ends.

Cells are looked at from the sensor outwards. One that no ray of its directions reaches any more is passed over,
so that what is behind walls costs next to nothing. Distances are those to lines met exactly; nothing is sampled.

Of the kernels here, only `cast` calls others that take arrays. Those that do count references to all of their arrays up
and down in each call, which took a quarter to a third of a scan.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robocorba.kernels import kernel
from robocorba.spatial.grids import Floats, Grid, Longs, column_of, row_of

#: `direction` is off by no more than this, rad.
SLACK_RAD = 1e-3
#: Sine of the angle below which a segment is seen from its end.
EDGE_ON = 1e-12
#: What is at least so far behind the sensor, m, is not in sight of a fan of half a turn, however it was rounded.
BEHIND_M = 1e-3
_TURN = 2 * math.pi


class Eye(NamedTuple):
    """A sensor: where it is, m; the angle of its first ray, rad; rays to a radian; how far it sees, m; the direction in
    which it looks, (0, 0) for a fan of more than half a turn."""

    x: float
    y: float
    start: float
    rays_a_rad: float
    range_m: float
    ahead_x: float
    ahead_y: float


@kernel
def direction(x: float, y: float) -> float:
    """atan2(y, x) within SLACK_RAD, at a tenth of its cost: it only says where to look."""
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
def spans(begin: float, width: float, rays_a_rad: float, count: int) -> tuple[int, int, int, int]:
    """The rays from angle `begin` over `width`, both counted from ray 0: first and last of one stretch, and of
    another where the directions go on past a full turn. A stretch is empty where its last comes before its first."""
    begin -= _TURN * math.floor(begin / _TURN)
    low, high = begin * rays_a_rad, (begin + width) * rays_a_rad
    first = math.ceil(low) if low < count else count
    last = math.floor(high) if high < count else count - 1
    over = high - _TURN * rays_a_rad
    if over < 0.0:
        return int(first), int(last), 0, -1
    return int(first), int(last), 0, int(min(over, first - 1.0, count - 1.0))


@kernel
def shorten(grid: Grid, cell: int, seen: Longs, scan: int, eye: Eye, rays: Floats) -> None:
    """Let rays (3, n) end at the segments of a cell, those that other cells hold as well only once.

    Ray k has the direction (rays[0, k], rays[1, k]) and ends after rays[2, k]."""
    count = rays.shape[1]
    for at in range(grid.start[cell], grid.start[cell + 1]):
        i = grid.items[at]
        if seen[i] == scan:
            continue
        seen[i] = scan
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
        first, last, first2, last2 = spans(begin, width, eye.rays_a_rad, count)
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


@kernel
def shorten_by_disc(px: float, py: float, radius: float, eye: Eye, rays: Floats) -> None:
    """Let rays (3, n) end at a disc around p."""
    square = px * px + py * py
    if square <= radius * radius:
        rays[2] = 0.0
        return
    half = min(radius / math.sqrt(square), 1.0) * (math.pi / 2) + SLACK_RAD  # no less than its arc sine
    first, last, first2, last2 = spans(direction(px, py) - eye.start - half, 2 * half, eye.rays_a_rad, rays.shape[1])
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            along = px * rays[0, k] + py * rays[1, k]
            inside = radius * radius - (square - along * along)
            if along > 0.0 and inside >= 0.0:
                rays[2, k] = min(rays[2, k], along - math.sqrt(inside))


@kernel
def is_hidden(lx: float, ly: float, hx: float, hy: float, eye: Eye, rays: Floats) -> bool:
    """Whether no ray (3, n) reaches the box from (lx, ly) to (hx, hy), which lies beside the sensor."""
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
    first, last, first2, last2 = spans(begin, width, eye.rays_a_rad, rays.shape[1])
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            if rays[2, k] > distance:
                return False
    return True


class Scene(NamedTuple):
    """What there is on a floor: standing and moving segments, and discs (n, 4) of robots as x, y, radius and number,
    with the cells they are in. All three grids have one frame."""

    standing: Grid
    moving: Grid
    discs: Floats
    disc_start: Longs
    disc_items: Longs


@kernel
def cast(
    scene: Scene,
    poses: Floats,
    owners: Longs,
    cosines: Floats,
    sines: Floats,
    first: float,
    step: float,
    range_m: float,
) -> Floats:
    """Distances (poses, rays), m, `range_m` where nothing is met.

    poses: (m, 3) of sensors; owners: (m,) numbers of the robots whose own discs they don't see. cosines, sines: of the
    rays in the sensor's frame, whose ray k points to first + k * step, with a positive step."""
    standing, moving, discs = scene.standing, scene.moving, scene.discs
    frame = standing.frame
    x0, y0, size, columns, rows = frame[0], frame[1], frame[2], int(frame[3]), int(frame[4])
    count = len(cosines)
    found = np.empty((len(poses), count))
    seen = np.full(len(standing.segments), -1, np.int64)
    seen_moving = np.full(len(moving.segments), -1, np.int64)
    seen_discs = np.full(len(discs), -1, np.int64)
    rays = np.empty((3, count))
    rays_a_rad, middle = 1.0 / step, first + (count - 1) * step / 2
    for scan in range(len(poses)):
        x, y, heading = poses[scan, 0], poses[scan, 1], poses[scan, 2]
        ch, sh = math.cos(heading), math.sin(heading)
        for k in range(count):
            rays[0, k] = ch * cosines[k] - sh * sines[k]
            rays[1, k] = sh * cosines[k] + ch * sines[k]
            rays[2, k] = range_m
        # Of a fan of at most half a turn, nothing behind the sensor is in sight.
        is_narrow = (count - 1) * step <= math.pi + 1e-9
        ahead_x = math.cos(heading + middle) if is_narrow else 0.0
        ahead_y = math.sin(heading + middle) if is_narrow else 0.0
        eye = Eye(x, y, heading + first, rays_a_rad, range_m, ahead_x, ahead_y)
        column, row = column_of(frame, x), row_of(frame, y)
        farther = 0  # no ray before this one reaches farther than the last ring
        for ring in range(max(columns, rows)):
            if ring > 0:  # what is in this ring and beyond lies outside a square around the sensor
                left, right = x - (x0 + (column - ring + 1) * size), x0 + (column + ring) * size - x
                below, above = y - (y0 + (row - ring + 1) * size), y0 + (row + ring) * size - y
                outside = min(left, right, below, above)
                while farther < count and rays[2, farther] <= outside:
                    farther += 1
                if farther == count:
                    break
            for at_row in range(max(0, row - ring), min(rows - 1, row + ring) + 1):
                stride = 1 if ring == 0 or abs(at_row - row) == ring else 2 * ring
                for at_column in range(column - ring, column + ring + 1, stride):
                    if not 0 <= at_column < columns:
                        continue
                    cell = at_row * columns + at_column
                    if (
                        standing.start[cell] == standing.start[cell + 1]
                        and moving.start[cell] == moving.start[cell + 1]
                        and scene.disc_start[cell] == scene.disc_start[cell + 1]
                    ):
                        continue
                    if ring > 0:
                        lx, ly = x0 + at_column * size - x, y0 + at_row * size - y
                        if is_hidden(lx, ly, lx + size, ly + size, eye, rays):
                            continue
                    shorten(standing, cell, seen, scan, eye, rays)
                    shorten(moving, cell, seen_moving, scan, eye, rays)
                    for at in range(scene.disc_start[cell], scene.disc_start[cell + 1]):
                        i = scene.disc_items[at]
                        if seen_discs[i] != scan:
                            seen_discs[i] = scan
                            px, py, radius, number = discs[i, 0] - x, discs[i, 1] - y, discs[i, 2], discs[i, 3]
                            reach = range_m + radius
                            if number != owners[scan] and px * px + py * py < reach * reach:
                                shorten_by_disc(px, py, radius, eye, rays)
        for k in range(count):
            found[scan, k] = rays[2, k]
    return found

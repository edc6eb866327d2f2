"""Rays, all of a fan at once: each segment in sight shortens the rays between its two ends.

Cells are looked at from the sensor outwards. One that no ray of its directions reaches any more is passed over,
so that what is behind walls costs next to nothing. Distances are those to lines met exactly; nothing is sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robocorba.grids import Floats, Grid, Longs, column_of, row_of
from robocorba.kernels import kernel

#: `direction` is off by no more than this, rad.
SLACK_RAD = 1e-3
#: Sine of the angle below which a segment is seen from its end.
EDGE_ON = 1e-12
_TURN = 2 * math.pi


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
def spans(begin: float, width: float, step: float, count: int) -> tuple[int, int, int, int]:
    """The rays from angle `begin` over `width`, both counted from ray 0: first and last of one stretch, and of
    another where the directions go on past a full turn. A stretch is empty where its last comes before its first."""
    begin -= _TURN * math.floor(begin / _TURN)
    end = begin + width
    first = math.ceil(begin / step) if begin / step < count else count
    last = count - 1 if end / step >= count else math.floor(end / step)
    over = end - _TURN
    if over < 0.0:
        return int(first), int(last), 0, -1
    return int(first), int(last), 0, int(min(over / step, first - 1.0, count - 1.0))


@kernel
def shorten(
    px: float, py: float, qx: float, qy: float, start: float, step: float, c: Floats, s: Floats, best: Floats
) -> None:
    """Let rays end at the segment from p to q, both relative to the sensor; ray k points to (c[k], s[k])."""
    count = len(best)
    dx, dy = qx - px, qy - py
    cross = px * dy - py * dx
    if cross < 0.0:
        px, py, qx, qy = qx, qy, px, py
        dx, dy, cross = -dx, -dy, -cross
    reach = max(px * px + py * py, qx * qx + qy * qy)
    if cross <= EDGE_ON * reach:
        _shorten_edge_on(px, py, qx, qy, start, step, c, s, best)
        return
    begin, end = direction(px, py), direction(qx, qy)
    width = end - begin
    if width < -SLACK_RAD * 2:
        width += _TURN
    first, last, first2, last2 = spans(begin - start - SLACK_RAD, max(width, 0.0) + 2 * SLACK_RAD, step, count)
    for _ in range(2):
        while first <= last and px * s[first] - py * c[first] < 0.0:
            first += 1
        while first <= last and c[last] * qy - s[last] * qx < 0.0:
            last -= 1
        for k in range(first, last + 1):
            t = cross / (c[k] * dy - s[k] * dx)
            if t < best[k]:
                best[k] = t
        if last2 < 0:
            return
        first, last = first2, last2
        last2 = -1


@kernel
def _shorten_edge_on(
    px: float, py: float, qx: float, qy: float, start: float, step: float, c: Floats, s: Floats, best: Floats
) -> None:
    """A segment seen from its end stops the ray along it, if there is one, where it begins."""
    if px * qx + py * qy <= 0.0:  # the sensor is on it
        for k in range(len(best)):
            best[k] = 0.0
        return
    if qx * qx + qy * qy < px * px + py * py:
        px, py = qx, qy
    distance = math.hypot(px, py)
    first, last, first2, last2 = spans(direction(px, py) - start - SLACK_RAD, 2 * SLACK_RAD, step, len(best))
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            if abs(px * s[k] - py * c[k]) <= EDGE_ON * 10 * distance and distance < best[k]:
                best[k] = distance


@kernel
def shorten_by_disc(
    px: float, py: float, radius: float, start: float, step: float, c: Floats, s: Floats, best: Floats
) -> None:
    """Let rays end at a disc around p."""
    square = px * px + py * py
    if square <= radius * radius:
        for k in range(len(best)):
            best[k] = 0.0
        return
    half = min(radius / math.sqrt(square), 1.0) * (math.pi / 2) + SLACK_RAD  # no less than its arc sine
    first, last, first2, last2 = spans(direction(px, py) - start - half, 2 * half, step, len(best))
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            along = px * c[k] + py * s[k]
            inside = radius * radius - (square - along * along)
            if along > 0.0 and inside >= 0.0:
                t = along - math.sqrt(inside)
                if t < best[k]:
                    best[k] = t


@kernel
def is_hidden(lx: float, ly: float, hx: float, hy: float, start: float, step: float, best: Floats) -> bool:
    """Whether no ray reaches the box from (lx, ly) to (hx, hy), which lies beside the sensor."""
    if lx > 0.0:
        bx, by, ex, ey = (hx, ly, lx, hy) if ly > 0.0 else ((lx, ly, hx, hy) if hy < 0.0 else (lx, ly, lx, hy))
        dx = lx
    elif hx < 0.0:
        bx, by, ex, ey = (hx, hy, lx, ly) if ly > 0.0 else ((lx, hy, hx, ly) if hy < 0.0 else (hx, hy, hx, ly))
        dx = -hx
    else:
        bx, by, ex, ey = (hx, ly, lx, ly) if ly > 0.0 else (lx, hy, hx, hy)
        dx = 0.0
    dy = ly if ly > 0.0 else (-hy if hy < 0.0 else 0.0)
    distance = math.sqrt(dx * dx + dy * dy)
    begin = direction(bx, by)
    width = direction(ex, ey) - begin
    if width < 0.0:
        width += _TURN
    first, last, first2, last2 = spans(begin - start - SLACK_RAD, width + 2 * SLACK_RAD, step, len(best))
    for low, high in ((first, last), (first2, last2)):
        for k in range(low, high + 1):
            if best[k] > distance:
                return False
    return True


@kernel
def shorten_all(
    grid: Grid,
    cell: int,
    seen: Longs,
    scan: int,
    x: float,
    y: float,
    range_m: float,
    start: float,
    step: float,
    c: Floats,
    s: Floats,
    best: Floats,
) -> None:
    """Let rays end at the segments of a cell, those that other cells hold as well only once."""
    for at in range(grid.start[cell], grid.start[cell + 1]):
        i = grid.items[at]
        if seen[i] != scan:
            seen[i] = scan
            ax, ay, bx, by = grid.segments[i]
            px, py, qx, qy = ax - x, ay - y, bx - x, by - y
            is_near = min(px, qx) < range_m and max(px, qx) > -range_m
            if is_near and min(py, qy) < range_m and max(py, qy) > -range_m:
                shorten(px, py, qx, qy, start, step, c, s, best)


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
    frame = scene.standing.frame
    x0, y0, size, columns, rows = frame[0], frame[1], frame[2], int(frame[3]), int(frame[4])
    count = len(cosines)
    found = np.empty((len(poses), count))
    seen = np.full(len(scene.standing.segments), -1, np.int64)
    seen_moving = np.full(len(scene.moving.segments), -1, np.int64)
    seen_discs = np.full(len(scene.discs), -1, np.int64)
    c, s = np.empty(count), np.empty(count)
    for scan in range(len(poses)):
        x, y, heading = poses[scan]
        ch, sh = math.cos(heading), math.sin(heading)
        for k in range(count):
            c[k] = ch * cosines[k] - sh * sines[k]
            s[k] = sh * cosines[k] + ch * sines[k]
        best = found[scan]
        best[:] = range_m
        start = heading + first
        column, row = column_of(frame, x), row_of(frame, y)
        for ring in range(max(columns, rows)):
            if ring > 1:  # what is in this ring and beyond lies outside a square around the sensor
                left, right = x - (x0 + (column - ring + 1) * size), x0 + (column + ring) * size - x
                below, above = y - (y0 + (row - ring + 1) * size), y0 + (row + ring) * size - y
                if min(left, right, below, above) >= best.max():
                    break
            for at_row in range(max(0, row - ring), min(rows - 1, row + ring) + 1):
                stride = 1 if ring == 0 or abs(at_row - row) == ring else 2 * ring
                for at_column in range(column - ring, column + ring + 1, stride):
                    if not 0 <= at_column < columns:
                        continue
                    cell = at_row * columns + at_column
                    if (
                        scene.standing.start[cell] == scene.standing.start[cell + 1]
                        and scene.moving.start[cell] == scene.moving.start[cell + 1]
                        and scene.disc_start[cell] == scene.disc_start[cell + 1]
                    ):
                        continue
                    if ring > 0:
                        lx, ly = x0 + at_column * size - x, y0 + at_row * size - y
                        if is_hidden(lx, ly, lx + size, ly + size, start, step, best):
                            continue
                    shorten_all(scene.standing, cell, seen, scan, x, y, range_m, start, step, c, s, best)
                    shorten_all(scene.moving, cell, seen_moving, scan, x, y, range_m, start, step, c, s, best)
                    for at in range(scene.disc_start[cell], scene.disc_start[cell + 1]):
                        i = scene.disc_items[at]
                        if seen_discs[i] != scan:
                            seen_discs[i] = scan
                            px, py, radius, number = scene.discs[i]
                            px, py = px - x, py - y
                            reach = range_m + radius
                            if number != owners[scan] and px * px + py * py < reach * reach:
                                shorten_by_disc(px, py, radius, start, step, c, s, best)
    return found

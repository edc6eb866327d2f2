"""Where robots stand around an object that they carry together, and what room all of them need."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import InvalidCarry
from robocorba.planning.request import SMARTPAL_RADIUS_M
from robocorba.spatial.grids import Floats

Pose = tuple[float, float, float]

#: From the middle of a carrier's base to its hands, m.
HAND_M = 0.62
#: Two arms that hold something, m: nothing gets between a carrier and what it holds.
ARMS_WIDTH_M = 0.4
MOST_CARRIERS = 6
#: Carriers stay so far apart, m.
GAP_M = 0.02
#: A grip is so far from the corner of an edge, or a quarter of the edge where that is less, m.
FROM_CORNER_M = 0.15
#: Shorter edges offer no grips of their own, m; nor are two grips nearer to each other.
SHORTEST_EDGE_M, APART_M = 0.25, 0.1
#: Where edges offer too few, grips lie all around.
DIRECTIONS = 12
#: The middle of what is held lies at most so far from the line or polygon of its grips, m; from the only one, m.
OFF_MIDDLE_M, OFF_ONE_M = 0.15, 0.6
#: Held well is what has its middle at least this share of the best so far within the polygon of its grips.
ALMOST_BEST = 0.6
#: Sets of grips that are looked at.
MOST_SETS = 1000
#: More would be much alike.
MOST_FORMATIONS = 10


class Grip(NamedTuple):
    """A point on an object's edge, m, and where its carrier faces, rad: into the object; in the object's frame."""

    x: float
    y: float
    facing: float


class Formation(NamedTuple):
    """Carriers of an object. hand_m: from the middle of a carrier's base to its hands, which are straight ahead."""

    grips: tuple[Grip, ...]
    hand_m: float = HAND_M

    def places(self, back_m: float = 0.0) -> tuple[Pose, ...]:
        """Of the bases in the object's frame, x and y in m and heading in rad, each backed off by `back_m`."""
        away = self.hand_m + back_m
        return tuple(
            (grip.x - away * math.cos(grip.facing), grip.y - away * math.sin(grip.facing), grip.facing)
            for grip in self.grips
        )

    def footprint(self, outline: Polygon, radius_m: float = SMARTPAL_RADIUS_M) -> BaseGeometry:
        """Object, carriers and their arms, in the object's frame."""
        parts = [outline]
        for grip, (x, y, _) in zip(self.grips, self.places(), strict=True):
            parts.append(Point(x, y).buffer(radius_m, quad_segs=16))
            parts.append(LineString([(x, y), (grip.x, grip.y)]).buffer(ARMS_WIDTH_M / 2, cap_style="flat"))
        return shapely.union_all(parts)


def formations(
    outline: Polygon, count: int, radius_m: float = SMARTPAL_RADIUS_M, hand_m: float = HAND_M
) -> list[Formation]:
    """Ways in which `count` robots can hold an object whose outline is in its own frame: first those that hold it
    well, the most compact first, then those that just hold it, the narrowest first, for doors. No two of them overlap,
    nor does one and the object.

    Raises InvalidCarry."""
    if not 1 <= count <= MOST_CARRIERS:
        raise InvalidCarry("count", f"{count} robots are not between 1 and {MOST_CARRIERS}")
    if not hand_m > 0.0 or not radius_m > 0.0:
        raise InvalidCarry("radius", f"a base of {radius_m} m with hands {hand_m} m ahead")
    if outline.is_empty or not outline.is_valid or not outline.area > 0.0:
        raise InvalidCarry("outline", "the object has no area")
    grips = _grips_on_edges(outline, radius_m)
    if len(grips) < max(count, 4):
        grips += _grips_around(outline)
    grips = [grip for grip in grips if _is_clear_of(outline, Formation((grip,), hand_m), radius_m)]
    grips = _thinned(grips, count, hand_m)
    sets = list(_apart(grips, count, radius_m, hand_m))
    safety = _safety(outline, sets)
    least = -(OFF_ONE_M if count == 1 else OFF_MIDDLE_M)
    sets = [chosen for chosen, margin in zip(sets, safety, strict=True) if margin >= least]
    if not sets:
        raise InvalidCarry("count", f"{count} robots of {radius_m:g} m can't stand around it and hold it")
    safety = safety[safety >= least]
    is_safe = safety >= ALMOST_BEST * max(safety.max(), 0.0) - 1e-6
    found = [Formation(chosen, hand_m) for chosen in sets]
    areas, widths = _room(outline, found, radius_m)
    well = [found[i] for i in np.argsort(areas, kind="stable") if is_safe[i]]
    just = [found[i] for i in np.argsort(widths, kind="stable") if not is_safe[i]]
    kept = _unlike(well, [], MOST_FORMATIONS // 2 if just else MOST_FORMATIONS)
    return _unlike(just, kept, MOST_FORMATIONS)


def _grips_on_edges(outline: Polygon, radius_m: float) -> list[Grip]:
    """In the middle of each edge; where two robots fit in side by side, also there and near its ends."""
    found = []
    corners = shapely.get_coordinates(shapely.geometry.polygon.orient(outline).exterior)
    for (ax, ay), (bx, by) in pairwise(corners.tolist()):
        length = math.hypot(bx - ax, by - ay)
        if length < SHORTEST_EDGE_M:
            continue
        facing = math.atan2(by - ay, bx - ax) + math.pi / 2  # counter-clockwise: the inside is on the left
        far = length / 2 - min(FROM_CORNER_M, length / 4)
        beside = radius_m + GAP_M / 2
        offsets = [0.0]
        for offset in (far, beside) if beside <= length / 2 else ():
            if all(abs(offset - other) >= APART_M for other in offsets):
                offsets += [offset, -offset]
        for offset in sorted(offsets):
            share = 0.5 + offset / length
            found.append(Grip(ax + share * (bx - ax), ay + share * (by - ay), math.remainder(facing, math.tau)))
    return found


def _grips_around(outline: Polygon) -> list[Grip]:
    """Where rays from the middle leave the object."""
    middle, size = outline.centroid, math.hypot(*np.subtract(outline.bounds[2:], outline.bounds[:2]))
    found = []
    for i in range(DIRECTIONS):
        turn = math.tau * i / DIRECTIONS
        ray = LineString([middle, (middle.x + 2 * size * math.cos(turn), middle.y + 2 * size * math.sin(turn))])
        points = shapely.get_coordinates(ray.intersection(outline.exterior))
        if len(points):
            x, y = max(points.tolist(), key=lambda point: math.dist(point, (middle.x, middle.y)))
            found.append(Grip(x, y, math.remainder(turn + math.pi, math.tau)))
    return found


def _is_clear_of(outline: Polygon, formation: Formation, radius_m: float) -> bool:
    x, y, _ = formation.places()[0]
    return bool(outline.distance(Point(x, y)) >= radius_m)


def _thinned(grips: list[Grip], count: int, hand_m: float) -> list[Grip]:
    """As many as there is time for: of the two whose carriers are nearest to each other, the later one goes."""
    grips = list(grips)
    while math.comb(len(grips), count) > MOST_SETS:
        places = np.array(Formation(tuple(grips), hand_m).places())[:, :2]
        away = np.hypot(*(places[:, None] - places[None]).T).round(6)
        away[np.tril_indices(len(grips))] = math.inf
        del grips[int(np.unravel_index(away.argmin(), away.shape)[1])]
    return grips


def _apart(grips: list[Grip], count: int, radius_m: float, hand_m: float) -> Iterator[tuple[Grip, ...]]:
    """Sets of grips whose carriers don't overlap."""
    places = np.array(Formation(tuple(grips), hand_m).places()).reshape(-1, 3)[:, :2]
    away = np.hypot(*(places[:, None] - places[None]).T)
    beside = away >= 2 * radius_m + GAP_M - 1e-9
    for chosen in combinations(range(len(grips)), count):
        if all(beside[i, j] for i, j in combinations(chosen, 2)):
            yield tuple(grips[i] for i in chosen)


def _safety(outline: Polygon, sets: list[tuple[Grip, ...]]) -> Floats:
    """How far the middle of the object is within the polygon of the grips, m; outside, or for two grips: negative."""
    hulls = _hulls(np.array(sets)[:, :, :2]) if sets else np.empty(0, object)
    off = shapely.distance(hulls, outline.centroid)
    within = shapely.distance(shapely.boundary(hulls), outline.centroid)
    return np.where((off > 0.0) | (shapely.area(hulls) == 0.0), -off, within)


def _hulls(points: Floats) -> NDArray[np.object_]:
    """The convex hull of each set of points (n, m, 2)."""
    which = np.repeat(np.arange(len(points)), points.shape[1])
    return shapely.convex_hull(shapely.multipoints(points.reshape(-1, 2), indices=which))


def _room(outline: Polygon, found: list[Formation], radius_m: float) -> tuple[Floats, Floats]:
    """The area that each formation takes, m², and how narrow it is, m; rounded, so that the order of the edges decides
    between those that are alike."""
    corners = shapely.get_coordinates(outline)
    turns = np.linspace(0.0, math.tau, 16, endpoint=False)
    disc = radius_m * np.column_stack([np.cos(turns), np.sin(turns)])
    middles = np.array([formation.places() for formation in found])[:, :, :2]
    discs = (middles[:, :, None] + disc).reshape(len(found), -1, 2)
    every = np.concatenate([discs, np.broadcast_to(corners, (len(found), *corners.shape))], axis=1)
    widths = np.ptp(every @ _across(), axis=1).min(axis=1)
    return shapely.area(_hulls(every)).round(6), widths.round(6)


def width_of(shape: BaseGeometry) -> float:
    """Of the narrowest straight gap that it passes without turning, m."""
    return float(np.ptp(shapely.get_coordinates(shape.convex_hull) @ _across(), axis=0).min())


def _across() -> Floats:
    turns = np.linspace(0.0, math.pi, 72, endpoint=False)
    return np.array([np.cos(turns), np.sin(turns)])


def _unlike(found: list[Formation], kept: list[Formation], most: int) -> list[Formation]:
    """`kept` and the first of those found, without any that is nearly the same as an earlier one."""
    kept = list(kept)
    for formation in found:
        if len(kept) == most:
            break
        if all(_difference(formation, other) >= 2 * FROM_CORNER_M for other in kept):
            kept.append(formation)
    return kept


def _difference(one: Formation, other: Formation) -> float:
    """How far the carrier that differs most is from any of the other formation, m."""
    here, there = np.array(one.places())[:, :2], np.array(other.places())[:, :2]
    return float(np.hypot(*(here[:, None] - there[None]).T).min(axis=0).max())

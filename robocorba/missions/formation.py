"""Formations of the carriers around an object, and their footprints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import InvalidPlan
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Distance from the centre of a carrier's base to its hands [m].
HAND_M = 0.62
#: Distance at which robots gather behind their places, from which they approach straight, and that they back off [m].
BACK_OFF_M = 0.3
#: Minimum clearance of object, carriers and arms [m].
MARGIN_M = 0.05
#: Width of both arms of a carrier in its footprint [m]: no obstacle fits between a carrier and the object.
ARMS_WIDTH_M = 0.4
#: Minimum gap between carriers [m].
GAP_M = 0.02
#: Distance of a grip point from the corner of an edge [m]; a quarter of the edge if that is less.
CORNER_DISTANCE_M = 0.15
#: Maximum distance of the centroid from the line or polygon of the grip points, and from a single grip point [m].
MAX_OFFSET_M, MAX_OFFSET_ONE_GRIP_M = 0.15, 0.6


class GripPoint(NamedTuple):
    """A point on an object's edge [m] and the heading of its carrier, into the object [rad]; in the object's frame."""

    x: float
    y: float
    facing: float


class Formation(NamedTuple):
    """Carriers of an object, by their grip points."""

    grips: tuple[GripPoint, ...]

    def carrier_poses(self, back_m: float = 0.0) -> tuple[Pose2D, ...]:
        """Poses of the carriers' bases in the object's frame [m, rad], each backed off by `back_m`."""
        away = HAND_M + back_m
        return tuple(
            (grip.x - away * math.cos(grip.facing), grip.y - away * math.sin(grip.facing), grip.facing)
            for grip in self.grips
        )

    @classmethod
    def of_carriers(cls, poses: Iterable[Pose2D]) -> Formation:
        """The inverse of `carrier_poses`."""
        return cls(
            tuple(GripPoint(x + HAND_M * math.cos(turn), y + HAND_M * math.sin(turn), turn) for x, y, turn in poses)
        )

    def gap_m(self) -> float:
        """Least gap between two of its carriers [m]."""
        poses = self.carrier_poses()
        return min((math.dist(a[:2], b[:2]) for a, b in combinations(poses, 2)), default=math.inf) - 2 * RADIUS_M

    def enough(self, outline: Polygon, mass_kg: float, payload_kg: float) -> list[tuple[int, ...]]:
        """The smallest groups of its carriers, by number, that hold an object without the others: each carries at most
        `payload_kg`, and the centroid is near their grip points."""
        found: list[tuple[int, ...]] = []
        for count in range(1, len(self.grips)):
            for group in combinations(range(len(self.grips)), count):
                grips = tuple(self.grips[number] for number in group)
                is_safe = _safety(outline, [grips])[0] >= _least_safety(count)
                if (
                    is_safe
                    and count * payload_kg >= mass_kg - 1e-9
                    and not any(set(less) <= set(group) for less in found)
                ):
                    found.append(group)
        return found

    def footprint(self, outline: Polygon, back_m: float = 0.0) -> BaseGeometry:
        """Object, carriers backed off by `back_m`, and their arms, in the object's frame."""
        parts = [outline]
        for grip, (x, y, _) in zip(self.grips, self.carrier_poses(back_m), strict=True):
            parts.append(Point(x, y).buffer(RADIUS_M, quad_segs=16))
            parts.append(LineString([(x, y), (grip.x, grip.y)]).buffer(ARMS_WIDTH_M / 2, cap_style="flat"))
        return shapely.union_all(parts)


def formations(outline: Polygon, count: int) -> list[Formation]:
    """At most ten formations of `count` robots around an object, whose outline is in its own frame: first the safe
    ones, by compactness, those with roomy gaps before others; then the less safe ones, by width, for doors. Carriers
    overlap neither each other nor the object.

    Raises InvalidPlan."""
    if not 1 <= count <= 6:
        raise InvalidPlan("count", f"{count} robots would be needed; at most 6 carry together")
    if outline.is_empty or not outline.is_valid or not outline.area > 0.0:
        raise InvalidPlan("outline", "the object's outline is invalid or has no area")
    grips = _grips_on_edges(outline)
    if len(grips) < max(count, 4):
        grips += _grips_around(outline)
    grips = [grip for grip in grips if _is_clear_of(outline, grip)]
    grips = _thinned_out(grips, count)
    sets = list(_non_overlapping(grips, count))
    safety = _safety(outline, sets)
    least = _least_safety(count)
    sets = [chosen for chosen, margin in zip(sets, safety, strict=True) if margin >= least]
    if not sets:
        raise InvalidPlan(
            "count", f"{count} robots of {RADIUS_M:g} m find no places around it from which they can hold it"
        )
    safety = safety[safety >= least]
    is_safe = safety >= 0.6 * max(safety.max(), 0.0) - 1e-6  # almost as safe as the safest one
    found = [Formation(chosen) for chosen in sets]
    areas, widths = _area_and_width(outline, found)
    # With 12 cm between them, a carrier that dies brakes before the others know.
    is_tight = np.array([formation.gap_m() < 0.12 for formation in found])
    safe = [found[i] for i in np.lexsort((areas, is_tight)) if is_safe[i]]
    less_safe = [found[i] for i in np.argsort(widths, kind="stable") if not is_safe[i]]
    kept = _distinct(safe, [], 5 if less_safe else 10)
    return _distinct(less_safe, kept, 10)


def _grips_on_edges(outline: Polygon) -> list[GripPoint]:
    """Grip points in the middle of each edge and, if two robots fit side by side, beside it and near both ends."""
    found = []
    corners = shapely.get_coordinates(shapely.geometry.polygon.orient(outline).exterior)
    for (ax, ay), (bx, by) in pairwise(corners.tolist()):
        length = math.hypot(bx - ax, by - ay)
        if length < 0.25:  # m; too short for both hands
            continue
        facing = math.atan2(by - ay, bx - ax) + math.pi / 2  # counter-clockwise: the inside is on the left
        far = length / 2 - min(CORNER_DISTANCE_M, length / 4)
        beside = RADIUS_M + GAP_M / 2
        offsets = [0.0]
        for offset in (far, beside) if beside <= length / 2 else ():
            if all(abs(offset - other) >= 0.1 for other in offsets):  # m; nearer ones would be similar
                offsets += [offset, -offset]
        for offset in sorted(offsets):
            share = 0.5 + offset / length
            found.append(GripPoint(ax + share * (bx - ax), ay + share * (by - ay), math.remainder(facing, math.tau)))
    return found


def _grips_around(outline: Polygon) -> list[GripPoint]:
    """Grip points where rays from the centroid leave the object."""
    middle, size = outline.centroid, math.hypot(*np.subtract(outline.bounds[2:], outline.bounds[:2]))
    found = []
    for turn in np.linspace(0.0, math.tau, 12, endpoint=False).tolist():
        ray = LineString([middle, (middle.x + 2 * size * math.cos(turn), middle.y + 2 * size * math.sin(turn))])
        points = shapely.get_coordinates(ray.intersection(outline.exterior))
        if len(points):
            x, y = max(points.tolist(), key=lambda point: math.dist(point, (middle.x, middle.y)))
            found.append(GripPoint(x, y, math.remainder(turn + math.pi, math.tau)))
    return found


def _is_clear_of(outline: Polygon, grip: GripPoint) -> bool:
    x, y, _ = Formation((grip,)).carrier_poses()[0]
    return bool(outline.distance(Point(x, y)) >= RADIUS_M)


def _thinned_out(grips: list[GripPoint], count: int) -> list[GripPoint]:
    """Grip points that form at most 1000 sets, which takes tenths of a second to examine: of the two carriers nearest
    to each other, the later is removed repeatedly."""
    grips = list(grips)
    while math.comb(len(grips), count) > 1000:
        bases = np.array(Formation(tuple(grips)).carrier_poses())[:, :2]
        away = np.hypot(*(bases[:, None] - bases[None]).T).round(6)
        away[np.tril_indices(len(grips))] = math.inf
        del grips[int(np.unravel_index(away.argmin(), away.shape)[1])]
    return grips


def _non_overlapping(grips: list[GripPoint], count: int) -> Iterator[tuple[GripPoint, ...]]:
    """Sets of grip points whose carriers do not overlap."""
    bases = np.array(Formation(tuple(grips)).carrier_poses()).reshape(-1, 3)[:, :2]
    away = np.hypot(*(bases[:, None] - bases[None]).T)
    beside = away >= 2 * RADIUS_M + GAP_M - 1e-9
    for chosen in combinations(range(len(grips)), count):
        if all(beside[i, j] for i, j in combinations(chosen, 2)):
            yield tuple(grips[i] for i in chosen)


def _safety(outline: Polygon, sets: list[tuple[GripPoint, ...]]) -> Floats:
    """Distance of the centroid from the boundary of the grip points' polygon [m]; negative outside of it and for two
    grip points."""
    hulls = _hulls(np.array(sets)[:, :, :2]) if sets else np.empty(0, object)
    off = shapely.distance(hulls, outline.centroid)
    within = shapely.distance(shapely.boundary(hulls), outline.centroid)
    return np.where((off > 0.0) | (shapely.area(hulls) == 0.0), -off, within)


def _least_safety(count: int) -> float:
    return -(MAX_OFFSET_ONE_GRIP_M if count == 1 else MAX_OFFSET_M)


def _hulls(points: Floats) -> NDArray[np.object_]:
    """The convex hull of each set of points (n, m, 2)."""
    which = np.repeat(np.arange(len(points)), points.shape[1])
    return shapely.convex_hull(shapely.multipoints(points.reshape(-1, 2), indices=which))


def _area_and_width(outline: Polygon, found: list[Formation]) -> tuple[Floats, Floats]:
    """Area [m²] and width [m] of each formation; rounded, so that the order of the edges decides between equal ones."""
    corners = shapely.get_coordinates(outline)
    turns = np.linspace(0.0, math.tau, 16, endpoint=False)
    disc = RADIUS_M * np.column_stack([np.cos(turns), np.sin(turns)])
    middles = np.array([formation.carrier_poses() for formation in found])[:, :, :2]
    discs = (middles[:, :, None] + disc).reshape(len(found), -1, 2)
    every = np.concatenate([discs, np.broadcast_to(corners, (len(found), *corners.shape))], axis=1)
    widths = np.ptp(every @ _directions(), axis=1).min(axis=1)
    return shapely.area(_hulls(every)).round(6), widths.round(6)


def width_of(shape: BaseGeometry) -> float:
    """Width of the narrowest straight gap that a shape passes without turning [m]."""
    return float(np.ptp(shapely.get_coordinates(shape.convex_hull) @ _directions(), axis=0).min())


def _directions() -> Floats:
    turns = np.linspace(0.0, math.pi, 72, endpoint=False)
    return np.array([np.cos(turns), np.sin(turns)])


def _distinct(found: list[Formation], kept: list[Formation], most: int) -> list[Formation]:
    """`kept` and the first of `found`, without formations similar to an earlier one; at most `most` in all."""
    kept = list(kept)
    for formation in found:
        if len(kept) == most:
            break
        if all(_difference(formation, other) >= 2 * CORNER_DISTANCE_M for other in kept):
            kept.append(formation)
    return kept


def _difference(one: Formation, other: Formation) -> float:
    """Largest distance of a carrier of `one` from the nearest carrier of `other` [m]."""
    here, there = np.array(one.carrier_poses())[:, :2], np.array(other.carrier_poses())[:, :2]
    return float(np.hypot(*(here[:, None] - there[None]).T).min(axis=0).max())

"""The outline of a floor from the floor polygons and holes of an Open-RMF level."""

from __future__ import annotations

from typing import NamedTuple

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.formats.openrmf_file import Level
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.model import Elevator, MapObject, PolygonShape
from robocorba.map_editor.spatial.pose import XY

#: Maximum distance of a lift's shaft from the floor polygon that it belongs to [m].
MAX_SHAFT_DISTANCE_M = 0.5
#: Maximum distance of a wall or node outside a floor polygon that it belongs to [m]: walls are drawn along its edge.
WALL_REACH_M = 0.5
#: Minimum area of holes and parts [m2]: smaller ones are artefacts of drawing.
MIN_AREA_M2 = 0.01


class FloorOutline(NamedTuple):
    """The outline of a floor (empty: unbounded), its holes as objects, and the parts that were left out."""

    points: tuple[XY, ...]
    voids: dict[str, MapObject]
    left_out: tuple[Polygon, ...]

    def leaves_out(self, a: XY, b: XY) -> bool:
        """Whether a wall or door belongs only to a part that was left out."""
        line = shapely.LineString([a, b])
        return bool(self.left_out) and (
            line.distance(shapely.union_all(self.left_out)) <= WALL_REACH_M < line.distance(Polygon(self.points))
        )


def floor_outline(level: Level, shafts: list[Elevator], losses: Losses) -> FloorOutline:
    """The outline of a placed level, and its holes as objects `void1`, `void2`...; empty without a floor polygon.

    A single valid polygon without a hole or a missing shaft is taken unchanged. Else the outline is the union of the
    floor polygons and of the shafts that adjoin or overlap them; gaps up to 0.1 m are closed. If it still has
    several parts, only the largest one is kept if it contains all lanes, else the outline is their convex hull. If
    most nodes and walls are outside the polygons, the outline is the convex hull of all of them."""
    polygons = _polygons(level, "floors", level.polygons, losses)
    holes = _polygons(level, "holes", level.holes, losses)
    if not polygons:
        if holes:
            losses.add("holes without a floor around them are left out: {names}", level.name)
        return FloorOutline((), {}, ())
    drawn = shapely.union_all([area for area, _ in polygons])
    hull = _hull_of_all(drawn, [shaft_polygon(shaft) for shaft in shafts], level, losses)
    ground = drawn if hull is None else hull
    missing = _missing_shafts(ground, shafts, level, losses)
    if hull is None and len(polygons) == 1 and not missing and not holes and isinstance(polygons[0][0], Polygon):
        return FloorOutline(tuple(polygons[0][1]), {}, ())
    whole = shapely.union_all([ground, *missing])
    joined = _one_part(whole, level, losses)
    left_out = _report_left_out(whole, joined, "no lane leads there", level, losses)
    parts = joined.difference(shapely.union_all([area for area, _ in holes])) if holes else joined
    kept = _largest(parts)
    left_out += _report_left_out(parts, kept, "holes cut them off", level, losses)
    voids = [void for ring in kept.interiors if (void := Polygon(ring)).area >= MIN_AREA_M2]
    objects = {f"void{i}": _void(f"void{i}", void) for i, void in enumerate(voids, start=1)}
    return FloorOutline(_points(kept), objects, tuple(left_out))


def _polygons(level: Level, key: str, rings: list[list[int]], losses: Losses) -> list[tuple[BaseGeometry, list[XY]]]:
    """The areas that rings of vertices enclose, repaired if they cross themselves, with their points. Areas below
    MIN_AREA_M2 are left out."""
    found = []
    for i, indices in enumerate(rings):
        points, where = level.points(indices), f"{level.name} {key}[{i}]"
        area: BaseGeometry = Polygon(points) if len(points) >= 3 else Polygon()
        if not area.is_valid:
            losses.add("polygons that cross themselves were repaired: {names}", where)
            area = shapely.union_all([part for part in shapely.get_parts(shapely.make_valid(area)) if part.area > 0])
        if area.area < MIN_AREA_M2:
            losses.add(f"polygons smaller than {MIN_AREA_M2:g} m2: {{n}} left out: {{names}}", where)
        else:
            found.append((area, points))
    return found


def _hull_of_all(ground: BaseGeometry, shafts: list[BaseGeometry], level: Level, losses: Losses) -> BaseGeometry | None:
    """The convex hull of floor polygons, shafts, walls and nodes with 1 m around, where robots can turn; None
    unless the polygons leave out most nodes and walls."""
    nodes = [shapely.Point(at) for at in level.points(level.node_vertices())]
    walls = [shapely.LineString(level.points((wall.a, wall.b))) for wall in level.links["walls"]]
    reach = shapely.union_all([ground, *shafts]).buffer(WALL_REACH_M)
    shapely.prepare(reach)
    nodes_out = sum(not reach.covers(node) for node in nodes)
    walls_out = sum(not reach.covers(wall) for wall in walls)
    if nodes_out + walls_out <= (len(nodes) + len(walls)) / 2:
        return None
    rooms = [node.buffer(1.0) for node in nodes]
    hull = shapely.union_all([ground, *shafts, *walls, *rooms]).convex_hull
    losses.add(
        f"outline of {level.name}: the floor polygons cover {ground.area:.1f} m2 and leave out {nodes_out} of "
        f"{len(nodes)} nodes and {walls_out} of {len(walls)} walls; the convex hull of all, {hull.area:.1f} m2, "
        f"is used instead"
    )
    return hull


def _missing_shafts(ground: BaseGeometry, shafts: list[Elevator], level: Level, losses: Losses) -> list[BaseGeometry]:
    """Shafts not wholly inside the floor polygons but at most MAX_SHAFT_DISTANCE_M away, with the ground between."""
    found = []
    for elevator in shafts:
        shaft = shaft_polygon(elevator)
        if not ground.covers(shaft) and ground.distance(shaft) <= MAX_SHAFT_DISTANCE_M:
            between = shaft.buffer(MAX_SHAFT_DISTANCE_M, join_style="mitre").intersection(
                ground.union(shaft).convex_hull
            )
            found.append(shaft.union(between))
            losses.add("outline: extended by the shafts of lifts: {names}", f"{level.name} {elevator.name}")
    return found


def _one_part(ground: BaseGeometry, level: Level, losses: Losses) -> Polygon:
    """The ground as one polygon: with gaps closed, else its largest part if that has all lanes, else its hull."""
    if isinstance(ground, Polygon):
        return ground
    closed = ground.buffer(0.05, join_style="mitre").buffer(-0.05, join_style="mitre")
    if isinstance(closed, Polygon) and not closed.is_empty:
        return closed
    largest = _largest(ground)
    ends = {index for lane in level.links["lanes"] for index in (lane.a, lane.b)}
    if all(largest.covers(shapely.Point(at)) for at in level.points(ends)):
        return largest
    losses.add("outline: the floor polygons lie apart, their convex hull is used: {names}", level.name)
    return ground.convex_hull


def _report_left_out(ground: BaseGeometry, kept: Polygon, why: str, level: Level, losses: Losses) -> list[Polygon]:
    """The parts of the ground that are not `kept`. Reports their areas and positions."""
    found = []
    for part in shapely.get_parts(ground).tolist():
        if isinstance(part, Polygon) and part.area >= MIN_AREA_M2 and not kept.covers(part.representative_point()):
            found.append(part)
            point = part.representative_point()
            losses.add(
                f"outline: {{n}} parts of the floor except the largest are left out, {why}: {{names}}",
                f"{level.name} {part.area:.2f} m2 at ({point.x:.2f}, {point.y:.2f})",
            )
    return found


def _largest(ground: BaseGeometry) -> Polygon:
    parts = [part for part in shapely.get_parts(ground) if isinstance(part, Polygon)]
    return max(parts, key=lambda part: part.area, default=Polygon())


def _points(polygon: Polygon) -> tuple[XY, ...]:
    return tuple((x, y) for x, y in polygon.exterior.coords[:-1])


def _void(name: str, area: Polygon) -> MapObject:
    """A hole as an object around its centroid."""
    x, y = round(area.centroid.x, 3), round(area.centroid.y, 3)
    return MapObject(
        name=name, shape=PolygonShape(points=tuple((px - x, py - y) for px, py in _points(area))), at=(x, y)
    )

"""What blocks on a floor: the shape of every obstacle, what doors cut open, the free space between them, and that what
is derived from a map is kept as long as the map."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterable

import msgspec
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, affinity
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor import collisions, geometry
from robocorba.map_editor.collisions import all_paths
from robocorba.map_editor.geometry import DOOR_REACH_M, LANDING_REACH_M, free_space, obstacles, subnet_at
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    GeometricalMap,
    MapObject,
    PathNode,
    PolygonShape,
    SegmentShape,
    Shape,
    Wall,
)
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.validation import problems
from testkit.buildings import with_all

ROOM = ((0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0))


def storey(elements: Iterable[Element] = (), outline: tuple[XY, ...] = ()) -> Building:
    """A building whose floor L1 holds the elements, and empty floors L2 and L3 above."""
    floors = [("", Floor(name="L1", level=1, elevation=0.0, outline=outline))]
    floors += [("", Floor(name=f"L{level}", level=level, elevation=4.0 * level)) for level in (2, 3)]
    return with_all(Building("test"), [*floors, *(("L1", element) for element in elements)])


def found(building: Building, floor: str = "L1") -> dict[tuple[str, str], BaseGeometry]:
    """The obstacles of a floor by kind and name, each of which must be there once."""
    items = obstacles(building, floor)
    shapes = {(item.kind, item.name): item.geometry for item in items}
    assert len(shapes) == len(items)
    return shapes


@pytest.mark.parametrize(
    ("shape", "heading", "expected"),
    [
        (SegmentShape(length=4.0), 0.0, LineString([(1, 2), (5, 2)])),
        (SegmentShape(length=2.0), math.pi / 2, LineString([(3, 1), (3, 3)])),
        (BoxShape(size=(4.0, 1.0)), 0.0, shapely.box(1, 1.5, 5, 2.5)),
        (BoxShape(size=(4.0, 1.0)), math.pi / 2, shapely.box(2.5, 0, 3.5, 4)),
        (BoxShape(size=(2.0, 2.0)), math.pi / 4, Point(3, 2).buffer(math.sqrt(2), quad_segs=1)),
        (PolygonShape(points=((0.0, 0.0), (2.0, 0.0), (0.0, 1.0))), 0.0, Polygon([(3, 2), (5, 2), (3, 3)])),
        (PolygonShape(points=((0.0, 0.0), (2.0, 0.0), (0.0, 1.0))), math.pi, Polygon([(3, 2), (1, 2), (3, 1)])),
    ],
)
def test_an_object_stands_at_its_pose(shape: Shape, heading: float, expected: BaseGeometry) -> None:
    thing = MapObject(name="o", shape=shape, at=(3.0, 2.0), heading=heading)
    (geometry_of,) = found(storey([thing])).values()
    assert geometry_of.geom_type == expected.geom_type
    assert shapely.hausdorff_distance(geometry_of, expected) < 1e-9


@given(radius=st.floats(0.01, 50), heading=st.floats(-7, 7), x=st.floats(-1e4, 1e4))
@settings(deadline=None)
def test_a_circle_is_enclosed_and_hardly_larger(radius: float, heading: float, x: float) -> None:
    disc = geometry.object_geometry(MapObject(name="o", shape=CircleShape(radius=radius), at=(x, -x), heading=heading))
    centre = Point(x, -x)
    assert disc.exterior.distance(centre) >= radius * (1 - 1e-9) - 1e-9
    assert shapely.hausdorff_distance(disc, centre) <= radius * 1.005
    assert disc.contains(centre)


WALL = Wall(name="w", a=(0.0, 0.0), b=(10.0, 0.0))


def test_a_locked_door_blocks_where_the_wall_was() -> None:
    door = Door(name="d", a=(4.0, 0.0), b=(5.0, 0.0), locked=True)
    shapes = found(storey([WALL, door]))
    assert shapely.equals(shapes["door", "d"], LineString([(4, 0), (5, 0)]))
    assert shapes["wall", "w"].length == pytest.approx(9.0)
    assert list(found(storey([WALL, Door(name="d", a=(4.0, 0.0), b=(5.0, 0.0))]))) == [("wall", "w")]


spots = st.tuples(*[st.floats(0, 8).map(lambda value: round(value, 2))] * 2)
spans = st.tuples(spots, spots).filter(lambda ends: math.dist(*ends) > 0.05)


@given(
    walls=st.lists(spans, max_size=6),
    doors=st.lists(spans, max_size=3),
    offset=st.floats(-0.2, 0.2),
    degrees=st.sampled_from([0.0, 14.9, 15.1, 180.0, 194.9, 195.1]),
)
@settings(deadline=None, max_examples=40)
def test_a_point_of_a_wall_is_gone_exactly_where_a_door_along_it_is_near(
    walls: list[tuple[XY, XY]], doors: list[tuple[XY, XY]], offset: float, degrees: float
) -> None:
    beside = [affinity.translate(affinity.rotate(LineString(ends), degrees), 0.0, offset) for ends in walls]
    doors = [*doors, *((line.coords[0], line.coords[1]) for line in beside)]  # that fit their walls, or nearly
    plan: list[Element] = [Wall(name=f"w{i}", a=a, b=b) for i, (a, b) in enumerate(walls)]
    plan += [Door(name=f"d{i}", a=a, b=b) for i, (a, b) in enumerate(doors)]
    shapes = found(storey(plan))
    for i, (a, b) in enumerate(walls):
        left = shapes.get(("wall", f"w{i}"), LineString())
        for share in np.linspace(0, 1, 15):
            place = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
            margins = [margin_of(place, (a, b), door) for door in doors]
            if any(abs(margin) < 1e-6 for margin in margins):
                continue  # on the rim of an opening, or just at the greatest angle
            gone = any(margin > 0 for margin in margins)
            assert (left.is_empty or left.distance(Point(place)) > 1e-7) is gone


def margin_of(place: XY, wall: tuple[XY, XY], door: tuple[XY, XY]) -> float:
    """How deep a place of a wall lies in a door's opening, positive where the door cuts it."""
    (ax, ay), (bx, by) = door
    length = math.dist(*door)
    ux, uy = (bx - ax) / length, (by - ay) / length
    angle = math.atan2(wall[1][1] - wall[0][1], wall[1][0] - wall[0][0]) - math.atan2(by - ay, bx - ax)
    off_parallel = abs((angle + math.pi / 2) % math.pi - math.pi / 2)
    along = (place[0] - ax) * ux + (place[1] - ay) * uy
    across = (place[1] - ay) * ux - (place[0] - ax) * uy
    return min(along, length - along, DOOR_REACH_M - abs(across), math.radians(15) - off_parallel)


def lift(*doors: ElevatorDoor, heading: float = 0.0) -> Elevator:
    return Elevator(name="E", at=(5.0, 4.0), size=(3.0, 2.0), doors=doors, heading=heading)


@pytest.mark.parametrize(
    ("side", "heading", "middle"),
    [
        (CabinSide.FRONT, 0.0, (5.2, 3.0)),
        (CabinSide.BACK, 0.0, (5.2, 5.0)),
        (CabinSide.LEFT, 0.0, (3.5, 4.2)),
        (CabinSide.RIGHT, 0.0, (6.5, 4.2)),
        (CabinSide.FRONT, math.pi / 2, (6.0, 4.2)),
    ],
)
def test_a_shaft_is_open_at_its_doors_on_the_floors_that_they_serve(
    side: CabinSide, heading: float, middle: XY
) -> None:
    door = ElevatorDoor(floor="L1", side=side, width=1.2, offset=0.2)
    building = storey([lift(door, ElevatorDoor(floor="L3"), heading=heading)])
    (served,), (closed,) = found(building).values(), found(building, "L2").values()
    assert closed.is_ring and closed.length == pytest.approx(10.0)
    assert served.length == pytest.approx(8.8, abs=1e-5)
    assert served.distance(Point(middle)) == pytest.approx(0.6, abs=1e-5)


def test_a_shaft_reaches_from_the_lowest_to_the_highest_floor_that_it_serves() -> None:
    cellar, roof = Floor(name="L0", level=0, elevation=-4.0), Floor(name="L4", level=4, elevation=16.0)
    building = with_all(storey([lift(ElevatorDoor(floor="L1"), ElevatorDoor(floor="L3"))]), [("", cellar), ("", roof)])
    assert [floor for floor in building.floors if found(building, floor)] == ["L1", "L2", "L3"]
    raised = building.with_element("", msgspec.structs.replace(roof, level=-1, elevation=-8.0))
    higher = building.with_element("", lift(ElevatorDoor(floor="L1"), ElevatorDoor(floor="L4")))
    assert not found(raised, "L4") and found(higher, "L4")


def test_a_landing_cuts_the_walls_in_front_of_it_on_its_own_floor_only() -> None:
    near = Wall(name="near", a=(0.0, 3.0 - LANDING_REACH_M + 0.05), b=(10.0, 3.0 - LANDING_REACH_M + 0.05))
    far = Wall(name="far", a=(0.0, 3.0 - LANDING_REACH_M - 0.05), b=(10.0, 3.0 - LANDING_REACH_M - 0.05))
    reveal = Wall(name="reveal", a=(4.6, 2.7), b=(4.6, 3.0))
    building = storey([lift(ElevatorDoor(floor="L1", width=1.0)), near, far, reveal])
    building = building.with_element("L2", near)
    shapes = found(building)
    assert [shapes["wall", name].length for name in ("near", "far", "reveal")] == pytest.approx([9.0, 10.0, 0.3])
    assert found(building, "L2")["wall", "near"].length == 10.0


sizes = st.floats(0.1, 3.0)
shapes_of_any_kind = (
    st.builds(SegmentShape, length=sizes)
    | st.builds(BoxShape, size=st.tuples(sizes, sizes))
    | st.builds(CircleShape, radius=sizes)
    | st.just(PolygonShape(points=((0.0, 0.0), (2.0, 0.0), (0.5, 0.5), (0.0, 2.0))))
)


@st.composite
def furnished(draw: st.DrawFn) -> Building:
    """A floor with walls, doors, objects and perhaps an elevator, with an outline or without."""
    walls, doors = draw(st.lists(spans, max_size=4)), draw(st.lists(st.tuples(spans, st.booleans()), max_size=2))
    things = draw(st.lists(st.tuples(shapes_of_any_kind, spots, st.floats(0, 6)), max_size=4))
    elements: list[Element] = [Wall(f"w{i}", *ends) for i, ends in enumerate(walls)]
    elements += [Door(f"d{i}", *ends, locked=locked) for i, (ends, locked) in enumerate(doors)]
    elements += [MapObject(f"o{i}", *thing) for i, thing in enumerate(things)]
    if draw(st.booleans()):
        elements.append(lift(ElevatorDoor(floor=draw(st.sampled_from(["L1", "L2"]))), heading=draw(st.floats(0, 6))))
    return storey(elements, outline=draw(st.sampled_from([(), ROOM])))


@given(building=furnished(), radius=st.floats(0.01, 1.5))
@settings(deadline=None, max_examples=30)
def test_free_space_keeps_the_radius_and_leaves_out_nothing_else(building: Building, radius: float) -> None:
    space = free_space(building, "L1", radius)
    everything = shapely.union_all([item.geometry for item in obstacles(building, "L1")])
    x, y = np.meshgrid(np.linspace(-0.5, 10.5, 23), np.linspace(-0.5, 8.5, 19))
    grid = shapely.points(x.ravel(), y.ravel())
    inside = np.concatenate([shapely.points(shapely.get_coordinates(space)), grid[shapely.covers(space, grid)]])
    if not everything.is_empty:
        assert (shapely.distance(inside, everything) >= radius - 1e-9).all()
    outline = building.floors["L1"].floor.outline
    region = Polygon(outline) if outline else shapely.box(*geometry.bounds(building, "L1"))
    assert shapely.distance(inside, region).max(initial=0.0) < 1e-9

    roomy = shapely.covers(region, grid)
    if not everything.is_empty:
        roomy &= shapely.distance(grid, everything) > 1.011 * radius
    assert shapely.covers(space, grid[roomy]).all()


def test_free_space_of_a_point_is_what_is_not_solid() -> None:
    table = MapObject(name="o", shape=BoxShape(size=(2.0, 2.0)), at=(5.0, 4.0))
    assert free_space(storey([WALL, table], ROOM), "L1", 0.0).area == pytest.approx(80.0 - 4.0)
    assert free_space(storey([WALL], ROOM), "L1", 0.0).area == pytest.approx(80.0)
    assert free_space(storey([], ROOM), "L1", 4.0).area < 1e-6
    assert shapely.equals(found(storey(outline=ROOM))["floor", "L1"], Polygon(ROOM).exterior)


def test_only_the_latest_of_many_versions_is_kept() -> None:
    building = storey([Wall("w0", (0.0, 0.0), (0.0, 1.0))])
    before = len(geometry._OBSTACLES), len(collisions._ALL_PATHS)
    versions: list[weakref.ref[GeometricalMap]] = []
    for number in range(1, 20):
        wall = Wall(f"w{number}", (float(number), 0.0), (float(number), 1.0))
        building = with_all(building, [("L1", wall), ("L1", PathNode(f"n{number}", (number + 0.5, 0.5)))])
        assert not problems(building)
        assert len(obstacles(building, "L1")) == number + 1 and len(all_paths(building.floors["L1"].topological).at)
        versions.append(weakref.ref(building.floors["L1"].geometrical))
    assert [each() is not None for each in versions] == [False] * 18 + [True]
    assert len(geometry._OBSTACLES) <= before[0] + 3 and len(collisions._ALL_PATHS) <= before[1] + 3  # of three floors


def test_the_smallest_area_with_a_sub_network_counts() -> None:
    def square(name: str, side: float, subnet: str) -> Area:
        return Area(name, ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side)), subnet)

    areas = [square("floor", 10.0, "hall"), square("room", 4.0, "lab"), square("corner", 1.0, "")]
    for at, subnet in (((0.5, 0.5), "lab"), ((4.0, 2.0), "lab"), ((4.1, 2.0), "hall"), ((11.0, 2.0), "")):
        assert subnet_at(areas, at) == subnet

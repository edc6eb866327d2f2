"""Pictures of floors: size, and the right colour at the right place."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from matplotlib.backends.backend_agg import RendererAgg
from PIL import Image, ImageColor

from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor import drawing
from robocorba.map_editor.drawing import PathMark, draw_building, draw_floor
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    Door,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    MapObject,
    PathNode,
    SegmentShape,
    Wall,
)
from testkit.buildings import with_all
from tests.map_editor.pixels import to_pixel
from tests.planning.scenes import edge, node, room, wall

EMPTY = Building("empty", {"L1": FloorMap(Floor(name="L1", level=1, elevation=0.0))})


def scene() -> Building:
    lift = Elevator(name="E", at=(8.5, 1.5), size=(2.0, 2.0), doors=(ElevatorDoor(floor="L1"),))
    return room(
        *(10.0, 8.0, wall("w", 0.0, 4.0, 10.0, 4.0)),
        MapObject(name="box", shape=BoxShape(size=(1.0, 1.0)), at=(2.0, 2.0)),
        MapObject(name="cart", shape=BoxShape(size=(1.0, 1.0)), at=(4.0, 2.0), movable=True),
        MapObject(name="rail", shape=SegmentShape(length=2.0), at=(8.0, 7.0)),
        Door(name="open", a=(5.0, 4.0), b=(6.5, 4.0)),
        Door(name="shut", a=(8.0, 4.0), b=(9.0, 4.0), locked=True),
        *(node("a", 1.0, 6.0), node("b", 9.0, 6.0), edge("a", "b", one_way=True)),
    ).with_element("", lift)


def near(picture: Image.Image, building: Building, x: float, y: float, colour: str, reach: int = 3) -> bool:
    """Whether a pixel of about this colour lies within `reach` pixels of a place."""
    column, row = to_pixel(building, "L1", (x, y), picture.width)
    wanted = ImageColor.getrgb(colour)
    box = picture.crop((column - reach, row - reach, column + reach + 1, row + reach + 1))
    pixels = np.asarray(box).reshape(-1, 3).astype(int)
    return bool((np.abs(pixels - wanted).max(axis=1) <= 12).any())


@pytest.mark.parametrize("width", [300, 1200, 2500])
def test_everything_is_drawn_where_it_is(width: int) -> None:
    building = scene()
    picture = draw_floor(building, "L1", width_px=width)
    assert (picture.width, picture.mode) == (width, "RGB")
    assert 0.75 * width < picture.height < 0.95 * width + 80
    for x, y, colour in (
        *((3.0, 4.0, drawing.WALL), (0.0, 2.0, drawing.WALL), (2.4, 1.6, drawing.FIXED), (4.4, 1.6, drawing.MOVABLE)),
        *((7.4, 7.0, drawing.FIXED), (8.2, 4.0, drawing.LOCKED), (7.8, 0.8, drawing.CABIN), (8.3, 0.5, drawing.DOOR)),
        *((3.0, 6.0, drawing.ONE_WAY), (9.0, 6.0, drawing.NODE)),
    ):
        assert near(picture, building, x, y, colour), (x, y, colour)
    assert not near(picture, building, 5.8, 4.0, drawing.WALL, reach=1), "a door cuts its wall"


def test_a_path_is_drawn_and_broken_where_it_leaves_the_floor() -> None:
    building = scene()
    path = [
        PathMark(1.0, 7.5, "start"),
        PathMark(1.0, 5.0, "waypoint"),
        PathMark(4.0, 5.0, "elevator_entry", "E to L2"),
        PathMark(7.0, 5.0, "elevator_exit", "E"),
        PathMark(7.0, 7.5, "goal"),
    ]
    picture = draw_floor(building, "L1", path=path)
    assert near(picture, building, 1.0, 6.8, drawing.PATH)
    assert near(picture, building, 2.2, 5.0, drawing.PATH)
    assert near(picture, building, 7.0, 7.0, drawing.PATH)
    assert not near(picture, building, 6.6, 5.0, drawing.PATH, reach=2)
    assert not near(draw_floor(building, "L1"), building, 2.2, 5.0, drawing.PATH)


def test_a_shaft_that_does_not_stop_here_looks_closed() -> None:
    building = scene()
    lift = Elevator("E", (8.5, 1.5), (2.0, 2.0), (ElevatorDoor(floor="L0"), ElevatorDoor(floor="L2")))
    building = with_all(building, [("", Floor("L0", -1, -3.0)), ("", Floor("L2", 1, 3.0)), ("", lift)])
    picture = draw_floor(building, "L1")
    assert near(picture, building, 7.7, 1.5, drawing.CLOSED_SHAFT)
    assert not near(picture, building, 7.7, 1.5, drawing.CABIN)


def test_all_floors_of_a_building() -> None:
    building = scene().with_element("", Floor(name="L2", level=2, elevation=3.0))
    building = building.with_element("L2", Wall(name="w", a=(0.0, 0.0), b=(8.0, 8.0)))
    paths = {"L2": [PathMark(1.0, 6.0, "start"), PathMark(4.0, 6.0, "goal")]}
    lower, upper = draw_floor(building, "L1", width_px=400), draw_floor(building, "L2", path=paths["L2"], width_px=400)
    stacked = draw_building(building, paths=paths, width_px=400)
    assert stacked.size == (400, lower.height + upper.height)
    assert stacked.crop((0, 0, 400, upper.height)).tobytes() == upper.tobytes(), "the highest floor is on top"
    assert stacked.crop((0, upper.height, *stacked.size)).tobytes() == lower.tobytes()


@pytest.mark.parametrize("end", [(1e-3, 3e-4), (1.0, 0.3), (1e3, 3e2), (1e6, 3e5), (0.0, 5000.0)])
def test_floors_of_any_size(end: tuple[float, float]) -> None:
    building = EMPTY.with_element("L1", Wall(name="w", a=(0.0, 0.0), b=end))
    picture = draw_floor(building, "L1", width_px=400)
    assert picture.height <= drawing.MAX_PIXELS
    assert near(picture, building, end[0] / 2, end[1] / 2, drawing.WALL)


@pytest.mark.parametrize("name", ["Zürich ❄", "第一層", "$x^2$", "a\nb", "_" * 5000, "%s {0}"])
def test_any_name_can_be_drawn(name: str, recwarn: pytest.WarningsRecorder) -> None:
    building = Building(name, EMPTY.floors).with_element("L1", PathNode(name=name, at=(1.0, 1.0)))
    building = building.with_element("L1", Area(name=name, polygon=((0.0, 0.0), (4.0, 0.0), (4.0, 3.0))))
    draw_floor(building, "L1", width_px=300)
    assert not recwarn.list


def test_a_floor_or_a_size_that_cannot_be() -> None:
    with pytest.raises(UnknownFloor):
        draw_floor(EMPTY, "L2")
    with pytest.raises(UnknownFloor):
        draw_building(EMPTY, paths={"L2": []})
    for width in (0, -5, 10**6):
        with pytest.raises(ValueError, match="width_px"):
            draw_floor(EMPTY, "L1", width_px=width)


def test_a_picture_leaves_no_pixels_to_the_garbage_collector() -> None:
    gc.collect()
    gc.disable()
    try:
        before = renderers()
        draw_floor(scene(), "L1", path=[PathMark(1.0, 7.5, "start"), PathMark(1.0, 5.0, "goal")])
        assert renderers() == before
    finally:
        gc.enable()


def renderers() -> int:
    """The number of objects that hold the pixels of a picture that is being drawn."""
    return sum(type(each) is RendererAgg for each in gc.get_objects())

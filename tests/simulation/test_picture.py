"""Pictures of the 2D simulator: colours at points of the floor, caching of layers, any content of a view."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageColor

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidPicture
from robocorba.map_editor import drawing
from robocorba.map_editor.drawing import CABIN, CLOSED_SHAFT, DOOR, FIXED, MOVABLE, WALL
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    MapObject,
    PathEdge,
    PathNode,
    SegmentShape,
    Wall,
)
from robocorba.map_editor.sheet import FOOT_PX, GROUND, HEAD_PX, INK, Frame
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.pose import XY, Pose
from robocorba.simulation import picture
from robocorba.simulation.picture import LASER, LIGHT, ROBOT, UNMAPPED, UNUSED_LAYER_S, VELOCITY, FloorPainter
from robocorba.simulation.robot_scans import LastScan
from testkit.buildings import with_all
from tests.clock import Clock
from tests.map_editor.pixels import to_pixel

WIDTH = 800
SQUARE = ((-1.0, -0.25), (1.0, -0.25), (1.0, 0.25), (-1.0, 0.25))
#: A body with its x, y, heading and velocity.
Placed = tuple[Body, float, float, float, XY]


def scene() -> Building:
    """20 m by 12 m; E1 serves L1 and L2, E2 passes L1 without a stop."""
    outline = ((0.0, 0.0), (20.0, 0.0), (20.0, 12.0), (0.0, 12.0))
    served, passed = (ElevatorDoor("L1", width=1.2), ElevatorDoor("L2")), (ElevatorDoor("L0"), ElevatorDoor("L2"))
    elements: list[tuple[str, Element]] = [
        ("", Floor("L0", 0, 0.0)),
        ("", Floor("L1", 1, 4.0, outline=outline)),
        ("", Floor("L2", 2, 8.0, outline=outline)),
        ("", Elevator("E1", (17.0, 3.0), (2.0, 2.0), served)),
        ("", Elevator("E2", (17.0, 9.0), (2.0, 2.0), passed)),
        ("L1", Wall("w", (0.0, 9.0), (12.0, 9.0))),
        ("L1", Area(name="a", polygon=((0.0, 9.0), (12.0, 9.0), (12.0, 12.0), (0.0, 12.0)))),
        ("L1", MapObject("box", BoxShape((1.0, 1.0)), (2.0, 2.0))),
        ("L1", MapObject("cart", BoxShape((2.0, 0.5)), (6.0, 2.0), movable=True)),
        ("L1", MapObject("rail", SegmentShape(length=2.0), (10.0, 2.0), movable=True)),
        ("L1", PathNode(name="n", at=(3.0, 6.0))),
        ("L1", PathNode(name="m", at=(9.0, 6.0))),
        ("L1", PathEdge(name="r", a="n", b="m")),
        ("L2", MapObject("cart", BoxShape((2.0, 2.0)), (4.0, 4.0))),
    ]
    return with_all(Building("scene"), elements)


def robot(
    x: float, y: float, heading: float = 0.0, velocity: XY = (0.0, 0.0), name: str = "R", radius: float = 0.5
) -> Placed:
    return Body(0, BodyKind.ROBOT, name, radius, (), 100.0), x, y, heading, velocity


def cart(x: float, y: float, heading: float = 0.0, outline: tuple[XY, ...] = SQUARE) -> Placed:
    return Body(0, BodyKind.OBJECT, "cart", 1.0, outline, 20.0), x, y, heading, (0.0, 0.0)


def standing(floor: str, opening: float = 0.0) -> ElevatorState:
    return ElevatorState({"L1": 4.0, "L2": 8.0}[floor], floor, Doors.OPENING, opening, (), ())


def moving(height: float) -> ElevatorState:
    return ElevatorState(height, "", Doors.CLOSED, 0.0, (), ())


def view_of(*placed: Placed, floor: str = "L1", **elevators: ElevatorState) -> FloorView:
    motions = np.array(
        [(i, *velocity, 0.0, x, y, heading) for i, (_, x, y, heading, velocity) in enumerate(placed)], MOTION
    )
    bodies = [body._replace(number=i) for i, (body, *_) in enumerate(placed)]
    view = FloorView(floor)
    view.apply(FloorUpdate(floor, 0, 1, 2.5, 1, bodies, [], motions, elevators))
    return view


def fan(x: float, y: float, heading: float, reach: float = 3.0, count: int = 181) -> LastScan:
    """Half a turn ahead."""
    return LastScan("R", 0.0, Pose("L1", x, y, heading), -math.pi / 2, math.pi / 180, np.full(count, reach))


#: Draws the scene; caches its layers.
PAINTER = FloorPainter(scene())


class Shown:
    """What a painter draws of a scene."""

    def __init__(
        self,
        view: FloorView,
        fans: Sequence[LastScan] = (),
        width: int = WIDTH,
        caption: str = "",
        painter: FloorPainter = PAINTER,
    ) -> None:
        self.floor = view.floor
        self.png = painter.png(view, fans, width, caption)
        self.image = Image.open(io.BytesIO(self.png))
        self.image.load()
        self.rgb = np.asarray(self.image.convert("RGB")).astype(int)

    def at(self, x: float, y: float) -> tuple[int, ...]:
        """The colour at a place on the floor."""
        column, row = to_pixel(scene(), self.floor, (x, y), self.image.width)
        return tuple(self.rgb[row, column].tolist())

    def is_about(self, x: float, y: float, colour: str | Sequence[float]) -> bool:
        """Whether the colour is the given one within a few steps, as in the quantized static layer."""
        wanted = ImageColor.getrgb(colour) if isinstance(colour, str) else colour
        return bool(np.abs(np.subtract(self.at(x, y), wanted)).max() <= 8)

    def count(self, colour: str, rows: slice = slice(0, -FOOT_PX)) -> int:
        """Number of pixels of exactly this colour; by default without the legend's rows."""
        return int((self.rgb[rows] == ImageColor.getrgb(colour)).all(axis=2).sum())


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Floor and width of each layer that was drawn."""
    found: list[tuple[str, int]] = []

    def counted(building: Building, floor: str, width_px: int, titled: bool) -> Frame:
        found.append((floor, width_px))
        return Frame(building, floor, width_px, titled)

    monkeypatch.setattr(picture, "Frame", counted)
    return found


def lit(colour: str) -> list[float]:
    return [a + LIGHT * (b - a) for a, b in zip(ImageColor.getrgb(colour), ImageColor.getrgb(LASER), strict=True)]


SMALL = tuple((x / 8, y / 2) for x, y in SQUARE)
UNEVEN = fan(8.0, 5.0, 0.0)._replace(distances=np.where(np.arange(181) < 90, 1.0, 4.0))


def turned(x: float, y: float, away_m: float, angle: float) -> XY:
    return x + away_m * math.cos(angle), y + away_m * math.sin(angle)


TINT, LIT = drawing.TINTS[0], lit(GROUND)
UP, RIGHT = fan(8.0, 5.0, math.pi / 2), fan(8.0, 5.0, 0.0)
BELOW = fan(8.0, 6.0, math.pi / 2, 4.0)
#: What is drawn of bodies and fans beside the cabin of E1, and the colour of some places on the floor.
COLOURS: list[tuple[str, list[Placed], list[LastScan], ElevatorState | None, str | list[float], list[XY]]] = [
    ("fixed objects", [], [], None, FIXED, [(2.2, 1.7)]),
    ("an area", [], [], None, TINT, [(6.0, 10.0)]),
    ("a line that has no mass: it is not moved", [], [], None, MOVABLE, [(9.1, 2.0)]),
    ("neither roads nor movable objects", [], [], None, GROUND, [(5.5, 6.0), (3.0, 6.0), (6.8, 2.0)]),
    ("an object", [cart(10.0, 5.0)], [], None, MOVABLE, [(10.8, 5.0), (9.2, 4.85)]),
    ("not around it", [cart(10.0, 5.0)], [], None, GROUND, [(6.8, 2.0), (10.0, 5.6)]),
    ("one that is turned", [cart(10.0, 5.0, 0.5)], [], None, MOVABLE, [turned(10.0, 5.0, 0.85, 0.5)]),
    ("counter-clockwise", [cart(10.0, 5.0, 0.5)], [], None, GROUND, [turned(10.0, 5.0, 0.85, -0.5)]),
    ("no name where no room is", [cart(10.0, 5.0, 0.0, SMALL)], [], None, MOVABLE, [(10.0, 5.0)]),
    ("a robot", [robot(8.0, 5.0)], [], None, ROBOT, [(8.0, 5.45), (7.7, 5.0), (8.0, 5.3)]),
    ("its mark", [robot(8.0, 5.0)], [], None, GROUND, [(8.3, 5.0), (8.0, 5.65)]),
    ("a mark ahead", [robot(8.0, 5.0, -2.5)], [], None, GROUND, [turned(8.0, 5.0, 0.3, -2.5)]),
    ("and none behind", [robot(8.0, 5.0, 100.0)], [], None, ROBOT, [turned(8.0, 5.0, -0.3, 100.0)]),
    ("an arrow", [robot(8.0, 5.0, velocity=(0.0, 1.0))], [], None, VELOCITY, [(8.0, 6.0)]),
    ("a short one", [robot(8.0, 5.0, velocity=(0.0, 1.0))], [], None, GROUND, [(8.0, 6.6)]),
    ("a robot over an object", [robot(10.0, 5.0), cart(10.0, 5.0)], [], None, ROBOT, [(9.7, 5.0)]),
    ("the object below", [robot(10.0, 5.0), cart(10.0, 5.0)], [], None, MOVABLE, [(9.1, 5.0)]),
    ("a fan", [], [BELOW], None, LIT, [(8.0, 7.0), (6.5, 6.3)]),
    ("an area keeps its tint", [], [BELOW], None, lit(TINT), [(7.0, 9.6)]),
    ("neither behind nor too far", [], [BELOW], None, GROUND, [(8.0, 5.7), (12.4, 6.2)]),
    ("fans that overlap, lit once", [], [UP, RIGHT], None, LIT, [(9.0, 6.5), (7.0, 6.5), (9.0, 4.0)]),
    ("neither of them", [], [UP, RIGHT], None, GROUND, [(7.0, 4.0)]),
    ("first rays to the right, and short", [], [UNEVEN], None, GROUND, [(9.8, 3.2)]),
    ("last ones to the left", [], [UNEVEN], None, LIT, [(9.8, 6.8)]),
    ("objects, not lit", [cart(8.0, 6.0)], [UP], None, MOVABLE, [(8.8, 6.0)]),
    ("robots, not lit", [robot(8.0, 7.0)], [UP], None, ROBOT, [(7.8, 7.0)]),
    ("shafts, not lit", [], [fan(15.0, 3.0, 0.0)], None, CLOSED_SHAFT, [(16.3, 2.3), (16.4, 9.0)]),
    ("a cabin", [], [], standing("L1"), CABIN, [(16.3, 2.3), (17.7, 3.7)]),
    ("doors that are shut", [], [], standing("L1"), DOOR, [(17.0, 2.0), (17.45, 2.0)]),
    ("doors that open from the middle", [], [], standing("L1", 0.5), GROUND, [(17.0, 2.0), (17.25, 2.0), (16.75, 2.0)]),
    ("to both sides", [], [], standing("L1", 0.5), DOOR, [(17.35, 2.0), (16.65, 2.0)]),
    ("doors that are open", [], [], standing("L1", 1.0), GROUND, [(17.0, 2.0), (17.45, 2.0)]),
    ("on another floor", [], [], standing("L2", 1.0), DOOR, [(17.0, 2.0)]),
]


@pytest.mark.parametrize(
    ("placed", "fans", "cabin", "colour", "places"), [row[1:] for row in COLOURS], ids=[row[0] for row in COLOURS]
)
def test_colours_at_places(
    placed: list[Placed], fans: list[LastScan], cabin: ElevatorState | None, colour: str | list[float], places: list[XY]
) -> None:
    shown = Shown(view_of(*placed, **({"E1": cabin} if cabin else {})), fans)
    assert [shown.at(*place) for place in places if not shown.is_about(*place, colour)] == []


@pytest.mark.parametrize("width", [200, 801, 1200])
def test_a_picture_of_any_width_has_the_pixels_of_the_drawn_floor(width: int) -> None:
    shown = Shown(view_of(E1=standing("L1")), width=width)
    assert (shown.image.format, shown.image.mode) == ("PNG", "P")
    assert shown.image.size == drawing.draw_floor(scene(), "L1", width_px=width).size
    assert shown.is_about(2.2, 1.7, FIXED) and shown.is_about(17.7, 3.7, CABIN)
    column, row = to_pixel(scene(), "L1", (6.0, 9.0), width)
    around = shown.rgb[row - 1 : row + 2, column]
    assert np.abs(around - ImageColor.getrgb(WALL)).max(axis=1).min() <= 12


# ---- sizes and names ----


def test_robots_have_a_size_and_arrows_where_they_can_be_seen() -> None:
    whole = Shown(view_of(robot(8.0, 5.0)))
    assert 0 < Shown(view_of(robot(-0.7, 5.0))).count(ROBOT) < whole.count(ROBOT), "partly in the picture"
    small = Shown(view_of(robot(8.0, 5.0, radius=0.01)), width=200)
    assert small.count(ROBOT) > 12 and small.count(VELOCITY) == 0
    for velocity in ((0.0, 0.0), (0.01, 0.0), (math.nan, 0.0), (math.inf, 1.0)):
        assert Shown(view_of(robot(8.0, 5.0, velocity=velocity))).count(VELOCITY) == 0
    column, row = to_pixel(scene(), "L1", (9.5, 5.0), WIDTH)
    over = Shown(view_of(robot(10.0, 5.0), cart(10.0, 5.0)))
    rim = over.rgb[row, column - 3 : column + 3] == ImageColor.getrgb(GROUND)
    assert rim.all(axis=1).any(), "a rim between them"


def letters(x: float, y: float, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that a robot's name changes, and those of its letters."""
    named, bare = (Shown(view_of(robot(x, y, name=text))) for text in (name, ""))
    changed = (named.rgb != bare.rgb).any(axis=2)
    return changed, changed & (named.rgb == ImageColor.getrgb(INK)).all(axis=2)


def test_names_are_below_robots() -> None:
    rows, columns = np.nonzero(letters(8.0, 5.0, "HHHH")[0])
    column, row = to_pixel(scene(), "L1", (8.0, 5.0), WIDTH)
    assert abs((columns.min() + columns.max()) / 2 - column) <= 2
    assert row + 12 < rows.min() < rows.max() < row + 45


@pytest.mark.parametrize("place", [(-0.2, 5.0), (20.2, 5.0), (10.0, -0.3), (10.0, -1.1), (10.0, 12.9)])
def test_names_stay_in_the_picture(place: XY) -> None:
    name = "robot-with-a-name"
    assert letters(*place, name)[1].sum() >= 0.7 * letters(9.0, 5.0, name)[1].sum() > 50


def test_texts_are_one_short_line() -> None:
    for name, short in (("a\nb", "a□b"), ("_" * 29, "_" * 26 + "…"), ("é" * 5000, "é" * 26 + "…")):
        written, wanted = (Shown(view_of(robot(8.0, 5.0, name=text))) for text in (name, short))
        assert written.png == wanted.png
    without, captioned = Shown(view_of()), Shown(view_of(), caption="scene · L1   2.5 s")
    assert without.count(INK, slice(0, HEAD_PX)) == 0
    assert captioned.count(INK, slice(0, HEAD_PX)) > 50
    assert (captioned.rgb[HEAD_PX:] == without.rgb[HEAD_PX:]).all()
    cut, long = (Shown(view_of(), caption="x" * letters) for letters in (200, 10_000))
    assert cut.png == long.png


# ---- lasers ----


def test_what_can_not_be_drawn_is_left_out(recwarn: pytest.WarningsRecorder) -> None:
    nothing = Shown(view_of()).png
    places = [(math.nan, 5.0), (8.0, math.inf), (1e7, 5.0), (1e300, 5.0)]
    fans = [fan(x, y, 0.0) for x, y in places]
    fans += [fan(8.0, 5.0, math.nan), fan(8.0, 5.0, 0.0, count=0), fan(8.0, 5.0, 0.0, count=1)]
    assert Shown(view_of(), fans).png == nothing
    for x, y in [*places, (-50.0, 5.0), (8.0, 500.0), (-1e308, 1e308)]:
        assert Shown(view_of(robot(x, y, velocity=(0.1, 0.0)), cart(x, y))).png == nothing
    assert Shown(view_of(robot(8.0, 5.0, math.nan), cart(8.0, 5.0, math.inf))).png == nothing
    for outline in ((), ((0.0, 0.0),), ((0.0, 0.0), (1.0, 1.0))):
        assert Shown(view_of(cart(10.0, 5.0, outline=outline))).png == nothing, "it has no shape"
    distances = np.full(181, 2.0)
    distances[:60], distances[60:90], distances[90:120] = np.inf, np.nan, -1.0
    shown = Shown(view_of(), [fan(8.0, 6.0, math.pi / 2)._replace(distances=distances)])
    assert not shown.is_about(12.0, 7.0, GROUND), "inf: as far as the picture goes"
    assert shown.is_about(7.98, 6.5, GROUND), "neither NaN nor less than nothing is a way"
    assert not shown.is_about(6.7, 6.5, GROUND)
    angles, endless = (math.radians(20), math.radians(20)), np.array([np.inf, np.inf])
    shown = Shown(view_of(), [LastScan("R", 0.0, Pose("L1", 2.0, 2.0), *angles, endless)])
    ends = [turned(2.0, 2.0, 6.0, angle) for angle in (0.3, 0.4, 0.6, 0.8)]
    assert [shown.is_about(x, y, GROUND) for x, y in ends] == [True, False, False, True]
    assert not recwarn.list


def test_the_edge_of_a_fan_is_a_line_with_few_rays_too() -> None:
    shown = Shown(view_of(), [fan(8.0, 6.0, math.pi / 2, 4.0)])
    assert ImageColor.getrgb(LASER) in (shown.at(8.0, 9.99), shown.at(8.0, 10.0))
    rays = np.linspace(2.0, 4.0, 8192)
    whole = LastScan("R", 0.0, Pose("L1", 8.0, 5.0), 0.0, math.pi / 8191, rays)
    thin = whole._replace(step_rad=math.pi * 12 / 8191, distances=rays[::12])
    shown, wanted = (Shown(view_of(), [one]) for one in (whole, thin))
    assert shown.png == wanted.png, "many rays are thinned out"
    few = fan(8.0, 5.0, 0.0, count=719)._replace(step_rad=math.pi / 718)
    few.distances[::2] = 1.0
    assert Shown(view_of(), [few]).count(LASER) > 700, "every ray of these"


def test_what_an_actual_sensor_sees_and_no_map_has() -> None:
    distances = np.full(181, 3.0)
    distances[85:96] = 1.5
    scan = fan(8.0, 5.0, 0.0)._replace(distances=distances)
    virtual = Shown(view_of(), [scan])
    assert virtual.count(UNMAPPED) == 0
    actual = Shown(view_of(), [scan._replace(is_virtual=False)])
    assert actual.count(LASER) > 1.5 * virtual.count(LASER)
    marked = Shown(view_of(), [scan._replace(is_virtual=False, unmapped=distances < 2.0)])
    assert marked.at(9.5, 5.0) == ImageColor.getrgb(UNMAPPED)
    assert marked.at(11.0, 5.6) != ImageColor.getrgb(UNMAPPED)
    ring = scan._replace(first_rad=0.0, step_rad=math.pi / 4, distances=np.full(8, 2.0), unmapped=np.arange(8) == 0)
    shown = Shown(view_of(), [ring])
    assert shown.at(10.0, 5.0) == ImageColor.getrgb(UNMAPPED)
    assert shown.at(9.0, 4.6) == shown.at(9.0, 5.4) == shown.at(7.0, 5.0), "all around"
    many = np.full(1800, 3.0)
    thinned = scan._replace(step_rad=math.pi / 1799, distances=many, unmapped=np.arange(1800) > 1700)
    shown = Shown(view_of(), [thinned])
    assert shown.at(8.1, 7.98) == ImageColor.getrgb(UNMAPPED)
    assert shown.at(9.0, 2.18) != ImageColor.getrgb(UNMAPPED)


# ---- elevators ----


def test_a_shaft_shows_where_its_cabin_is() -> None:
    moments = [standing("L2"), moving(8.0), moving(2.0), moving(0.0)._replace(floor="L0")]
    pictures = [Shown(view_of(E1=moment)) for moment in moments]
    assert {picture.at(16.3, 2.3) for picture in pictures} == {ImageColor.getrgb(CLOSED_SHAFT)}
    assert len({picture.png for picture in pictures}) == len(moments)
    above, below = Shown(view_of(E1=moving(6.0))).rgb, pictures[2].rgb
    ink = [(above != below).any(axis=2) & (rgb == ImageColor.getrgb(INK)).all(axis=2) for rgb in (above, below)]
    rows = [np.nonzero(each)[0].mean() for each in ink]
    assert rows[0] > rows[1] + 1, "a triangle is wide at its lower end where it points up"
    assert Shown(view_of(E9=standing("L1"))).png == Shown(view_of()).png, "an elevator that is not there"
    for share, same in ((math.nan, 0.0), (-3.0, 0.0), (7.0, 1.0)):
        odd, wanted = (Shown(view_of(E1=standing("L1", each))) for each in (share, same))
        assert odd.png == wanted.png, "shares of an opening are limited"


# ---- requests and layers ----


def test_invalid_requests_are_refused() -> None:
    with pytest.raises(UnknownFloor, match="L1, L2"):
        PAINTER.png(view_of(floor="L9"), (), WIDTH)
    for width in (-1, 0, 199, 4097, 2**32 - 1):
        with pytest.raises(InvalidPicture, match="width"):
            PAINTER.png(view_of(), (), width)
    assert [Shown(view_of(), width=width).image.width for width in (200, 4096)] == [200, 4096]
    empty = Building("empty", {"L1": FloorMap(Floor(name="L1", level=1, elevation=0.0))})
    png = FloorPainter(empty).png(view_of(robot(0.0, 0.0, radius=5.0)), [fan(0.0, 0.0, 0.0)], 300, "empty")
    assert Image.open(io.BytesIO(png)).width == 300


def test_a_layer_is_drawn_once_and_stays_clean(drawn: list[tuple[str, int]]) -> None:
    painter = FloorPainter(scene())
    before = Shown(view_of(), painter=painter)
    crowd = view_of(*(robot(x, 5.0) for x in range(1, 19)), cart(5.0, 7.0), E1=standing("L1", 0.4))
    Shown(crowd, [fan(8.0, 5.0, 1.0)], caption="crowd", painter=painter)
    assert Shown(view_of(), painter=painter).png == before.png
    assert drawn == [("L1", WIDTH)]
    Shown(view_of(floor="L2"), painter=painter)
    Shown(view_of(), width=400, painter=painter)
    assert drawn[1:] == [("L2", WIDTH), ("L1", 400)]
    assert Shown(view_of(), painter=FloorPainter(scene(), max_cached_px=1)).png == before.png, "larger than the cache"


def test_the_layers_used_last_are_kept_and_unused_ones_dropped(drawn: list[tuple[str, int]]) -> None:
    sizes = [Shown(view_of(), width=width, painter=FloorPainter(scene())).image.size for width in (300, 301, 302)]
    painter = FloorPainter(scene(), max_cached_px=sum(map(math.prod, sizes)) - 1)
    drawn.clear()
    for width in (300, 301, 300, 302, 300, 302, 301):
        Shown(view_of(), width=width, painter=painter)
    assert [width for _, width in drawn] == [300, 301, 302, 301]
    drawn.clear()
    clock = Clock()
    painter = FloorPainter(scene(), clock=clock)
    for width in (300, 301):
        Shown(view_of(), width=width, painter=painter)
    clock.now += 0.9 * UNUSED_LAYER_S
    Shown(view_of(), width=300, painter=painter)
    painter.forget_unused()
    clock.now += 0.9 * UNUSED_LAYER_S
    painter.forget_unused()
    for width in (300, 301):
        Shown(view_of(), width=width, painter=painter)
    assert [width for _, width in drawn] == [300, 301, 301]


def test_threads_draw_at_the_same_time(drawn: list[tuple[str, int]]) -> None:
    painter = FloorPainter(scene())
    crowd = [robot(x, y, x + y, (0.5, -0.5), f"robot-{x}-{y}") for x in range(1, 19, 3) for y in range(1, 12, 3)]
    asked = [(floor, width) for floor in ("L1", "L2") for width in (300, 400)] * 6

    def draw(which: tuple[str, int]) -> bytes:
        floor, width = which
        view = view_of(*crowd, cart(4.0, 4.0), floor=floor)
        return painter.png(view, [fan(8.0, 5.0, 1.0)], width, f"{floor} {width}")

    with ThreadPoolExecutor(8) as pool:
        pictures = list(pool.map(draw, asked))
    assert sorted(drawn) == sorted(set(asked)), "each layer once"
    assert pictures == [draw(which) for which in asked]


# ---- any view ----

finite = st.one_of(st.floats(-30.0, 30.0), st.floats(allow_nan=False, allow_infinity=False))
single = st.floats(width=32, allow_nan=False, allow_infinity=False)
outlines = st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 2), max_size=6).map(tuple)
bodies = st.builds(
    Body,
    number=st.just(0),
    kind=st.sampled_from(BodyKind),
    name=st.text(max_size=40),
    radius_m=st.floats(0.0, 1e6),
    outline=outlines,
    mass_kg=st.just(1.0),
)
placed_bodies = st.lists(st.tuples(bodies, finite, finite, finite, st.tuples(single, single)), max_size=8)
fans = st.lists(
    st.builds(
        LastScan,
        robot=st.just("R"),
        time=st.just(0.0),
        at=st.builds(Pose, st.just("L1"), finite, finite, finite),
        first_rad=st.floats(-7, 7),
        step_rad=st.floats(0.001, 7),
        distances=st.lists(st.floats(), max_size=20).map(np.array),
        is_virtual=st.booleans(),
        unmapped=st.lists(st.booleans(), max_size=25).map(lambda marks: np.array(marks, bool)),
    ),
    max_size=3,
)
moments = st.builds(
    ElevatorState,
    height=finite,
    floor=st.sampled_from(["", "L1", "L2", "L9"]),
    doors=st.sampled_from(Doors),
    opening=st.floats(0.0, 1.0),
    riders=st.just(()),
    queue=st.just(()),
)
WIDTHS = (200, 333, 640)


@settings(deadline=None, max_examples=30)
@given(st.sampled_from(["L1", "L2"]), placed_bodies, fans, moments, st.sampled_from(WIDTHS), st.text(max_size=250))
def test_any_view_gives_a_picture(
    floor: str, placed: list[Placed], seen: list[LastScan], moment: ElevatorState, width: int, caption: str
) -> None:
    shown = Shown(view_of(*placed, floor=floor, E1=moment), seen, width, caption)
    assert shown.image.size == (width, Frame(scene(), floor, width, True).height)
    assert shown.image.format == "PNG"

"""ROS maps: pictures become walls, blocks and an outline; floors become pictures; both ways agree."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image
from scipy import ndimage

from robocorba.errors.maps import MapFileError
from robocorba.maps import validation
from robocorba.maps.formats import read_map, write_map
from robocorba.maps.formats.grid import Canvas
from robocorba.maps.formats.ros_picture import MAX_FILE_BYTES
from robocorba.maps.geometry import free_space
from robocorba.maps.model import (
    BoxShape,
    Building,
    CircleShape,
    Door,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    Wall,
)
from tests.formats.ros_files import BLACK, GREY, WHITE, write_ros

CELL_M = 0.05


def _flat() -> Building:
    """Two rooms joined by a door of 1 m, a slanted wall, a table and a post, 12 m x 8 m."""
    corners = [(0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)]
    walls = [Wall(name=f"side{i}", a=corners[i], b=corners[(i + 1) % 4]) for i in range(4)]
    walls += [Wall(name="middle", a=(6.03, 0.0), b=(6.03, 8.0)), Wall(name="slanted", a=(8.0, 1.0), b=(10.6, 4.2))]
    plan = GeometricalMap(
        walls={wall.name: wall for wall in walls},
        objects={
            "table": MapObject(name="table", shape=BoxShape(size=(1.4, 0.8)), at=(3.0, 4.0), heading=0.5),
            "post": MapObject(name="post", shape=CircleShape(radius=0.3), at=(9.0, 6.0)),
        },
        doors={"door": Door(name="door", a=(6.03, 3.0), b=(6.03, 4.0))},
    )
    return Building("flat", {"G": FloorMap(Floor(name="G", level=0, elevation=0.0, outline=tuple(corners)), plan)})


def _picture(path: Path) -> tuple[np.ndarray, tuple[int, int]]:
    """A map's picture, and the cell of its lower left corner."""
    said = yaml.safe_load(path.read_text())
    x, y, _ = said["origin"]
    return np.asarray(Image.open(path.parent / said["image"])), (round(x / CELL_M), round(y / CELL_M))


def _shared_frame(first: Path, second: Path) -> tuple[np.ndarray, np.ndarray]:
    """Two pictures as arrays of the same frame."""
    frames = []
    for path in (first, second):
        picture, (x, y) = _picture(path)
        frame = np.full((600, 600), GREY, np.uint8)
        top = 500 - (y + picture.shape[0])
        frame[top : top + picture.shape[0], x + 100 : x + 100 + picture.shape[1]] = picture
        frames.append(frame)
    return frames[0], frames[1]


def _overlap(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union of two regions, a cell counting as shared within one cell."""
    near = np.ones((3, 3), bool)
    shared = (first & ndimage.binary_dilation(second, near)).sum()
    only_first = (first & ~ndimage.binary_dilation(second, near)).sum()
    only_second = (second & ~ndimage.binary_dilation(first, near)).sum()
    return float(shared / (shared + only_first + only_second))


@pytest.mark.parametrize("image", ["pgm", "png"])
def test_a_floor_there_and_back(image: str, tmp_path: Path) -> None:
    write_map(_flat(), tmp_path / "flat.yaml", "ros", image=image)
    again = read_map(tmp_path / "flat.yaml")
    assert again.format == "ros"
    assert validation.problems(again.building) == []
    write_map(again.building, tmp_path / "again.yaml", "ros", image=image)
    before, after = _shared_frame(tmp_path / "flat.yaml", tmp_path / "again.yaml")
    assert _overlap(before == BLACK, after == BLACK) >= 0.98
    assert _overlap(before == WHITE, after == WHITE) >= 0.98


def test_a_door_of_a_metre_stays_one(tmp_path: Path) -> None:
    write_map(_flat(), tmp_path / "flat.yaml", "ros")
    picture, _ = _picture(tmp_path / "flat.yaml")
    _, parts = ndimage.label(picture == WHITE)
    assert parts == 1
    room = free_space(read_map(tmp_path / "flat.yaml").building, "flat", 0.4)
    left, right = shapely.Point(2.0, 2.0), shapely.Point(7.5, 6.0)
    assert [part for part in shapely.get_parts(room) if part.contains(left) and part.contains(right)]


def test_what_is_occupied_becomes_few_blocks(tmp_path: Path) -> None:
    """Table, post, the slanted wall, and the frame in four pieces: it has two rooms as holes, joined by a door."""
    write_map(_flat(), tmp_path / "flat.yaml", "ros")
    plan = read_map(tmp_path / "flat.yaml").building.floors["flat"].geometrical
    assert plan.walls == {}
    assert all(name.startswith("block") for name in plan.objects)
    assert len(plan.objects) <= 6


def test_several_floors_get_a_file_each(tmp_path: Path) -> None:
    floor = _flat().floors["G"]
    upper = FloorMap(Floor(name="a b", level=1, elevation=3.0), floor.geometrical)
    exported = write_map(Building("two", {"G": floor, "a b": upper}), tmp_path / "two.yaml", "ros", resolution_m=0.1)
    assert [path.name for path in exported.files] == ["two-G.yaml", "two-G.pgm", "two-a_b.yaml", "two-a_b.pgm"]
    assert sorted(exported.files) == sorted(tmp_path.iterdir())
    assert "doors became gaps in the walls: G door, a b door" in exported.losses


def _room() -> np.ndarray:
    """A room of 40 x 20 free cells with unknown space around and a block of 4 x 4."""
    cells = np.full((30, 50), GREY, np.uint8)
    cells[5:25, 5:45] = WHITE
    cells[10:14, 20:24] = BLACK
    return cells


def test_outline_and_block_of_a_drawn_room(tmp_path: Path) -> None:
    floor = read_map(write_ros(tmp_path, _room())).building.floors["map"]
    assert shapely.Polygon(floor.floor.outline).area == pytest.approx(8.0, rel=0.05)
    assert shapely.Polygon(floor.floor.outline).bounds == pytest.approx((0.5, 0.5, 4.5, 2.5), abs=0.06)
    block = floor.geometrical.objects["block1"]
    assert block.at[0] == pytest.approx(2.2, abs=0.25)
    assert block.at[1] == pytest.approx(1.8, abs=0.25)
    assert floor.geometrical.walls == {}


def test_the_origin_turns_and_moves(tmp_path: Path) -> None:
    path = write_ros(tmp_path, _room(), origin=[10.0, 20.0, math.pi / 2])
    outline = read_map(path).building.floors["map"].floor.outline
    assert shapely.Polygon(outline).bounds == pytest.approx((7.5, 20.5, 9.5, 24.5), abs=0.06)


def test_unknown_pockets_block(tmp_path: Path) -> None:
    cells = _room()
    cells[16:20, 30:34] = GREY
    result = read_map(write_ros(tmp_path, cells))
    assert "unknown1" in result.building.floors["map"].geometrical.objects
    assert "unknown space: 0.2 m2 within the outline count as blocked" in result.losses


@pytest.mark.parametrize(
    ("settings", "shades"),
    [
        ({"negate": 1}, {BLACK: 255, GREY: 100, WHITE: 0}),
        ({"negate": True}, {BLACK: 255, GREY: 100, WHITE: 0}),
        ({"mode": "raw"}, {BLACK: 100, GREY: 255, WHITE: 0}),
        ({"mode": "scale"}, {BLACK: 0, GREY: 128, WHITE: 255}),
        ({"mode": "trinary", "negate": None, "occupied_thresh": None, "free_thresh": None}, {}),
    ],
)
def test_modes(settings: dict[str, object], shades: dict[int, int], tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    plain = read_map(write_ros(tmp_path / "plain", _room())).building
    cells = _room()
    for old, new in shades.items():
        cells[_room() == old] = new
    assert read_map(write_ros(tmp_path, cells, **settings)).building == plain


@pytest.mark.parametrize("kind", ["P2", "P5", "RGB", "LA", "16"])
def test_kinds_of_pictures(kind: str, tmp_path: Path) -> None:
    plain = read_map(write_ros(tmp_path, _room())).building
    cells = _room()
    name = "map.pgm"
    if kind == "P2":
        rows = "\n".join(" ".join(map(str, row)) for row in cells.tolist())
        (tmp_path / name).write_text(f"P2\n# drawn\n50 30\n255\n{rows}\n")
    elif kind == "P5":
        (tmp_path / name).write_bytes(b"P5\n50 30\n255\n" + cells.tobytes())
    elif kind == "16":
        (tmp_path / name).write_bytes(b"P5\n50 30\n65535\n" + (cells.astype(">u2") * 257).tobytes())
    else:
        name = "colour.png"
        picture = Image.fromarray(cells).convert(kind)
        picture.save(tmp_path / name)
    path = tmp_path / "map.yaml"
    mode = "scale" if kind == "LA" else "trinary"
    path.write_text(path.read_text().replace("map.png", name) + f"mode: {mode}\n")
    assert read_map(path).building == plain


def test_transparent_cells_are_unknown_in_scale_mode(tmp_path: Path) -> None:
    grey = np.where(_room() == GREY, WHITE, _room()).astype(np.uint8)
    opacity = np.where(_room() == GREY, 0, 255).astype(np.uint8)
    path = write_ros(tmp_path, _room(), mode="scale")
    plain = read_map(path).building
    Image.merge("LA", [Image.fromarray(grey), Image.fromarray(opacity)]).save(tmp_path / "map.png")
    assert read_map(path).building == plain


@pytest.mark.parametrize(
    ("settings", "key", "reason"),
    [
        ({"image": "absent.png"}, "image", "no picture"),
        ({"image": "../map.png"}, "image", "in the folder"),
        ({"image": "map.yaml"}, "image", "unreadable picture"),
        ({"image": "/dev/zero"}, "image", "no picture"),
        ({"image": 7}, "image", "name of a picture"),
        ({"image": "é" * 190}, "image", "unreadable picture"),
        ({"resolution": 0}, "resolution", "above zero"),
        ({"resolution": math.nan}, "resolution", "finite"),
        ({"resolution": 1e-9}, "resolution", "metres per cell"),
        ({"origin": [1.0]}, "origin", "x, y, yaw"),
        ({"origin": [math.inf, 0, 0]}, "origin[0]", "too large|finite"),
        ({"origin": [1e6, 0, 0]}, "origin", "reaches beyond 1e\\+06 m"),
        ({"negate": 3}, "negate", "0 or 1"),
        ({"mode": "dual"}, "mode", "trinary"),
        ({"free_thresh": 0.9}, "free_thresh", "free_thresh < occupied_thresh"),
    ],
)
def test_wrong_settings_are_named(settings: dict[str, object], key: str, reason: str, tmp_path: Path) -> None:
    path = write_ros(tmp_path, _room(), **settings)
    with pytest.raises(MapFileError, match=reason) as caught:
        read_map(path)
    assert caught.value.key == key
    assert caught.value.line > 0


def test_pictures_that_are_too_large_or_all_noise_are_refused(tmp_path: Path) -> None:
    path = write_ros(tmp_path, _room())
    (tmp_path / "map.png").unlink()
    path.write_text(path.read_text().replace("map.png", "map.pgm"))
    (tmp_path / "map.pgm").write_bytes(b"P5\n60000 60000\n255\n" + bytes(1000))
    with pytest.raises(MapFileError, match="too many"):
        read_map(path)
    with (tmp_path / "map.pgm").open("wb") as file:
        file.write(b"P2\n4 4\n255\n")
        file.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(MapFileError, match=f"has {MAX_FILE_BYTES + 1} bytes, at most {MAX_FILE_BYTES} can be read"):
        read_map(path)
    board = (np.indices((1000, 1000)).sum(axis=0) % 2 * 254).astype(np.uint8)
    (tmp_path / "map.pgm").write_bytes(b"P5\n1000 1000\n255\n" + board.tobytes())
    path.write_text(path.read_text().replace("resolution: 0.1", "resolution: 1.0"))
    with pytest.raises(MapFileError, match="scattered"):
        read_map(path)


HEADS = [b"", b"P5\n4 4\n255\n", b"P2\n3 3\n9\n", b"BM", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"]


@settings(max_examples=40, deadline=None)
@given(st.binary(max_size=300), st.sampled_from(HEADS))
def test_any_bytes_as_a_picture(tmp_path_factory: pytest.TempPathFactory, tail: bytes, head: bytes) -> None:
    folder = tmp_path_factory.mktemp("bytes")
    path = write_ros(folder, _room())
    (folder / "map.png").write_bytes(head + tail)
    try:
        assert validation.problems(read_map(path).building) == []
    except MapFileError as error:
        assert error.key == "image"


@settings(max_examples=60, deadline=None)
@given(arrays(np.uint8, (12, 14), elements=st.sampled_from([BLACK, GREY, WHITE, WHITE])))
def test_any_picture_makes_a_building_in_order(tmp_path_factory: pytest.TempPathFactory, cells: np.ndarray) -> None:
    building = read_map(write_ros(tmp_path_factory.mktemp("any"), cells)).building
    assert validation.problems(building) == []


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 12), st.floats(0, 9)), min_size=3, max_size=7))
def test_areas_fill_the_cells_whose_middle_they_cover(points: list[tuple[float, float]]) -> None:
    area = shapely.MultiPoint(points).convex_hull.buffer(0.3).difference(shapely.box(4.9, 4.1, 6.3, 5.7))
    area = max(shapely.get_parts(area), key=lambda part: part.area)
    canvas = Canvas((-1.0, -1.0), 0.5, 22, 28)
    canvas.fill(area, 1)
    x, y = np.meshgrid(np.arange(28) * 0.5 - 0.75, 10 - (np.arange(22) * 0.5 + 0.25))
    near_border = shapely.dwithin(shapely.points(x, y), area.boundary, 1e-6)
    assert (((canvas.cells == 1) == shapely.contains_xy(area, x, y)) | near_border).all()


def test_lines_mark_every_cell_that_they_pass() -> None:
    canvas = Canvas((1.0, 2.0), 0.5, 4, 6)
    canvas.trace(shapely.LineString([(1.1, 2.1), (3.9, 2.1)]), 1)
    assert canvas.cells[3].tolist() == [1] * 6
    assert (canvas.cells[:3] == 2).all()


@pytest.mark.parametrize(("resolution_m", "image"), [(0.0, "pgm"), (math.nan, "pgm"), (1e-3, "pgm"), (0.05, "gif")])
def test_impossible_grids_are_refused(resolution_m: float, image: str, tmp_path: Path) -> None:
    with pytest.raises(MapFileError):
        write_map(_flat(), tmp_path / "x.yaml", "ros", resolution_m=resolution_m, image=image)

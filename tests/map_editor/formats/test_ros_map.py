"""ROS maps: pictures become walls, blocks and an outline, a list of them a building with elevators; floors become
pictures; both ways agree."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from robocorba.errors.maps import MapFileError
from robocorba.map_editor import validation
from robocorba.map_editor.formats import read_map, write_map
from robocorba.map_editor.formats.grid import Canvas
from robocorba.map_editor.formats.ros_picture import MAX_FILE_BYTES
from robocorba.map_editor.geometry import free_space, obstacles
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    ElevatorDoor,
    Floor,
    FloorMap,
    MapObject,
    with_topology,
)
from robocorba.map_editor.topology import topological_map
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.planning.space import FloorSpace
from tests.map_editor.formats.ros_files import BLACK, GREY, LIST, WHITE, write_ros, written_list
from tests.planning.scenes import room, wall

CELL_M = 0.05


def _flat() -> Building:
    """Two rooms joined by a door of 1 m, a slanted wall, a table and a post, 12 m x 8 m."""
    return room(
        *(12.0, 8.0, wall("middle", 6.03, 0.0, 6.03, 8.0), wall("slanted", 8.0, 1.0, 10.6, 4.2)),
        MapObject(name="table", shape=BoxShape(size=(1.4, 0.8)), at=(3.0, 4.0), heading=0.5),
        MapObject(name="post", shape=CircleShape(radius=0.3), at=(9.0, 6.0)),
        Door(name="door", a=(6.03, 3.0), b=(6.03, 4.0)),
    )


@pytest.mark.parametrize("image", ["pgm", "png"])
def test_a_floor_there_and_back(image: str, tmp_path: Path) -> None:
    """What is free stays free within two cells, also in the door. Blocks are few: table, post, the slanted wall, and
    the frame in pieces."""
    write_map(_flat(), tmp_path / "flat.yaml", "ros", image=image)
    again = read_map(tmp_path / "flat.yaml")
    assert again.format == "ros"
    assert validation.problems(again.building) == []
    old, new = free_space(_flat(), "L1", 0.3), free_space(again.building, "flat", 0.3)
    assert old.buffer(-2 * CELL_M).difference(new).area == new.buffer(-2 * CELL_M).difference(old).area == 0.0
    assert len(shapely.get_parts(new)) == len(shapely.get_parts(free_space(again.building, "flat", 0.4))) == 1
    plan = again.building.floors["flat"].geometrical
    assert plan.walls == {}
    assert all(name.startswith("block") for name in plan.objects)
    assert len(plan.objects) <= 6


def test_what_is_exported(tmp_path: Path) -> None:
    floor = _flat().floors["L1"]
    floor.geometrical.objects["heavy"] = MapObject("heavy", BoxShape((1.0, 1.0)), (3.0, 3.0), mass=5.0)
    upper = FloorMap(Floor(name="a b", level=1, elevation=3.0), _flat().floors["L1"].geometrical)
    building, path = Building("two", {"L1": floor, "a b": upper}), tmp_path / "two.yaml"
    exported = write_map(building, path, "ros", resolution_m=0.1)
    assert [path.name for path in exported.files] == ["two-L1.yaml", "two-L1.pgm", "two-a_b.yaml", "two-a_b.pgm"]
    assert sorted(exported.files) == sorted(tmp_path.iterdir())
    losses = {"doors became gaps in the walls: L1 door, a b door", "masses of objects are not kept: L1 heavy"}
    assert losses <= set(exported.losses)
    for resolution_m, image in ((0.0, "pgm"), (math.nan, "pgm"), (1e-3, "pgm"), (0.05, "gif")):
        with pytest.raises(MapFileError):
            write_map(_flat(), path, "ros", resolution_m=resolution_m, image=image)


def _room() -> np.ndarray:
    """A room of 40 x 20 free cells with unknown space around and a block of 4 x 4."""
    cells = np.full((30, 50), GREY, np.uint8)
    cells[5:25, 5:45] = WHITE
    cells[10:14, 20:24] = BLACK
    return cells


@pytest.mark.parametrize("kind", ["P2", "16"])
def test_other_kinds_of_pgm(kind: str, tmp_path: Path) -> None:
    path = write_ros(tmp_path, cells := _room())
    plain = read_map(path).building
    rows = "\n".join(" ".join(map(str, row)) for row in cells.tolist())
    wide = b"P5\n50 30\n65535\n" + (cells.astype(">u2") * 257).tobytes()
    (tmp_path / "map.pgm").write_bytes(wide if kind == "16" else f"P2\n# drawn\n50 30\n255\n{rows}\n".encode())
    path.write_text(path.read_text().replace("map.png", "map.pgm"))
    assert read_map(path).building == plain


@pytest.mark.parametrize(
    ("settings", "key", "reason"),
    [
        ({"image": "absent.png"}, "image", "no picture"),
        ({"image": "../map.png"}, "image", "in the folder"),
        ({"image": "map.yaml"}, "image", "unreadable picture"),
        ({"image": "é" * 190}, "image", "unreadable picture"),
        ({"resolution": 0}, "resolution", "above zero"),
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


@settings(max_examples=25, deadline=None)
@given(st.binary(max_size=300), st.sampled_from(HEADS))
def test_any_bytes_as_a_picture(tmp_path_factory: pytest.TempPathFactory, tail: bytes, head: bytes) -> None:
    folder = tmp_path_factory.mktemp("bytes")
    path = write_ros(folder, _room())
    (folder / "map.png").write_bytes(head + tail)
    try:
        assert validation.problems(read_map(path).building) == []
    except MapFileError as error:
        assert error.key == "image"


@settings(max_examples=30, deadline=None)
@given(arrays(np.uint8, (12, 14), elements=st.sampled_from([BLACK, GREY, WHITE, WHITE])))
@example(np.full((12, 14), BLACK))
def test_any_picture_makes_a_building_in_order(tmp_path_factory: pytest.TempPathFactory, cells: np.ndarray) -> None:
    path = write_ros(tmp_path_factory.mktemp("any"), cells)
    found, has_free = read_map(path), bool((cells == WHITE).any())
    assert validation.problems(found.building) == []
    outline = shapely.Polygon(found.building.floors["map"].floor.outline).buffer(1e-9)
    assert all(outline.covers(item.geometry) for item in obstacles(found.building, "map"))
    no_free_cell = "the picture has no free cell, the whole floor is blocked; check negate and the thresholds"
    assert (no_free_cell in found.losses) is not has_free
    assert has_free or _ground(path).is_empty


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 12), st.floats(0, 9)), min_size=3, max_size=7))
def test_areas_fill_the_cells_whose_middle_they_cover(points: list[tuple[float, float]]) -> None:
    area = shapely.MultiPoint(points).convex_hull.buffer(0.3).difference(shapely.box(4.9, 4.1, 6.3, 5.7))
    area = max(shapely.get_parts(area), key=lambda part: part.area)
    canvas = Canvas((-1.0, -1.0), 0.5, 22, 28)
    canvas.fill(area, 1)
    x, y = np.meshgrid(np.arange(28) * 0.5 - 0.75, 10 - (np.arange(22) * 0.5 + 0.25))
    near_border = shapely.dwithin(shapely.points(x, y), area.boundary, 1e-6)
    assert (((canvas.cells == 1) == shapely.contains_xy(area, x, y)) | near_border).all()
    canvas = Canvas((1.0, 2.0), 0.5, 4, 6)
    canvas.trace(shapely.LineString([(1.1, 2.1), (3.9, 2.1)]), 1)
    assert canvas.cells[3].tolist() == [1] * 6  # lines mark every cell that they pass
    assert (canvas.cells[:3] == 2).all()


def _ground(path: Path, **options: str) -> shapely.Geometry:
    """The ground of a floor: within the outline and outside of all solid objects."""
    building = read_map(path, **options).building
    (floor,) = building.floors
    solid = [item.geometry for item in obstacles(building, floor) if item.geometry.geom_type == "Polygon"]
    outline = building.floors[floor].floor.outline
    return shapely.Polygon(outline).difference(shapely.union_all(solid))


@pytest.mark.parametrize("thick", [1, 2])
def test_the_inside_of_a_thin_wall_is_no_ground(thick: int, tmp_path: Path) -> None:
    cells = np.full((60, 80), WHITE)
    cells[:thick], cells[-thick:], cells[:, :thick], cells[:, -thick:] = BLACK, BLACK, BLACK, BLACK
    cells[:40, 40 : 40 + thick] = BLACK
    path = write_ros(tmp_path, cells, resolution=1.0)
    space = FloorSpace(read_map(path).building, "map")
    rows, columns = np.nonzero(cells == BLACK)
    assert not any(space.is_ground(column + 0.5, 59.5 - row) for row, column in zip(rows, columns, strict=True))
    rows, columns = np.nonzero(cells == WHITE)
    assert all(space.is_ground(column + 0.5, 59.5 - row) for row, column in zip(rows, columns, strict=True))


def test_a_wing_apart_stays_on_the_floor(tmp_path: Path) -> None:
    """Two rooms of 12 and 6 m2 with unknown space between, and a speck of 0.04 m2 far away."""
    cells = np.full((100, 120), GREY)
    cells[20:50, 10:50] = cells[60:80, 70:100] = cells[90:92, 5:7] = WHITE
    path = write_ros(tmp_path, cells)
    found = read_map(path)
    floor, losses = found.building.floors["map"], found.losses
    assert shapely.Polygon(floor.floor.outline).bounds == pytest.approx((1.0, 2.0, 10.0, 8.0))
    assert sorted(part.area for part in shapely.get_parts(_ground(path))) == pytest.approx([6.0, 12.0])
    speck = "free space: 1 separate regions below 1 m2 count as blocked, 0.04 m2 in all: 0.04 m2 at (0.60, 0.90)"
    assert {speck, "unknown space: 36.0 m2 within the outline count as blocked"} <= set(losses)
    assert "unknown1" in floor.geometrical.objects


def test_what_lies_outside_of_the_outline_is_left_out(tmp_path: Path) -> None:
    cells = np.full((80, 80), GREY)
    cells[20:60, 20:60] = WHITE
    cells[18:20, 18:62] = BLACK
    cells[5:8, 5:8], cells[70:75, 3] = BLACK, WHITE
    left_out = "occupied space: 1 regions outside the outline are left out, 0.09 m2 in all: 0.09 m2 at (0.65, 7.35)"
    assert left_out in read_map(write_ros(tmp_path, cells)).losses


def _nav2_room(tmp_path: Path, **more: object) -> Path:
    """A room of 8 m2 in unknown space, saved by nav2's map_saver with the thresholds of its default."""
    cells = np.full((40, 60), GREY)
    cells[10:30, 10:50] = WHITE
    return write_ros(tmp_path, cells, **{"free_thresh": 0.25, **more})


GREY_205 = (
    "unknown cells: 1600 of grey 205 (16.0 m2) are below free_thresh 0.25 but count as blocked, "
    "since map_saver writes unknown cells in this grey; --unknown free makes them free"
)
FREE_CELLS = "unknown cells: 1600 (16.0 m2) count as free, as requested"


@pytest.mark.parametrize(
    ("more", "kind", "options", "ground_m2", "loss"),
    [
        ({}, "L", {}, 8.0, GREY_205),
        # In mode trinary map_server counts opacity as a shade, which makes grey 205 lighter than any threshold.
        ({"free_thresh": 0.196}, "LA", {}, 8.0, GREY_205.replace("0.25", "0.196")),
        ({}, "L", {"unknown": "free"}, 24.0, FREE_CELLS),
        ({"free_thresh": 0.196}, "L", {"unknown": "free"}, 24.0, FREE_CELLS),
        # Where map_saver does not write it, it is an ordinary shade.
        ({"mode": "scale"}, "L", {}, 24.0, ""),
        ({"negate": 1, "free_thresh": 0.85, "occupied_thresh": 0.9}, "L", {}, 16.0, ""),
    ],
)
def test_unknown_cells_of_a_nav2_map(
    more: dict[str, object], kind: str, options: dict[str, str], ground_m2: float, loss: str, tmp_path: Path
) -> None:
    path = _nav2_room(tmp_path, **more)
    Image.open(tmp_path / "map.png").convert(kind).save(tmp_path / "map.png")
    assert _ground(path, **options).area == pytest.approx(ground_m2)
    losses = [each for each in read_map(path, **options).losses if each.startswith("unknown cells")]
    assert losses == ([loss] if loss else [])


def _specks(tmp_path: Path, resolution: float = 0.05) -> Path:
    """A room with one speck beside its wall and one in the open, and a thing of two cells in the open."""
    cells = np.full((80, 100), WHITE)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = BLACK, BLACK, BLACK, BLACK
    cells[40, 3] = cells[40, 50] = cells[20, 30] = cells[20, 31] = BLACK
    return write_ros(tmp_path, cells, resolution=resolution)


NOISE = "specks: 1 of at most 0.05 m beside walls, 0.0025 m2, are removed as noise; --specks keep keeps them"
LEGS = "specks: 1 of at most 0.05 m away from walls are kept, as table legs; --specks all removes them"


@pytest.mark.parametrize(
    ("cell_m", "options", "open_things", "losses"),
    [
        (0.05, {}, 2, [NOISE, LEGS]),
        (0.05, {"specks": "walls"}, 2, [NOISE, LEGS]),
        (0.05, {"specks": "keep"}, 3, []),
        (0.05, {"specks": "all"}, 1, None),
        (0.1, {"specks": "all"}, 3, []),  # a cell of a coarse map is no speck
    ],
)
def test_specks_beside_walls_are_noise_and_legs_of_tables_stay(
    cell_m: float, options: dict[str, str], open_things: int, losses: list[str] | None, tmp_path: Path
) -> None:
    path = _specks(tmp_path, cell_m)
    (ground,) = shapely.get_parts(_ground(path, **options))
    assert len(ground.interiors) == open_things
    assert losses is None or [loss for loss in read_map(path, **options).losses if "specks" in loss] == losses
    for wrong in ({"unknown": "maybe"}, {"specks": "some"}):
        with pytest.raises(MapFileError, match="is not supported"):
            read_map(path, **wrong)
    cells = np.full((40, 40), WHITE)
    cells[20, 20] = GREY  # an unknown cell within free space is a speck too
    write_ros(tmp_path, cells, resolution=0.05)
    assert _ground(path).area == pytest.approx(4.0 - 0.0025)
    assert _ground(path, specks="all").area == pytest.approx(4.0)


def test_floors_and_elevators_of_a_list(tmp_path: Path) -> None:
    result = read_map(written_list(tmp_path))
    building = result.building
    assert (result.format, building.name) == ("ros", "lab")
    assert validation.problems(building) == []
    lower, upper = (entry.floor for entry in building.floors.values())
    assert (lower.name, lower.level, lower.elevation, lower.height) == ("L1", 1, 0.0, 3.0)
    assert (upper.name, upper.level, upper.elevation, upper.height) == ("L2", 2, 3.5, 3.2)
    assert np.allclose(lower.outline, upper.outline)
    for floor in ("L1", "L2"):
        building = with_topology(building, floor, topological_map(building, floor, 0.3))
        assert FloorSpace(building, floor).point_is_free(9.0, 3.0, 0.4)  # the shaft is opened
    path = PathPlanner(building).shortest(Place("L1", 2.0, 2.0), Place("L2", 2.0, 4.0))
    assert [point.floor for point in path.points][:: len(path.points) - 1] == ["L1", "L2"]
    assert building.elevators["E1"].doors == tuple(
        ElevatorDoor(floor=floor, side=CabinSide.LEFT, width=1.2) for floor in ("L1", "L2")
    )
    # 18 x 18 cells of the shaft, and 2 x 12 of the wall that the picture shows before its door.
    cleared = "L1: elevator 'E1': 3.48 m2 of its shaft and landings are not free in the picture and were cleared"
    assert cleared in result.losses
    elevator = {**LIST["elevators"][0], "doors": [{"floor": "L1", "side": "right"}]}
    losses = read_map(written_list(tmp_path, elevators=[elevator])).losses
    assert "L1: elevator 'E1': no free cell in front of its doors; check its position and their side" in losses
    listed = tmp_path / "up" / "first.yaml"
    listed.write_text(listed.read_text().replace("resolution: 0.1", "resolution: fine"))
    with pytest.raises(MapFileError, match="expected a number") as caught:
        read_map(tmp_path / "lab.yaml")
    assert (caught.value.file, caught.value.key) == (str(listed), "resolution")


@pytest.mark.parametrize(
    ("floors", "expected"),
    [
        ([{"elevation": -3.0}, {"elevation": 0.0}], [(-1, -3.0), (0, 0.0)]),
        ([{"level": 2}, {"level": 5}], [(2, 6.0), (5, 15.0)]),
    ],
)
def test_levels_and_elevations_follow_from_each_other(
    floors: list[dict[str, float]], expected: list[tuple[int, float]], tmp_path: Path
) -> None:
    listed = [{"name": name, "map": "ground.yaml", **floor} for name, floor in zip(("L1", "L2"), floors, strict=True)]
    building = read_map(written_list(tmp_path, floors=listed)).building
    assert [(entry.floor.level, entry.floor.elevation) for entry in building.floors.values()] == expected


def test_the_example_of_the_manual(tmp_path: Path) -> None:
    manual = (Path(__file__).parents[3] / "docs" / "formats.md").read_text()
    (tmp_path / "upper").mkdir()
    for folder, name in ((tmp_path, "ground"), (tmp_path / "upper", "first")):
        write_ros(folder, np.full((60, 120), WHITE), name)
    path = tmp_path / "lab.yaml"
    path.write_text("ros_maps: 1" + manual.split("```yaml\nros_maps: 1")[1].split("```")[0])
    building = read_map(path).building
    assert (list(building.floors), list(building.elevators)) == (["L1", "L2"], ["E1"])


def _listed(i: int, **change: Any) -> dict[str, Any]:
    """A change of the list: one floor with other values, None for a missing key."""
    floors = copy.deepcopy(LIST["floors"])
    floors[i] = {key: value for key, value in {**floors[i], **change}.items() if value is not None}
    return {"floors": floors}


def _elevator(**change: Any) -> dict[str, Any]:
    return {"elevators": [{**LIST["elevators"][0], **change}]}


@pytest.mark.parametrize(
    ("change", "key", "reason"),
    [
        ({"ros_maps": 2}, "ros_maps", "this release reads version 1, not 2"),
        ({"floors": []}, "floors", "no floor is listed"),
        (_listed(1, map=None), "floors[1]", "missing required field `map`"),
        (_listed(1, map="absent.yaml"), "floors[1].map", "there is no file of that name"),
        (_listed(1, map="../ground.yaml"), "floors[1].map", "must lie in the folder of the file"),
        (_listed(1, map="lab.yaml"), "floors[1].map", "not a map_server file"),
        (_listed(1, level=None), "floors[1]", "the key 'level' is missing; other floors give one"),
        ({"floors": [{"name": "L1", "map": "ground.yaml"}]}, "floors[0]", "the key 'level' or 'elevation' is missing"),
        (_listed(1, name="L1"), "floors[1].name", "there is a floor 'L1' already"),
        (_listed(1, level=1), "floors[1]", "level 1 is that of"),
        (_elevator(at=[11.5, 3.0]), "elevators[0]", "reaches beyond the picture of floor 'L1'"),
        (
            {"elevators": [LIST["elevators"][0], copy.deepcopy(LIST["elevators"][0])]},
            "elevators[1].name",
            "there is an elevator 'E1' already",
        ),
    ],
)
def test_what_is_wrong_is_named_with_line_and_key(
    change: dict[str, Any], key: str, reason: str, tmp_path: Path
) -> None:
    path = written_list(tmp_path, **change)
    with pytest.raises(MapFileError) as caught:
        read_map(path)
    assert caught.value.file == str(path)
    assert caught.value.key == key
    assert reason in caught.value.reason
    assert caught.value.line > 0

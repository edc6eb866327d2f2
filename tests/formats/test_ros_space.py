"""What of a picture is ground: nothing else, nothing less, and what is left out is reported with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from robocorba.errors.maps import MapFileError
from robocorba.maps import validation
from robocorba.maps.formats import read_map
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import FloorMap
from robocorba.maps.topology import topological_map
from robocorba.planning.space import FloorSpace
from tests.formats.ros_files import BLACK, GREY, WHITE, write_ros


def _floor(path: Path, **options: str) -> tuple[FloorMap, tuple[str, ...]]:
    result = read_map(path, **options)
    assert validation.problems(result.building) == []
    (floor,) = result.building.floors.values()
    return floor, result.losses


def _ground(path: Path, **options: str) -> shapely.Geometry:
    """The ground of a floor: within the outline and outside of all solid objects."""
    building = read_map(path, **options).building
    (floor,) = building.floors
    solid = [item.geometry for item in obstacles(building, floor) if item.geometry.geom_type == "Polygon"]
    outline = building.floors[floor].floor.outline
    return shapely.Polygon(outline).difference(shapely.union_all(solid))


def _shades(cells: np.ndarray, points: list[tuple[float, float]]) -> set[int]:
    """The grey of the cells of 0.1 m in which points lie."""
    return {int(cells[len(cells) - 1 - int(y / 0.1), int(x / 0.1)]) for x, y in points}


def test_roads_stay_in_the_white_room_of_a_black_picture(tmp_path: Path) -> None:
    cells = np.full((200, 200), BLACK)
    cells[60:140, 50:120] = WHITE
    path = write_ros(tmp_path, cells)
    building = read_map(path).building
    roads = topological_map(building, "map", 0.3)
    assert roads.nodes
    assert _shades(cells, [node.at for node in roads.nodes.values()]) == {WHITE}
    assert _ground(path).area == pytest.approx(56.0)
    assert not FloorSpace(building, "map").is_ground(2.0, 2.0)


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


def test_robots_keep_their_radius_from_occupied_cells(tmp_path: Path) -> None:
    """Obstacles are never farther than the occupied cells, and half a cell nearer at most."""
    noise = np.random.default_rng(5)
    cells = np.where(noise.random((60, 60)) < 0.2, BLACK, WHITE)
    path = write_ros(tmp_path, cells, resolution=1.0)
    building = read_map(path).building
    shapes = shapely.union_all([item.geometry for item in obstacles(building, "map")])
    row, column = np.nonzero(cells == BLACK)
    squares = shapely.union_all(
        [*shapely.box(column, 59 - row, column + 1, 60 - row), shapely.box(0, 0, 60, 60).exterior]
    )
    for x, y in noise.random((400, 2)) * 60:
        here = shapely.Point(x, y)
        assert squares.distance(here) - 0.5 - 1e-9 <= shapes.distance(here) <= squares.distance(here) + 1e-9


def test_a_wing_apart_stays_on_the_floor(tmp_path: Path) -> None:
    """Two rooms of 12 and 6 m2 with unknown space between, and a speck of 0.04 m2 far away."""
    cells = np.full((100, 120), GREY)
    cells[20:50, 10:50] = WHITE
    cells[60:80, 70:100] = WHITE
    cells[90:92, 5:7] = WHITE
    floor, losses = _floor(write_ros(tmp_path, cells))
    assert shapely.Polygon(floor.floor.outline).bounds == pytest.approx((1.0, 2.0, 10.0, 8.0))
    ground = _ground(write_ros(tmp_path, cells))
    assert sorted(part.area for part in shapely.get_parts(ground)) == pytest.approx([6.0, 12.0])
    assert (
        "free space: 1 separate regions below 1 m2 count as blocked, 0.04 m2 in all: 0.04 m2 at (0.60, 0.90)" in losses
    )
    assert "unknown space: 36.0 m2 within the outline count as blocked" in losses


def test_nothing_lies_outside_of_the_outline(tmp_path: Path) -> None:
    cells = np.full((80, 80), GREY)
    cells[20:60, 20:60] = WHITE
    cells[18:20, 18:62] = BLACK
    cells[5:8, 5:8], cells[70:75, 3] = BLACK, WHITE
    floor, losses = _floor(write_ros(tmp_path, cells))
    outline = shapely.Polygon(floor.floor.outline).buffer(1e-9)
    building = read_map(tmp_path / "map.yaml").building
    assert floor.geometrical.walls == {}
    assert all(outline.covers(item.geometry) for item in obstacles(building, "map"))
    assert (
        "occupied space: 1 regions outside the outline are left out, 0.09 m2 in all: 0.09 m2 at (0.65, 7.35)"
    ) in losses


def test_a_picture_without_free_cells_blocks(tmp_path: Path) -> None:
    _, losses = _floor(write_ros(tmp_path, np.full((20, 30), BLACK)))
    assert "the picture has no free cell, the whole floor is blocked; check negate and the thresholds" in losses
    assert _ground(tmp_path / "map.yaml").is_empty


def _nav2_room(tmp_path: Path, **more: object) -> Path:
    """A room of 8 m2 in unknown space, saved by nav2's map_saver with the thresholds of its default."""
    cells = np.full((40, 60), GREY)
    cells[10:30, 10:50] = WHITE
    return write_ros(tmp_path, cells, **{"free_thresh": 0.25, **more})


def test_unknown_cells_of_a_nav2_map_block_and_are_reported(tmp_path: Path) -> None:
    path = _nav2_room(tmp_path)
    assert _ground(path).area == pytest.approx(8.0)
    assert (
        "unknown cells: 1600 of grey 205 (16.0 m2) are below free_thresh 0.25 but count as blocked, "
        "since map_saver writes unknown cells in this grey; --unknown free makes them free"
    ) in read_map(path).losses


def test_unknown_cells_of_a_picture_with_opacity_block(tmp_path: Path) -> None:
    """In mode trinary map_server counts opacity as a shade, which makes grey 205 lighter than any threshold."""
    path = _nav2_room(tmp_path, free_thresh=0.196)
    Image.open(tmp_path / "map.png").convert("LA").save(tmp_path / "map.png")
    assert _ground(path).area == pytest.approx(8.0)


@pytest.mark.parametrize("free_thresh", [0.25, 0.196])
def test_unknown_cells_are_free_where_that_is_asked_for(free_thresh: float, tmp_path: Path) -> None:
    path = _nav2_room(tmp_path, free_thresh=free_thresh)
    assert _ground(path, unknown="free").area == pytest.approx(24.0)
    losses = read_map(path, unknown="free").losses
    assert "unknown cells: 1600 (16.0 m2) count as free, as requested" in losses


@pytest.mark.parametrize("more", [{"mode": "scale"}, {"negate": 1, "free_thresh": 0.85, "occupied_thresh": 0.9}])
def test_grey_205_is_an_ordinary_shade_where_map_saver_does_not_write_it(
    more: dict[str, object], tmp_path: Path
) -> None:
    losses = read_map(_nav2_room(tmp_path, **more)).losses
    assert not [loss for loss in losses if "grey 205" in loss]


def _specks(tmp_path: Path, resolution: float = 0.05) -> Path:
    """A room with one speck beside its wall and one in the open, and a thing of two cells in the open."""
    cells = np.full((80, 100), WHITE)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = BLACK, BLACK, BLACK, BLACK
    cells[40, 3] = cells[40, 50] = cells[20, 30] = cells[20, 31] = BLACK
    return write_ros(tmp_path, cells, resolution=resolution)


@pytest.mark.parametrize(
    ("options", "open_things"), [({}, 2), ({"specks": "walls"}, 2), ({"specks": "keep"}, 3), ({"specks": "all"}, 1)]
)
def test_specks_beside_walls_are_noise_and_legs_of_tables_stay(
    options: dict[str, str], open_things: int, tmp_path: Path
) -> None:
    ground = _ground(_specks(tmp_path), **options)
    (room,) = shapely.get_parts(ground)
    assert len(room.interiors) == open_things


def test_removed_specks_are_reported(tmp_path: Path) -> None:
    path = _specks(tmp_path)
    assert read_map(path).losses[:2] == (
        "specks: 1 of at most 0.05 m beside walls, 0.0025 m2, are removed as noise; --specks keep keeps them",
        "specks: 1 of at most 0.05 m away from walls are kept, as table legs; --specks all removes them",
    )
    assert not [loss for loss in read_map(path, specks="keep").losses if "specks" in loss]


def test_an_unknown_cell_within_free_space_is_a_speck(tmp_path: Path) -> None:
    cells = np.full((40, 40), WHITE)
    cells[20, 20] = GREY
    path = write_ros(tmp_path, cells, resolution=0.05)
    assert _ground(path).area == pytest.approx(4.0 - 0.0025)
    assert _ground(path, specks="all").area == pytest.approx(4.0)


def test_a_cell_of_a_coarse_map_is_no_speck(tmp_path: Path) -> None:
    path = _specks(tmp_path, resolution=0.1)
    assert not [loss for loss in read_map(path, specks="all").losses if "specks" in loss]


@pytest.mark.parametrize("options", [{"unknown": "maybe"}, {"specks": "some"}])
def test_options_that_do_not_exist_are_refused(options: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="is not supported"):
        read_map(_specks(tmp_path), **options)

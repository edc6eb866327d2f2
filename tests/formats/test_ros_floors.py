"""A list of ROS maps and elevators becomes one building; what is wrong in it is named with line and key."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.maps import MapFileError
from robocorba.maps import validation
from robocorba.maps.formats import read_map
from robocorba.maps.model import Building, CabinSide, ElevatorDoor
from robocorba.maps.topology import topological_map
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.planning.space import FloorSpace
from tests.formats.hostile import HOSTILE, changed, places
from tests.formats.rmf_files import written
from tests.formats.ros_files import BLACK, GREY, WHITE, write_ros

LIST: dict[str, Any] = {
    "ros_maps": 1,
    "name": "lab",
    "floors": [
        {"name": "L1", "level": 1, "elevation": 0.0, "map": "ground.yaml"},
        {"name": "L2", "level": 2, "elevation": 3.5, "height": 3.2, "map": "up/first.yaml"},
    ],
    "elevators": [
        {
            "name": "E1",
            "at": [9.0, 3.0],
            "size": [1.8, 1.8],
            "doors": [{"floor": "L1", "side": "left", "width": 1.2}, {"floor": "L2", "side": "left", "width": 1.2}],
        }
    ],
}


def _written(folder: Path, **change: Any) -> Path:
    """A list of two floors of 8 m x 6 m; the elevator's shaft is black and unknown, the door closed."""
    cells = np.full((60, 120), GREY)
    cells[:, :80] = BLACK
    cells[1:-1, 1:-1][:, :78] = WHITE
    cells[18:42, 79:102] = BLACK
    cells[22:38, 82:98] = GREY
    (folder / "up").mkdir(exist_ok=True)
    write_ros(folder, cells, "ground")
    # The upper picture is larger: its origin says where it lies in the frame of the building.
    write_ros(folder / "up", np.pad(cells, 10, constant_values=GREY), "first", origin=[-1.0, -1.0, 0.0])
    path = folder / "lab.yaml"
    path.write_text(yaml.safe_dump({**copy.deepcopy(LIST), **change}, sort_keys=False))
    return path


def _with_roads(building: Building) -> Building:
    for floor in building.floors:
        roads = topological_map(building, floor, 0.3)
        for element in [*roads.nodes.values(), *roads.edges.values()]:
            building = building.with_element(floor, element)
    return building


def test_floors_and_elevators_of_a_list(tmp_path: Path) -> None:
    result = read_map(_written(tmp_path))
    building = result.building
    assert result.format == "ros"
    assert validation.problems(building) == []
    assert building.name == "lab"
    floors = {name: entry.floor for name, entry in building.floors.items()}
    assert [(name, floor.level, floor.elevation, floor.height) for name, floor in floors.items()] == [
        ("L1", 1, 0.0, 3.0),
        ("L2", 2, 3.5, 3.2),
    ]
    assert np.allclose(floors["L1"].outline, floors["L2"].outline)
    assert building.elevators["E1"].doors == (
        ElevatorDoor(floor="L1", side=CabinSide.LEFT, width=1.2),
        ElevatorDoor(floor="L2", side=CabinSide.LEFT, width=1.2),
    )
    # 18 x 18 cells of the shaft, and 2 x 12 of the wall that the picture shows before its door.
    assert "L1: elevator 'E1': 3.48 m2 of its shaft and landings are not free in the picture and were cleared" in (
        result.losses
    )


def test_the_shaft_is_opened_and_joined_to_the_floor(tmp_path: Path) -> None:
    building = _with_roads(read_map(_written(tmp_path)).building)
    for floor in ("L1", "L2"):
        assert FloorSpace(building, floor).point_is_free(9.0, 3.0, 0.4)
    path = PathPlanner(building).shortest(Place("L1", 2.0, 2.0), Place("L2", 2.0, 4.0))
    assert [point.floor for point in path.points][:: len(path.points) - 1] == ["L1", "L2"]


@pytest.mark.parametrize(
    ("floors", "expected"),
    [
        ([{"elevation": -3.0}, {"elevation": 0.0}], [(-1, -3.0), (0, 0.0)]),
        ([{"level": 2}, {"level": 5}], [(2, 6.0), (5, 15.0)]),
        ([{"level": 5}, {"level": 2}], [(2, 6.0), (5, 15.0)]),
    ],
)
def test_levels_and_elevations_follow_from_each_other(
    floors: list[dict[str, float]], expected: list[tuple[int, float]], tmp_path: Path
) -> None:
    listed = [{"name": name, "map": "ground.yaml", **floor} for name, floor in zip(("L1", "L2"), floors, strict=True)]
    building = read_map(_written(tmp_path, floors=listed)).building
    assert [(entry.floor.level, entry.floor.elevation) for entry in building.floors.values()] == expected


def test_the_example_of_the_manual(tmp_path: Path) -> None:
    manual = (Path(__file__).parents[2] / "docs" / "formats.md").read_text()
    (tmp_path / "upper").mkdir()
    for folder, name in ((tmp_path, "ground"), (tmp_path / "upper", "first")):
        write_ros(folder, np.full((60, 120), WHITE), name)
    path = tmp_path / "lab.yaml"
    path.write_text("ros_maps: 1" + manual.split("```yaml\nros_maps: 1")[1].split("```")[0])
    building = read_map(path).building
    assert (list(building.floors), list(building.elevators)) == (["L1", "L2"], ["E1"])


def test_an_elevator_whose_doors_lead_nowhere_is_reported(tmp_path: Path) -> None:
    elevator = {**LIST["elevators"][0], "doors": [{"floor": "L1", "side": "right"}]}
    losses = read_map(_written(tmp_path, elevators=[elevator])).losses
    assert "L1: elevator 'E1': no free cell in front of its doors; check its position and their side" in losses


def _floor(i: int, **change: Any) -> dict[str, Any]:
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
        ({"colour": "red"}, "colour", "there is no such key"),
        (_floor(1, walls=[]), "floors[1].walls", "there is no such key"),
        (_floor(1, map=None), "floors[1]", "missing required field `map`"),
        (_floor(1, map=7), "floors[1].map", "Expected `str`"),
        (_floor(1, map="absent.yaml"), "floors[1].map", "there is no file of that name"),
        (_floor(1, map="../ground.yaml"), "floors[1].map", "must lie in the folder of the file"),
        (_floor(1, map="lab.yaml"), "floors[1].map", "not a map_server file"),
        (_floor(1, level=None), "floors[1]", "the key 'level' is missing; other floors give one"),
        (_floor(1, name="L1"), "floors[1].name", "there is a floor 'L1' already"),
        (_floor(1, name="L:1"), "floors[1]", "must not hold ':'"),
        (_floor(1, level=1), "floors[1]", "level 1 is that of"),
        (_floor(1, elevation=-1.0), "floors[1]", "does not fit"),
        (_floor(1, height=-1.0), "floors[1]", "height must be"),
        (_elevator(size=[0.0, 1.8]), "elevators[0]", "size x must be"),
        (_elevator(at=[11.5, 3.0]), "elevators[0]", "reaches beyond the picture of floor 'L1'"),
        (_elevator(doors=[{"floor": "L3"}]), "elevators[0]", "which does not exist"),
        (_elevator(cabin=1), "elevators[0].cabin", "there is no such key"),
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
    path = _written(tmp_path, **change)
    with pytest.raises(MapFileError) as caught:
        read_map(path)
    assert caught.value.file == str(path)
    assert caught.value.key == key
    assert reason in caught.value.reason
    assert caught.value.line > 0


def test_a_floor_needs_a_level_or_an_elevation(tmp_path: Path) -> None:
    path = _written(tmp_path, floors=[{"name": "L1", "map": "ground.yaml"}], elevators=[])
    with pytest.raises(MapFileError, match="the key 'level' or 'elevation' is missing"):
        read_map(path)


def test_what_is_wrong_in_a_listed_map_is_named_there(tmp_path: Path) -> None:
    path = _written(tmp_path)
    listed = tmp_path / "up" / "first.yaml"
    listed.write_text(listed.read_text().replace("resolution: 0.1", "resolution: fine"))
    with pytest.raises(MapFileError, match="expected a number") as caught:
        read_map(path)
    assert caught.value.file == str(listed)
    assert caught.value.key == "resolution"


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(list(places(LIST))), st.sampled_from(HOSTILE))
def test_a_hostile_value_anywhere(
    tmp_path_factory: pytest.TempPathFactory, place: tuple[Any, ...], change: Any
) -> None:
    folder = tmp_path_factory.mktemp("hostile")
    path = _written(folder)
    path.write_bytes(written(changed(LIST, place, change)))
    try:
        assert validation.problems(read_map(path).building) == []
    except MapFileError as error:
        assert error.line >= 1
        assert len(str(error)) < 2_000

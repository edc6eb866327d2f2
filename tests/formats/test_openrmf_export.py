"""What is written as building.yaml reads back as the same building, up to the losses that are listed."""

from __future__ import annotations

import functools
import unicodedata
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry.base import BaseGeometry

from robocorba.maps import validation
from robocorba.maps.formats import openrmf, openrmf_export, read_map, write_map
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import (
    Area,
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    DoorKind,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    Wall,
)
from robocorba.maps.yaml_file import parse_yaml
from robocorba.testing.buildings import with_all
from tests.formats.rmf_files import real_file
from tests.formats.ros_files import BLACK, WHITE, write_ros
from tests.planning.scenes import edge, node, wall

NFC = functools.partial(unicodedata.normalize, "NFC")
numbers = st.floats(0.0, 4.0, allow_subnormal=False)
words = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=8).map(NFC)
names = words | st.sampled_from(["1", "yes", "~", "null", "1e-05", "0x1f", "w0", "n1", "a: b", "- x", "'", "[1]"])
leaves = st.sampled_from([kind for kind in DoorKind if kind is not DoorKind.OPENING])


@st.composite
def roads(draw: st.DrawFn, elevator: Elevator | None) -> list[Element]:
    """Nodes in rows between the walls, edges along a row, and a node in the cabin."""
    rows: list[list[PathNode]] = [[], []]
    for name in draw(st.lists(names.filter(lambda name: name != "cabin"), unique=True, max_size=6)):
        which = draw(st.integers(0, 1))
        rows[which].append(PathNode(name=name, at=(len(rows[which]) + draw(numbers) / 8, 1.0 + 2 * which)))
    edges: dict[str, PathEdge] = {}
    some = st.just(0.0) | st.floats(0.01, 5.0)
    for a, b in (pair for row in rows for pair in pairwise(row)):
        name = draw(st.just(f"{a.name}-{b.name}") | names)
        graphs = tuple(draw(st.lists(names, unique=True, min_size=1, max_size=3)))
        rules = {"one_way": draw(st.booleans()), "speed_limit": draw(some), "clearance": draw(some), "graphs": graphs}
        edges.setdefault(name, PathEdge(name=name, a=a.name, b=b.name, **rules))
    cabins = [PathNode("cabin", elevator.at, elevator.name)] if elevator else []
    return [*rows[0], *rows[1], *cabins, *edges.values()]


@st.composite
def elevators(draw: st.DrawFn, floors: list[str]) -> Elevator:
    """One elevator that serves every floor, through one or two sides."""
    size = (draw(st.floats(1.0, 3.0)), draw(st.floats(1.0, 3.0)))
    doors = []
    for floor in floors:
        for side in draw(st.lists(st.sampled_from(list(CabinSide)), unique=True, min_size=1, max_size=2)):
            length = size[0] if side in (CabinSide.FRONT, CabinSide.BACK) else size[1]
            width = draw(st.floats(0.5, length))
            room = (length - width) / 2
            doors.append(ElevatorDoor(floor=floor, side=side, width=width, offset=draw(st.floats(-room, room))))
    at = (20 + draw(numbers), draw(numbers))
    return Elevator(name=draw(names), at=at, size=size, heading=draw(st.floats(-3.0, 3.0)), doors=tuple(doors))


@st.composite
def buildings(draw: st.DrawFn) -> Building:
    """Buildings in order, of what the format can hold."""
    labels = st.lists(names, unique=True, max_size=3)
    floor_names = draw(
        st.lists(names.filter(lambda name: not {":", "/"} & set(name)), unique=True, min_size=1, max_size=3)
    )
    lift = draw(st.none() | elevators(floor_names))
    below = draw(st.integers(0, len(floor_names)))
    outline = draw(st.sampled_from([(), ((-2.0, -2.0), (30.0, -2.0), (30.0, 12.0), (-2.0, 12.0))]))
    building = Building(draw(names), {}, {lift.name: lift} if lift else {})
    for level, name in enumerate(floor_names, -below):
        elements: list[Element] = [
            Wall(label, (draw(numbers) - 1, 2.0 * k), (draw(numbers) + 5, 2.0 * k), draw(numbers) + 1)
            for k, label in enumerate(draw(labels))
        ]
        elements += [
            Door(label, (k + draw(numbers) / 8, 8.0), (k + 0.8, 8.0), draw(leaves))
            for k, label in enumerate(draw(labels))
        ]
        elements += draw(roads(lift))
        floor = Floor(name=name, level=level, elevation=level * 4.0 + draw(numbers) / 2, outline=outline)
        building = with_all(building, [("", floor), *((name, element) for element in elements)])
    return building


@settings(max_examples=60, deadline=None)
@given(buildings())
def test_what_is_written_reads_back_equal(building: Building) -> None:
    assert validation.problems(building) == []
    text, losses = openrmf_export.dumps(building)
    assert all(loss.startswith(("doors: hinge side", "graphs: the format's tools")) for loss in losses)
    result = openrmf.read(parse_yaml(text.encode(), "written"))
    assert result.building == building


def _floor(*elements: Element) -> Building:
    """A building with one floor G."""
    return with_all(Building("b"), [("", Floor("G", 0, 0.0)), *(("G", element) for element in elements)])


def _losses(building: Building, tmp_path: Path) -> tuple[str, ...]:
    return write_map(building, tmp_path / "b.building.yaml", "openrmf").losses


def test_walls_are_cut_where_doors_open_them(tmp_path: Path) -> None:
    building = _floor(wall("long", 0.0, 0.0, 10.0, 0.0), Door(name="d", a=(4.0, 0.0), b=(5.0, 0.0)))
    assert "walls were cut at doors and landings: G long" in _losses(building, tmp_path)
    again = read_map(tmp_path / "b.building.yaml").building
    walls = again.floors["G"].geometrical.walls.values()
    assert list(walls) == [wall("long", 0.0, 0.0, 4.0, 0.0), wall("long_2", 5.0, 0.0, 10.0, 0.0)]


def test_losses_are_named(tmp_path: Path) -> None:
    building = _floor(
        MapObject("table", BoxShape((1.0, 1.0)), (3.0, 3.0)),
        MapObject("post", CircleShape(0.2), (5.0, 3.0)),
        Door(name="gap", a=(0.0, 8.0), b=(1.0, 8.0), kind=DoorKind.OPENING),
        Door(name="shut", a=(2.0, 8.0), b=(3.0, 8.0), locked=True),
        Area(name="hall", polygon=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
        *(node("a", 0.0, 0.0), node("b", 1.0, 0.0), edge("a", "b")),
    )
    losses = "\n".join(_losses(building, tmp_path))
    for part in (
        "objects: 2 left out, the format has models but no shapes: G table, G post",
        "areas: 1 left out: G hall",
        "doors without a leaf became gaps in the walls: G gap",
        "their lock is not kept: G shut",
        "edges without a graph are written to every graph: 0",
    ):
        assert part in losses
    lanes = yaml.safe_load((tmp_path / "b.building.yaml").read_text())["levels"]["G"]["lanes"]
    assert [lane[2]["graph_idx"] for lane in lanes] == [[2, 0]]


@pytest.mark.parametrize("name", ["hotel", "office"])
def test_real_buildings_survive(name: str, tmp_path: Path) -> None:
    building = read_map(real_file(name)).building
    write_map(building, tmp_path / "again.building.yaml", "openrmf")
    again = read_map(tmp_path / "again.building.yaml").building
    assert again.elevators == building.elevators
    for floor, entry in building.floors.items():
        assert again.floors[floor].topological == entry.topological
        assert again.floors[floor].geometrical.doors == entry.geometrical.doors
        for kind in ("wall", "object", "floor"):
            before, after = _blocked(building, floor, kind), _blocked(again, floor, kind)
            assert before.is_empty == after.is_empty
            assert before.is_empty or before.hausdorff_distance(after) < 1e-3


def _blocked(building: Building, floor: str, kind: str) -> BaseGeometry:
    return shapely.union_all([item.geometry for item in obstacles(building, floor) if item.kind == kind])


def test_blocks_of_a_ros_map_become_walls(tmp_path: Path) -> None:
    """The format has no solid shapes; without walls a floor that was read from a picture would be all ground."""
    cells = np.full((60, 80), BLACK)
    cells[5:55, 5:75] = WHITE
    cells[20:30, 20:30] = BLACK
    building = read_map(write_ros(tmp_path, cells)).building
    exported = write_map(building, tmp_path / "b.building.yaml", "openrmf")
    assert [loss for loss in exported.losses if "solid blocks" in loss] == [
        "solid blocks became walls along their outlines: map block1, map block2, map block3"
    ]
    again = read_map(tmp_path / "b.building.yaml").building
    old, new = (
        shapely.union_all([item.geometry.boundary if item.kind == "object" else item.geometry for item in found])
        for found in (obstacles(building, "map"), obstacles(again, "map"))
    )
    assert old.hausdorff_distance(new) < 1e-9

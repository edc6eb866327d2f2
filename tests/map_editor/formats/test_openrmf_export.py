"""What is written as building.yaml reads back as the same building, up to the losses that are listed."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import shapely
import yaml
from hypothesis import example, given, settings
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.formats import openrmf, openrmf_export, read_map, write_map
from robocorba.map_editor.formats.map_format import ReadOptions
from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    CircleShape,
    Door,
    DoorKind,
    Element,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    Wall,
)
from robocorba.map_editor.yaml_file import parse_yaml
from testkit.buildings import buildings, two_floors, with_all
from tests.map_editor.formats.ros_files import BLACK, WHITE, write_ros
from tests.planning.scenes import edge, node, wall

NAMES = [
    "1",
    "yes",
    "~",
    "null",
    "1e-05",
    "0x1f",
    "w0",
    "n1",
    "a: b",
    "- x",
    "'",
    "[1]",
    "\u00e9 \u7b2c",
    '"',
    "{}",
    "%",
]


def _read(building: Building) -> Building:
    """A building as it is written."""
    return openrmf.read(parse_yaml(openrmf_export.dumps(building)[0].encode(), "written"), ReadOptions()).building


@settings(max_examples=30, deadline=None)
@given(buildings().filter(lambda building: bool(building.floors)))
@example(two_floors())
def test_what_is_written_reads_back_and_is_the_same_when_it_is_written_again(building: Building) -> None:
    again = _read(building)
    assert _read(again) == again
    heights = {name: entry.floor.elevation for name, entry in building.floors.items()}
    upwards = {
        name: msgspec.structs.replace(lift, doors=tuple(sorted(lift.doors, key=lambda door: heights[door.floor])))
        for name, lift in building.elevators.items()
    }
    assert (again.name, again.elevators) == (building.name, upwards)
    for name, entry in building.floors.items():
        new = again.floors[name]
        assert new.topological.nodes == entry.topological.nodes
        assert new.floor == msgspec.structs.replace(entry.floor, level=new.floor.level, outline=new.floor.outline)
        assert {edge.name: (edge.a, edge.b) for edge in new.topological.edges.values()} == {
            edge.name: (edge.a, edge.b) for edge in entry.topological.edges.values()
        }
        doors = entry.geometrical.doors.items()
        assert new.geometrical.doors == {
            label: msgspec.structs.replace(door, locked=False)
            for label, door in doors
            if door.kind is not DoorKind.OPENING
        }
        before, after = _blocked(building, name, "wall"), _blocked(again, name, "wall")
        assert before.is_empty == after.is_empty
        assert before.is_empty or before.hausdorff_distance(after) < 1e-3


def test_names_and_rules_read_back_equal() -> None:
    elements: list[Element] = []
    for i, name in enumerate(NAMES):
        elements += [Wall(name, (0.0, float(i)), (9.0, float(i)), 1.0 + i), Door(name, (9.5, i), (9.5, i + 0.8))]
        elements.append(PathNode(name, (2.0, i + 0.5)))
    for a, b in pairwise(NAMES):
        rules = {"one_way": len(a) > 1, "speed_limit": 0.3, "clearance": 0.2, "graphs": (a, b)}
        elements.append(PathEdge(name=f"{a}-{b}" if len(b) > 1 else b, a=a, b=b, **rules))
    outline = ((-1.0, -1.0), (20.0, -1.0), (20.0, 30.0), (-1.0, 30.0))
    building = msgspec.structs.replace(_floor(*elements), name="null")
    building = building.with_element("", Floor("G", 0, 0.0, outline=outline))
    assert _read(building) == building


def _floor(*elements: Element) -> Building:
    """A building with one floor G."""
    return with_all(Building("b"), [("", Floor("G", 0, 0.0)), *(("G", element) for element in elements)])


def test_losses_are_named(tmp_path: Path) -> None:
    building = _floor(
        MapObject("table", BoxShape((1.0, 1.0)), (3.0, 3.0)),
        MapObject("post", CircleShape(0.2), (5.0, 3.0)),
        Door(name="gap", a=(0.0, 8.0), b=(1.0, 8.0), kind=DoorKind.OPENING),
        Door(name="shut", a=(2.0, 8.0), b=(3.0, 8.0), locked=True),
        Area(name="hall", polygon=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
        *(node("a", 0.0, 0.0), node("b", 1.0, 0.0), edge("a", "b")),
        *(wall("long", 0.0, -2.0, 10.0, -2.0), Door(name="d", a=(4.0, -2.0), b=(5.0, -2.0))),
    )
    losses = "\n".join(write_map(building, tmp_path / "b.building.yaml", "openrmf").losses)
    for part in (
        "objects: 2 left out, the format has models but no shapes: G table, G post",
        "areas: 1 left out: G hall",
        "doors without a leaf became gaps in the walls: G gap",
        "their lock is not kept: G shut",
        "edges without a graph are written to every graph: 0",
        "walls were cut at doors and landings: G long",
    ):
        assert part in losses
    walls = read_map(tmp_path / "b.building.yaml").building.floors["G"].geometrical.walls.values()
    assert list(walls) == [wall("long", 0.0, -2.0, 4.0, -2.0), wall("long_2", 5.0, -2.0, 10.0, -2.0)]
    lanes = yaml.safe_load((tmp_path / "b.building.yaml").read_text())["levels"]["G"]["lanes"]
    assert [lane[2]["graph_idx"] for lane in lanes] == [[2, 0]]


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

"""Renaming: everything that refers to the element follows, as one edit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robocorba.errors.maps import DuplicateElement, InvalidElement, StaleEdit, UnknownElement
from robocorba.maps.map_building_agent import BuildingEditor
from robocorba.maps.model import Building, ElementKind
from robocorba.maps.validation import problems

WALL, NODE, EDGE, FLOOR, ELEVATOR = (
    *(ElementKind.WALL, ElementKind.NODE, ElementKind.EDGE),
    *(ElementKind.FLOOR, ElementKind.ELEVATOR),
)


def test_a_node_is_renamed_in_its_edges(editor: BuildingEditor, building: Building) -> None:
    assert editor.rename(NODE, "L1", "east", "hall", 1) == 2
    topology = editor.building.floors["L1"].topological
    assert set(topology.nodes) == {"west", "hall", "lift1"}
    assert [(edge.a, edge.b) for edge in topology.edges.values()] == [("west", "hall"), ("hall", "lift1")]
    assert [edit.summary for edit in editor.edits_since(1)] == ["node east on L1 renamed to hall"]
    editor.undo(2)
    assert editor.building == building


def test_a_floor_is_renamed_with_all_on_it_and_in_elevators(
    editor: BuildingEditor, building: Building, file: Path
) -> None:
    editor.rename(FLOOR, "", "L1", "lobby", 1)
    after = editor.building
    assert list(after.floors) == ["lobby", "L2"]
    assert after.floors["lobby"].geometrical == building.floors["L1"].geometrical
    assert after.floors["lobby"].topological == building.floors["L1"].topological
    assert after.elevators["E1"].floors() == ("lobby", "L2")
    assert problems(after) == []
    assert editor.read(WALL, "lobby", "w")[1] == 2
    assert editor._store.load().building == after
    editor.rename(WALL, "lobby", "w", "w2", 2)


def test_an_elevator_is_renamed_in_its_nodes(editor: BuildingEditor) -> None:
    editor.rename(ELEVATOR, "", "E1", "lift", 1)
    for floor, node in (("L1", "lift1"), ("L2", "lift2")):
        assert editor.building.floors[floor].topological.nodes[node].elevator == "lift"
    assert problems(editor.building) == []


@pytest.mark.parametrize(
    ("error", "arguments"),
    [
        (UnknownElement, (NODE, "L1", "nobody", "x", 1)),
        (StaleEdit, (NODE, "L1", "east", "x", 2)),
        (DuplicateElement, (NODE, "L1", "east", "west", 1)),
        (DuplicateElement, (FLOOR, "", "L1", "L2", 1)),
        (InvalidElement, (NODE, "L1", "east", "", 1)),
        (InvalidElement, (FLOOR, "", "L1", "a/b", 1)),
        (InvalidElement, (WALL, "L1", "w", "x" * 201, 1)),
    ],
)
def test_what_is_refused_changes_nothing(
    editor: BuildingEditor, building: Building, error: Any, arguments: Any
) -> None:
    with pytest.raises(error):
        editor.rename(*arguments)
    assert (editor.building, editor.version) == (building, 1)


def test_the_same_name_is_no_edit(editor: BuildingEditor) -> None:
    assert editor.rename(NODE, "L1", "east", "east", 1) == 1

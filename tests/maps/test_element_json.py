"""Elements as JSON objects with all members, and the descriptions of these members."""

from __future__ import annotations

import json

import pytest
from hypothesis import given

from robocorba.errors.maps import InvalidElement
from robocorba.maps.changes import elements_of
from robocorba.maps.element_json import as_json, form_members, from_json
from robocorba.maps.model import Building, ElementKind, Wall
from robocorba.testing.buildings import buildings, two_floors


@given(buildings())
def test_every_element_comes_back_through_json(building: Building) -> None:
    for key, element in elements_of(building):
        members = json.loads(json.dumps(as_json(element)))
        assert from_json(key.kind, key.floor, members) == element


def test_members_with_default_values_are_there() -> None:
    assert as_json(Wall("w", (0.0, 0.0), (1.0, 0.0))) == {"name": "w", "from": [0, 0], "to": [1, 0], "height": 2.5}


def test_a_form_has_every_member_of_each_element() -> None:
    for key, element in elements_of(two_floors()):
        assert [member["name"] for member in form_members(key.kind)] == list(as_json(element))


def test_members_are_described_by_type_unit_and_default() -> None:
    members = {member["name"]: member for member in form_members(ElementKind.OBJECT)}
    assert members["at"] == {"name": "at", "default": None, "unit": "m", "type": "point"}
    assert (members["heading"]["type"], members["heading"]["unit"], members["heading"]["default"]) == (
        "number",
        "rad",
        0,
    )
    assert members["movable"]["type"] == "boolean"
    assert set(members["shape"]["variants"]) == {"segment", "box", "circle", "polygon"}
    assert members["shape"]["variants"]["polygon"][0]["type"] == "points"


def test_references_and_rows_are_described() -> None:
    doors = next(member for member in form_members(ElementKind.ELEVATOR) if member["name"] == "doors")
    assert doors["type"] == "rows"
    assert [(member["name"], member["type"]) for member in doors["members"][:2]] == [
        ("floor", "reference"),
        ("side", "choice"),
    ]
    edge = {member["name"]: member for member in form_members(ElementKind.EDGE)}
    assert edge["from"]["of"] == "node"
    assert (edge["graphs"]["type"], edge["speed_limit"]["unit"]) == ("names", "m/s")


@pytest.mark.parametrize(
    "members",
    [
        None,
        [],
        {"name": "w"},
        {"name": "w", "from": [0, 0], "to": [1, "a"]},
        {"name": "w", "from": [0, 0], "to": [1, 0], "colour": "red"},
        {"name": 7, "from": [0, 0], "to": [1, 0]},
    ],
)
def test_other_objects_are_refused(members: object) -> None:
    with pytest.raises(InvalidElement):
        from_json(ElementKind.WALL, "L1", members)

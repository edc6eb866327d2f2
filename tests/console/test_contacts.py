"""Robots that have begun to touch something, from moments of a floor."""

from __future__ import annotations

import numpy as np

from robocorba.console.contacts import Contact, contacts_since
from robocorba.console.happenings import MAX_CONTACTS, Happenings
from robocorba.console.history import History
from robocorba.maps.model import Building
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.testing.buildings import two_floors

FLOOR = "L1"
TABLE = ((-0.5, -0.25), (0.5, -0.25), (0.5, 0.25), (-0.5, 0.25))
R1, R2 = (Body(number, BodyKind.ROBOT, name, 0.3, (), 50.0) for number, name in ((1, "R1"), (2, "R2")))
TABLE_1 = Body(3, BodyKind.OBJECT, "table 1", 0.56, TABLE, 20.0)
#: Free places of the building, away from its walls.
AWAY, MIDDLE = (3.0, 2.0, 0.0), (5.0, 2.0, 0.0)


def history(*moments: dict[Body, tuple[float, float, float]]) -> History:
    """A floor once a second from time 0; a moment has the place x, y, heading of each body."""
    history = History()
    view = FloorView(FLOOR)
    for at_s, places in enumerate(moments):
        motions = np.zeros(len(places), MOTION)
        for row, (body, (x, y, heading)) in zip(motions, places.items(), strict=True):
            row["number"], row["x"], row["y"], row["heading"] = body.number, x, y, heading
        view.apply(FloorUpdate(FLOOR, WHOLE, at_s + 1, float(at_s), 1, list(places), [], motions, {}))
        history.add(view, float(at_s))
    return history


def found(*moments: dict[Body, tuple[float, float, float]], building: Building | None = None) -> list[Contact]:
    return contacts_since(history(*moments), building or Building(""), 0.0, 10.0)


def test_robots_that_meet_are_named_once() -> None:
    apart = {R1: AWAY, R2: MIDDLE}
    together = {R1: AWAY, R2: (AWAY[0] + 0.62, AWAY[1], 0.0)}
    assert found(apart, together, apart, together) == [Contact(FLOOR, "R1", "R2")]


def test_bodies_that_touched_before_are_not_named() -> None:
    together = {R1: AWAY, R2: (AWAY[0] + 0.61, AWAY[1], 0.0)}
    assert found(together, {**together, R1: (AWAY[0], AWAY[1], 1.0)}) == []


def test_a_gap_is_no_contact() -> None:
    assert found({R1: AWAY, R2: MIDDLE}, {R1: AWAY, R2: (AWAY[0] + 0.64, AWAY[1], 0.0)}) == []


def test_the_outline_of_an_object_turns_with_it() -> None:
    """Beside a table lies free floor as long as the table lies along."""
    x, y, _ = AWAY
    assert found({R1: AWAY, TABLE_1: MIDDLE}, {R1: AWAY, TABLE_1: (x, y + 0.6, 0.0)}) == []
    turned = {R1: AWAY, TABLE_1: (x, y + 0.6, np.pi / 2)}
    assert found({R1: AWAY, TABLE_1: MIDDLE}, turned) == [Contact(FLOOR, "R1", "table 1")]


def test_walls_of_the_map_are_touched() -> None:
    building = two_floors()
    wall = next(iter(building.floors[FLOOR].geometrical.walls.values()))
    end = (*wall.a, 0.0)
    words = {contact.other for contact in found({R1: (50.0, 50.0, 0.0)}, {R1: end}, building=building)}
    assert "a wall" in words


def test_a_floor_without_robots_has_no_contacts() -> None:
    assert found({TABLE_1: MIDDLE}, {TABLE_1: AWAY}) == []


def collision(contacts: list[Contact]) -> tuple[str, str, str]:
    """Robot, floor and text of two collisions between these."""
    happenings = Happenings(lambda at_s: contacts)
    for count in (0, 2):
        state = {"collisions": count, "paused": False}
        rows = {"state": {"state": state, "clients": []}, "age": 0.0, "problem": ""}
        happenings.note({"naming": "", "server": rows, "robots": {}, "channels": {}}, 1.0)
    [happening] = happenings.after(0)
    return happening.robot, happening.floor, happening.text


def test_a_collision_names_who_met() -> None:
    contacts = [Contact("L2", "R1", "a wall"), Contact("L1", "R2", "table 1")]
    assert collision(contacts) == ("R1", "L2", "2 collisions: R1 and a wall, R2 and table 1")
    assert collision([]) == ("", "", "2 collisions")


def test_the_number_of_names_is_bounded() -> None:
    contacts = [Contact("L1", f"R{number}", "a wall") for number in range(20)]
    _, _, text = collision(contacts)
    assert text.count("a wall") == MAX_CONTACTS
    assert text.endswith(" and others")

"""The names of a guarded system."""

from __future__ import annotations

import pytest

from robocorba import name_table
from robocorba.errors.services import InvalidBinding, NameHeld
from robocorba.name_table import HOLD_S, MAX_PART, NameTable
from robocorba.roles import Role
from tests.clock import Clock

ROBOTS = ("RoboCorba", "Robots")
MINE, THEIRS = "a secret of mine ...", "a secret of theirs ..."


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def table(clock: Clock) -> NameTable:
    return NameTable(ROBOTS, clock)


def test_each_role_finds_its_reference(table: NameTable) -> None:
    table.announce(Role.SERVER, ("RoboCorba", "MapEditor"), {Role.OBSERVER: "reads", Role.OPERATOR: "edits"}, MINE)
    found = [table.find(role, ("RoboCorba", "MapEditor")) for role in (Role.OBSERVER, Role.OPERATOR, Role.ROBOT)]
    assert found == ["reads", "edits", None]


def test_names_are_listed_by_context(table: NameTable) -> None:
    for name in ("A", "B"):
        table.announce(Role.ROBOT, (*ROBOTS, name), {Role.OBSERVER: 1}, MINE)
    assert table.children(()) == [("RoboCorba", True)]
    assert table.children(("RoboCorba",)) == [("Robots", True)]
    assert table.children(ROBOTS) == [("A", False), ("B", False)]
    for name in ("A", "B"):
        table.withdraw(Role.ROBOT, (*ROBOTS, name), MINE)
    assert table.children(()) == []
    assert not table.is_context(ROBOTS)


def test_a_robot_holds_its_name_while_it_announces_it(table: NameTable, clock: Clock) -> None:
    name = (*ROBOTS, "A")
    table.announce(Role.ROBOT, name, {Role.OBSERVER: "mine"}, MINE)
    for _ in range(3):
        clock.now += HOLD_S - 0.1
        with pytest.raises(NameHeld):
            table.announce(Role.ROBOT, name, {Role.OBSERVER: "theirs"}, THEIRS)
        with pytest.raises(NameHeld):
            table.withdraw(Role.ROBOT, name, THEIRS)
        table.announce(Role.ROBOT, name, {Role.OBSERVER: "mine"}, MINE)
    assert table.find(Role.OBSERVER, name) == "mine"
    clock.now += HOLD_S
    table.announce(Role.ROBOT, name, {Role.OBSERVER: "theirs"}, THEIRS)
    assert table.find(Role.OBSERVER, name) == "theirs"


def test_a_server_holds_its_name_until_it_withdraws_it(table: NameTable, clock: Clock) -> None:
    name = (*ROBOTS, "A")
    table.announce(Role.SERVER, name, {Role.OBSERVER: "mine"}, MINE)
    clock.now += 100 * HOLD_S
    with pytest.raises(NameHeld):
        table.announce(Role.ROBOT, name, {Role.OBSERVER: "theirs"}, THEIRS)
    table.withdraw(Role.SERVER, name, MINE)
    table.announce(Role.ROBOT, name, {Role.OBSERVER: "theirs"}, THEIRS)


@pytest.mark.parametrize(
    "path",
    [
        *(("RoboCorba", "MapEditor"), ("RoboCorba", "Robots"), ("RoboCorba", "Robots", "A", "pool"), ("A",)),
        *(("RoboCorba", "VirtualSensors", "s1"), ("RoboCorba", "Robots", ""), (*ROBOTS, "x" * (MAX_PART + 1))),
    ],
)
def test_robots_bind_names_of_robots_only(table: NameTable, path: tuple[str, ...]) -> None:
    with pytest.raises(InvalidBinding):
        table.announce(Role.ROBOT, path, {Role.OBSERVER: 1}, MINE)


def test_a_name_is_not_a_context(table: NameTable) -> None:
    table.announce(Role.SERVER, ("a", "b"), {Role.OBSERVER: 1}, MINE)
    for path in (("a",), ("a", "b", "c")):
        with pytest.raises(InvalidBinding):
            table.announce(Role.SERVER, path, {Role.OBSERVER: 1}, MINE)


def test_a_secret_is_long_enough(table: NameTable) -> None:
    with pytest.raises(InvalidBinding):
        table.announce(Role.ROBOT, (*ROBOTS, "A"), {Role.OBSERVER: 1}, "short")


def test_robots_leave_room_for_servers_and_absent_ones_for_others(
    table: NameTable, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(name_table, "MAX_ROBOTS", 2)
    monkeypatch.setattr(name_table, "MAX_NAMES", 3)

    def announce(role: Role, *path: str) -> None:
        table.announce(role, path, {Role.OBSERVER: path}, MINE)

    for name in ("A", "B"):
        announce(Role.ROBOT, *ROBOTS, name)
    with pytest.raises(InvalidBinding, match="2 names"):
        announce(Role.ROBOT, *ROBOTS, "C")
    announce(Role.SERVER, "RoboCorba", "MapEditor")
    with pytest.raises(InvalidBinding, match="3 names"):
        announce(Role.SERVER, "RoboCorba", "PathPlanner")
    clock.now += HOLD_S
    announce(Role.ROBOT, *ROBOTS, "B")
    announce(Role.ROBOT, *ROBOTS, "C")
    assert table.children(ROBOTS) == [("B", False), ("C", False)]

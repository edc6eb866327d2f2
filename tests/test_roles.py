"""Every operation of the IDL has its roles, no role may do more than it should, and the names that each finds."""

from __future__ import annotations

from typing import Any

import pytest

from robocorba.errors.services import InvalidBinding, NameHeld
from robocorba.orb.guard import interface_of
from robocorba.stubs import RoboCorba__POA
from robocorba.system import name_table
from robocorba.system.name_table import HOLD_S, MAX_PART, NameTable
from robocorba.system.roles import BY_REFERENCE, EVERYBODY, NAMED, RULES, Role, may_call
from tests.clock import Clock

#: What changes nothing and serves nobody else: by the first words of an operation's name.
READS = ("_get_", "get", "find", "floor", "element", "read", "check", "export", "default", "scan", "state", "client")
READS += ("sensor", "render", "mission", "leaders", "report", "peers", "icons", "adaptors", "reservations", "elevators")
READS += ("postures", "lastScans", "typedFloorChanges", "publishTypedChanges", "laser", "proximity", "changesSince")
READS += ("proposals", "rangeSensors", "ranges", "editsSince", "subscribe", "for_consumers", "routeBack", "traffic")


def interfaces() -> dict[str, Any]:
    """The skeletons of all interfaces of the IDL."""
    return {name: value for name, value in vars(RoboCorba__POA).items() if hasattr(value, "_omni_op_d")}


def test_every_operation_of_the_idl_has_its_roles() -> None:
    found = interfaces()
    assert set(found) - {"Server"} == set(RULES) | BY_REFERENCE  # Server is a base of others
    assert not set(RULES) & BY_REFERENCE
    for name, rules in RULES.items():
        assert set(rules) == set(found[name]._omni_op_d), name
        assert interface_of(found[name]) == name
    for name, operation in NAMED:
        assert operation in RULES[name]
    assert [role for role in Role if may_call(role, "EventChannel", "peers")] == [Role.ADMINISTRATOR, Role.SERVER]
    for role in Role:
        assert may_call(role, "Unknown", "anything") == may_call(role, "MapEditor", "unknown") == (role is Role.SERVER)


@pytest.mark.parametrize("name", RULES)
def test_observers_only_read_and_what_they_may_everybody_may(name: str) -> None:
    may = [operation for operation in RULES[name] if may_call(Role.OBSERVER, name, operation)]
    assert [operation for operation in may if not operation.startswith(READS)] == []
    for roles in RULES[name].values():
        assert Role.SERVER in roles
        assert Role.OBSERVER not in roles or roles == EVERYBODY
        assert Role.ADMINISTRATOR in roles or roles == {Role.SERVER}


ROBOTS = ("RoboCorba", "Robots")
MINE, THEIRS = "a secret of mine ...", "a secret of theirs ..."


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def table(clock: Clock) -> NameTable:
    return NameTable(ROBOTS, clock)


def test_each_role_finds_its_reference_and_names_are_listed_by_context(table: NameTable) -> None:
    editor = ("RoboCorba", "MapEditor")
    table.announce(Role.SERVER, editor, {Role.OBSERVER: "reads", Role.OPERATOR: "edits"}, MINE)
    found = [table.find(role, editor) for role in (Role.OBSERVER, Role.OPERATOR, Role.ROBOT)]
    assert found == ["reads", "edits", None]
    table.withdraw(Role.SERVER, editor, MINE)
    for name in ("A", "B"):
        table.announce(Role.ROBOT, (*ROBOTS, name), {Role.OBSERVER: 1}, MINE)
    assert table.children(()) == [("RoboCorba", True)]
    assert table.children(("RoboCorba",)) == [("Robots", True)]
    assert table.children(ROBOTS) == [("A", False), ("B", False)]
    for name in ("A", "B"):
        table.withdraw(Role.ROBOT, (*ROBOTS, name), MINE)
    assert table.children(()) == []
    assert not table.is_context(ROBOTS)


def test_robots_hold_names_while_they_announce_them_servers_until_they_withdraw_them(
    table: NameTable, clock: Clock
) -> None:
    name = (*ROBOTS, "A")

    def announce(role: Role, reference: str, secret: str) -> None:
        table.announce(role, name, {Role.OBSERVER: reference}, secret)

    announce(Role.ROBOT, "mine", MINE)
    for _ in range(3):
        clock.now += HOLD_S - 0.1
        for act in (lambda: announce(Role.ROBOT, "theirs", THEIRS), lambda: table.withdraw(Role.ROBOT, name, THEIRS)):
            with pytest.raises(NameHeld):
                act()
        announce(Role.ROBOT, "mine", MINE)
    assert table.find(Role.OBSERVER, name) == "mine"
    clock.now += HOLD_S
    announce(Role.ROBOT, "theirs", THEIRS)
    assert table.find(Role.OBSERVER, name) == "theirs"
    clock.now += HOLD_S
    announce(Role.SERVER, "mine", MINE)
    clock.now += 100 * HOLD_S
    with pytest.raises(NameHeld):
        announce(Role.ROBOT, "theirs", THEIRS)
    table.withdraw(Role.SERVER, name, MINE)
    announce(Role.ROBOT, "theirs", THEIRS)


def test_bindings_that_are_invalid(table: NameTable) -> None:
    """Robots bind names of robots only, a name is not a context, and a secret is long."""
    table.announce(Role.SERVER, ("a", "b"), {Role.OBSERVER: 1}, MINE)
    not_robots = (("RoboCorba", "MapEditor"), ROBOTS, (*ROBOTS, "A", "pool"), ("A",), ("RoboCorba", "Robots2", "s1"))
    for role, path, secret in (
        *((Role.ROBOT, path, MINE) for path in (*not_robots, (*ROBOTS, ""), (*ROBOTS, "x" * (MAX_PART + 1)))),
        *((Role.SERVER, path, MINE) for path in (("a",), ("a", "b", "c"))),
        (Role.ROBOT, (*ROBOTS, "A"), "short"),
    ):
        with pytest.raises(InvalidBinding):
            table.announce(role, path, {Role.OBSERVER: 1}, secret)
    table.announce(Role.ROBOT, (*ROBOTS, "A"), {Role.OBSERVER: 1}, MINE)


def test_robots_leave_room_for_servers(table: NameTable, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
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

"""Every operation of the IDL has its roles, and no role may do more than it should."""

from __future__ import annotations

from typing import Any

import pytest

from robocorba.corba.guard import interface_of
from robocorba.roles import BY_REFERENCE, EVERYBODY, NAMED, RULES, Role, may_call, operations_for
from robocorba.stubs import RoboCorba__POA

#: What changes nothing and serves nobody else: by the first words of an operation's name.
READS = ("_get_", "get", "find", "floor", "element", "read", "check", "export", "default", "scan", "state", "client")
READS += (
    "sensor",
    "render",
    "mission",
    "leaders",
    "report",
    "peers",
    "icons",
    "adaptors",
    "reservations",
    "elevators",
    "postures",
)
READS += (
    "lastScans",
    "typedFloorChanges",
    "publishTypedChanges",
    "laser",
    "proximity",
    "changesSince",
    "editsSince",
    "subscribe",
    "for_consumers",
    "routeBack",
)


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


@pytest.mark.parametrize("name", RULES)
def test_observers_only_read(name: str) -> None:
    may = operations_for(Role.OBSERVER, name, RULES[name])
    assert [operation for operation in may if not operation.startswith(READS)] == []


@pytest.mark.parametrize("name", RULES)
def test_what_observers_may_everybody_may_and_what_users_may_administrators_may(name: str) -> None:
    for roles in RULES[name].values():
        assert Role.SERVER in roles
        assert Role.OBSERVER not in roles or roles == EVERYBODY
        assert Role.ADMINISTRATOR in roles or roles == {Role.SERVER}


def test_addresses_of_peers_which_may_contain_keys_are_for_administrators() -> None:
    assert [role for role in Role if may_call(role, "EventChannel", "peers")] == [Role.ADMINISTRATOR, Role.SERVER]


def test_what_is_not_listed_is_for_servers() -> None:
    for role in Role:
        assert may_call(role, "Unknown", "anything") == may_call(role, "MapEditor", "unknown") == (role is Role.SERVER)

"""What stands before the servants of a guarded system; the whole is in tests/system/test_guarded.py."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from omniORB import CORBA

from robocorba.claimed_ports import HOST, claimed_ports
from robocorba.corba.guard import Guard, guarded, guarded_for, without_keys
from robocorba.corba.orb import Orb
from robocorba.corba.tls import load_transport
from robocorba.errors.services import ServiceError
from robocorba.roles import Role
from robocorba.settings import Address, RoleNaming
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.supervision.access import Access


class Editor(RoboCorba__POA.MapEditor):
    def _get_currentVersion(self) -> int:
        return 7

    def undo(self, expected: int) -> int:
        return 8


class Channel(RoboCorba__POA.EventChannel):
    def subscribe(self, name: str, *arguments: Any) -> str:
        return name


@pytest.fixture
def naming(tmp_path: Path) -> Iterator[RoleNaming]:
    """The server's role at a naming service where nobody listens."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield Access.create(tmp_path, Address(*held.getsockname())).naming(Role.SERVER)


def test_a_role_gets_the_servants_own_methods_or_a_refusal() -> None:
    editor = Editor()
    for role in Role:
        assert guarded(editor, role)._get_currentVersion == editor._get_currentVersion
    for role in (Role.OPERATOR, Role.ADMINISTRATOR, Role.SERVER):
        assert guarded(editor, role).undo(7) == 8
    for role in (Role.OBSERVER, Role.ROBOT):
        with pytest.raises(CORBA.NO_PERMISSION):
            guarded(editor, role).undo(7)
        assert not hasattr(guarded(editor, role), "check")  # as the servant


def test_a_name_may_be_refused() -> None:
    observer, operator = guarded(Channel(), Role.OBSERVER), guarded(Channel(), Role.OPERATOR)
    assert observer.subscribe("", None, [], None) == ""
    assert operator.subscribe("mine", None, [], None) == "mine"
    with pytest.raises(CORBA.NO_PERMISSION):
        observer.subscribe("mine", None, [], None)


def test_one_robot_calls_what_the_servant_offers_to_it() -> None:
    class Bound(Editor):
        def bound_to(self, robot: str) -> dict[str, Any]:
            return {"_get_currentVersion": lambda: robot}

    assert guarded_for(Bound(), "A")._get_currentVersion() == "A"
    assert guarded_for(Editor(), "A")._get_currentVersion() == 7
    with pytest.raises(CORBA.NO_PERMISSION):
        guarded_for(Bound(), "A").undo(7)


def test_keys_last_and_differ() -> None:
    keys = Guard(b"secret").keys("MapEditor")
    assert keys == Guard(b"secret").keys("MapEditor")
    assert keys[Role.OBSERVER] == "MapEditor"
    assert len(set(keys + Guard(b"other").keys("MapEditor") + Guard().keys("MapEditor"))) == 3 * len(Role) - 2


def test_a_uri_is_shown_without_the_key_in_it() -> None:
    shown = without_keys(f"corbaname::10.0.0.2:2809/access/server/{'0a' * 32}#RoboCorba/EventChannels/hall")
    assert shown == "corbaname::10.0.0.2:2809/access/server/...#RoboCorba/EventChannels/hall"


def test_what_a_guarded_process_serves(naming: RoleNaming) -> None:
    with claimed_ports() as port, Orb(naming, endpoint := Address(HOST, port)) as orb:
        editor = Editor()
        orb.serve({"MapEditor": editor})
        own = orb.activate(editor, "MapEditor")  # as servers hand it to each other
        by_name = orb.reference(orb.uri_at(endpoint, "MapEditor"), RoboCorba.MapEditor)
        assert (own.undo(7), by_name._get_currentVersion()) == (8, 7)
        with pytest.raises(CORBA.NO_PERMISSION):
            by_name.undo(7)
        secret = orb.activate(Editor(), "MapEditor/secret")
        assert secret.undo(7) == 8
        assert orb.reference(orb.uri_at(endpoint, "MapEditor/secret"), RoboCorba.MapEditor)._non_existent()
        # As servers find an object of another one, which has the same secret.
        assert orb.reference(orb.uri_for_servers(endpoint, "MapEditor"), RoboCorba.MapEditor).undo(7) == 8
        nameless = Editor()
        assert orb.activate(nameless).undo(7) == 8
        orb.deactivate(nameless)
        orb.withdraw("MapEditor")
        assert by_name._non_existent()


def test_tls_without_its_transport_is_one_line() -> None:
    try:
        load_transport()
    except ServiceError as error:
        assert str(error).startswith("--tls needs omniORB's SSL transport")
    else:
        pytest.skip("this omniORB has its SSL transport")

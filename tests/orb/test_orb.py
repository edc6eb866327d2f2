"""The ORB of one process, the names that it keeps bound, and what a guarded system puts before its servants."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import CosNaming
import pytest
from omniORB import CORBA

from robocorba.errors.services import NotReachable, PortInUse, ServiceError
from robocorba.orb import naming as module
from robocorba.orb.guard import Guard, guarded, guarded_for, without_keys
from robocorba.orb.ior import Ior, parsed
from robocorba.orb.naming import BoundNames, NamingService, corbaname
from robocorba.orb.orb import OFFER_CALLBACKS, Orb
from robocorba.orb.tls import load_transport
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.claimed_ports import HOST, claimed_ports
from robocorba.system.roles import Role
from robocorba.system.settings import Address, RoleNaming
from robocorba.system.supervision.access import Access
from testkit.processes import eventually
from tests.clock import Clock


@pytest.fixture
def nowhere() -> Iterator[Address]:
    """An address at which no process listens during the test."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield Address(*held.getsockname())


@pytest.fixture
def endpoint() -> Iterator[Address]:
    """A free address."""
    with claimed_ports() as port:
        yield Address("127.0.0.1", port)


class Planner(RoboCorba__POA.PathPlanner):
    def __init__(self, version: int = 7) -> None:
        self.version = version

    def _get_mapVersion(self) -> int:
        return self.version


def test_corbaname_and_the_address_in_a_reference(nowhere: Address) -> None:
    for name, rest in (
        ("", ""),
        ("RoboCorba/PathPlanner", "#RoboCorba/PathPlanner"),
        ("RoboCorba/Robots/r 1.b", "#RoboCorba/Robots/r%201%5C.b"),
        ("Küche%", "#K%C3%BCche%25"),
    ):
        assert corbaname(Address("10.0.0.1", 2809), name) == f"corbaname::10.0.0.1:2809{rest}"
    assert corbaname(Address("::1", 2809), "a") == "corbaname::[::1]:2809#a"
    with Orb(nowhere) as orb:
        uri = orb.uri(orb.reference("corbaloc:iiop:1.2@10.1.2.3:4567/some/key", CORBA.Object))
    assert parsed(uri)[1:] == ("10.1.2.3:4567", b"some/key")
    for malformed in ("", "IOR:", "IOR:zz", "IOR:00", "IOR:01000000ffffffff", "corbaloc::h/a", "IOR:01" * 9):
        assert parsed(malformed) == Ior()


def test_keys_last_and_differ_and_are_not_shown() -> None:
    keys = Guard(b"secret").keys("MapEditor")
    assert keys == Guard(b"secret").keys("MapEditor")
    assert keys[Role.OBSERVER] == "MapEditor"
    assert len(set(keys + Guard(b"other").keys("MapEditor") + Guard().keys("MapEditor"))) == 3 * len(Role) - 2
    shown = without_keys(f"corbaname::10.0.0.2:2809/access/server/{'0a' * 32}#RoboCorba/EventChannels/hall")
    assert shown == "corbaname::10.0.0.2:2809/access/server/...#RoboCorba/EventChannels/hall"


def test_a_process_has_one_orb_at_a_time_at_a_free_port(nowhere: Address, endpoint: Address) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = Address(*taken.getsockname())
        with pytest.raises(PortInUse) as refused, Orb(nowhere, address):
            pass
    assert (refused.value.host, refused.value.port) == (address.host, address.port)
    unknown = pytest.raises(ServiceError, match=r"192\.0\.2\.1 is not an address of this machine")
    with unknown, Orb(nowhere, Address("192.0.2.1", 2830)):
        pass
    before = signal.getsignal(signal.SIGTERM)
    # Each listens from its start to its end, serving does not wait for the naming service, and a signal between serving
    # and running ends the run.
    for stop in (Orb.stop, Orb.stop, lambda orb: os.kill(os.getpid(), signal.SIGTERM)):
        with Orb(nowhere, endpoint) as orb:
            with pytest.raises(ServiceError, match="has an ORB already"), Orb(nowhere):
                pass
            socket.create_connection((endpoint.host, endpoint.port), timeout=5).close()
            orb.serve({"PathPlanner": Planner()})
            stop(orb)
            orb.run()
            assert signal.getsignal(signal.SIGTERM) is before
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((endpoint.host, endpoint.port), timeout=5)
    with Orb(nowhere, endpoint) as orb:
        orb.serve({"PathPlanner": Planner()})
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_hanging_shutdown_prints_its_stacks_and_exits(nowhere: Address) -> None:
    hangs = (
        "import threading; from robocorba.orb import orb as o; from robocorba.system.settings import Address;"
        "Orb, o.SHUTDOWN_LIMIT_S = o.Orb, 0.5\n"
        f"with Orb(Address.parse('{nowhere}')) as orb:\n    orb.stop()\n    orb.run()\n    threading.Event().wait()"
    )
    ended = subprocess.run((sys.executable, "-c", hangs), capture_output=True, text=True, timeout=60.0)
    assert ended.returncode == 1
    assert 'File "<string>", line 5 in <module>' in ended.stderr


def test_objects_live_until_they_are_deactivated(nowhere: Address, endpoint: Address) -> None:
    with Orb(nowhere, endpoint) as orb:
        first, second = Planner(1), Planner(2)
        again = orb.activate(Planner(3), "again")
        orb.accept_calls()
        references = *(orb.activate(planner) for planner in (first, second)), again
        assert [reference._get_mapVersion() for reference in references] == [1, 2, 3]
        orb.deactivate(first)
        orb.deactivate_key("again")
        for reference in (references[0], again):
            with pytest.raises(CORBA.OBJECT_NOT_EXIST):
                reference._get_mapVersion()
        orb.activate(Planner(4), "again")  # a key is valid again after its end
        assert (references[1]._get_mapVersion(), again._get_mapVersion()) == (2, 4)


def test_what_is_unreachable_is_named(nowhere: Address, endpoint: Address) -> None:
    with Orb(nowhere) as orb:
        with pytest.raises(NotReachable) as missing:
            orb.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s=0.2)
        silent = f"the naming service at {nowhere} does not answer (TRANSIENT_ConnectFailed)"
        assert str(missing.value) == f"RoboCorba/PathPlanner is not reachable: {silent}"
        with pytest.raises(NotReachable, match=str(nowhere)):
            orb.check_naming()
        for name in ("", "/", "a//b", "a/"):
            with pytest.raises(NotReachable, match="can't be a name"):
                orb.resolve(name, RoboCorba.PathPlanner, timeout_s=60.0)
    with Orb(endpoint, endpoint) as orb:  # a naming service that only listens is not ready
        orb.accept_calls()
        with pytest.raises(NotReachable, match=f"the naming service at {endpoint} has no root context"):
            orb.check_naming()


def test_two_threads_that_create_an_adapter_use_the_same(nowhere: Address) -> None:
    with Orb(nowhere, options=OFFER_CALLBACKS) as orb:
        of_one = orb._object_adapter
        # The other, as it does where Python's cached_property has no lock (from 3.12 on).
        of_other = Orb.__dict__["_object_adapter"].func(orb)
        assert of_other._is_equivalent(of_one)


def test_an_object_is_found_by_its_secret_key(nowhere: Address, endpoint: Address) -> None:
    """Also by a process that does not know the key when it starts."""
    asked, uris = [], []

    def find(key: str) -> Planner | None:
        asked.append(key)
        return Planner(8) if key == "known" else None

    with Orb(nowhere, endpoint) as orb:
        orb.serve_secrets(find)
        orb.accept_calls()
        uris = [orb.uri(orb.activate_secret(Planner(7), key)) for key in ("known", "unknown")]
        planner = orb.reference(uris[1], RoboCorba.PathPlanner)
        assert planner._get_mapVersion() == 7 and asked == []
        orb.deactivate_secret("unknown")
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            planner._get_mapVersion()
    asked.clear()
    with Orb(nowhere, endpoint) as orb:
        orb.serve_secrets(find)
        orb.accept_calls()
        planner, gone = (orb.reference(uri, RoboCorba.PathPlanner) for uri in uris)
        assert [planner._get_mapVersion() for _ in range(2)] == [8, 8]
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            gone._get_mapVersion()
        assert asked == ["known", "unknown"]
        orb.deactivate_secret("known")
        orb.deactivate_secret("unknown")
        assert planner._get_mapVersion() == 8 and asked == ["known", "unknown", "known"]


class Editor(RoboCorba__POA.MapEditor):
    def _get_currentVersion(self) -> int:
        return 7

    def undo(self, expected: int) -> int:
        return 8


class Channel(RoboCorba__POA.EventChannel):
    def subscribe(self, name: str, *arguments: Any) -> str:
        return name


@pytest.fixture
def naming(tmp_path: Path, nowhere: Address) -> RoleNaming:
    """The server's role at a naming service where nobody listens."""
    return Access.create(tmp_path, nowhere).naming(Role.SERVER)


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
    observer, operator = guarded(Channel(), Role.OBSERVER), guarded(Channel(), Role.OPERATOR)
    assert observer.subscribe("", None, [], None) == ""
    assert operator.subscribe("mine", None, [], None) == "mine"
    with pytest.raises(CORBA.NO_PERMISSION):
        observer.subscribe("mine", None, [], None)  # a name may be refused

    class Bound(Editor):
        def bound_to(self, robot: str) -> dict[str, Any]:
            return {"_get_currentVersion": lambda: robot}

    assert guarded_for(Bound(), "A")._get_currentVersion() == "A"
    assert guarded_for(Editor(), "A")._get_currentVersion() == 7
    with pytest.raises(CORBA.NO_PERMISSION):
        guarded_for(Bound(), "A").undo(7)


def test_what_a_guarded_process_serves(naming: RoleNaming) -> None:
    with claimed_ports() as port, Orb(naming, endpoint := Address(HOST, port)) as orb:
        editor, nameless = Editor(), Editor()
        orb.serve({"MapEditor": editor})
        own = orb.activate(editor, "MapEditor")  # as servers hand it to each other
        orb.activate_for_all(Editor(), "Editor")
        for key in ("Editor", "MapEditor"):
            by_key = orb.reference(orb.uri_at(endpoint, key), RoboCorba.MapEditor)
            assert by_key._get_currentVersion() == 7
            with pytest.raises(CORBA.NO_PERMISSION):
                by_key.undo(7)
        secret = orb.activate(Editor(), "MapEditor/secret")
        assert orb.reference(orb.uri_at(endpoint, "MapEditor/secret"), RoboCorba.MapEditor)._non_existent()
        # As servers find an object of another one, which has the same secret.
        found = orb.reference(orb.uri_for_servers(endpoint, "MapEditor"), RoboCorba.MapEditor)
        assert [each.undo(7) for each in (own, secret, found, orb.activate(nameless))] == [8] * 4
        orb.deactivate(nameless)
        orb.withdraw("MapEditor")
        assert by_key._non_existent()


def test_tls_without_its_transport_is_one_line() -> None:
    try:
        load_transport()
    except ServiceError as error:
        assert str(error).startswith("--tls needs omniORB's SSL transport")
    else:
        pytest.skip("this omniORB has its SSL transport")


PATIENCE_S = 30.0


class Reference:
    def _is_equivalent(self, other: object) -> bool:
        return other is self


class Names:
    """A naming service that fails if it `fails`."""

    address = Address("127.0.0.1", 2809)
    path = "RoboCorba/{}".format

    def __init__(self) -> None:
        self.bindings: dict[str, Any] = {}
        self.calls, self.fails = 0, False
        #: Names that are bound to a reference that can't be read, unless it is the right one; and those that can't be
        #: bound.
        self.unreadable, self.refused = set[str](), set[str]()
        self.gone, self.silent = set[Any](), set[Any]()
        self._own: dict[str, Any] = {}

    def bound(self, name: str) -> Any:
        self.calls += 1
        if self.fails:
            raise CORBA.TIMEOUT()
        found = self.bindings.get(name)
        if name in self.unreadable and found is not None and found is not self._own.get(name):
            raise CORBA.MARSHAL()
        return found

    def take_back(self, name: str, reference: Any) -> None:
        if name in self.refused:
            raise CORBA.NO_PERMISSION()
        self.bindings[name] = self._own[name] = reference

    def is_gone(self, reference: Any) -> bool | None:
        return None if reference in self.silent else reference in self.gone

    def address_bound(self, reference: Any) -> str:
        return "10.0.0.1:666"

    def unbind(self, name: str, reference: Any) -> None:
        if self.bindings.get(name) is reference:
            del self.bindings[name]


@pytest.fixture
def names() -> Any:
    return Names()


def test_a_lost_or_stolen_name_is_taken_back_and_logged_once(names: Any, caplog: pytest.LogCaptureFixture) -> None:
    own, false = Reference(), Reference()
    with contextlib.closing(BoundNames(names, 0.001)) as bound, caplog.at_level(logging.WARNING):
        bound.start({"A": own})
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
        del names.bindings["A"]
        for _ in range(4):
            eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
            names.bindings["A"] = false
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
    assert caplog.messages == ["took back the name RoboCorba/A: an object at 10.0.0.1:666 was bound to it"]
    assert names.bindings == {}


def test_a_name_that_fails_does_not_stop_the_others(names: Any, caplog: pytest.LogCaptureFixture) -> None:
    """Such as one that another process has bound to a reference that can't be read."""
    own = Reference()
    names.unreadable = {"A"}
    with contextlib.closing(BoundNames(names, 0.001)) as bound, caplog.at_level(logging.WARNING):
        bound.start({"A": own, "B": own})
        eventually(lambda: names.bindings.get("B") is own, PATIENCE_S)
        names.bindings["A"] = Reference()
        del names.bindings["B"]
        eventually(lambda: names.bindings == {"A": own, "B": own}, PATIENCE_S)
    assert caplog.messages == ["took back the name RoboCorba/A: an object at an unknown address was bound to it"]
    names.refused = {"A"}
    with contextlib.closing(BoundNames(names, 0.001)) as bound:
        bound.start({"A": own, "B": own})
        eventually(lambda: names.bindings.get("B") is own, PATIENCE_S)
        assert not bound.are_bound.is_set()
        names.refused = set()
        assert bound.are_bound.wait(PATIENCE_S)
        assert names.bindings == {"A": own, "B": own}
    assert names.bindings == {}


def test_a_name_that_belongs_to_another_now_is_left_to_it(names: Any) -> None:
    own, other = Reference(), Reference()
    with contextlib.closing(BoundNames(names, 0.001)) as bound:
        bound.start({"A": own}, lambda: False)
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
        names.bindings["A"] = other
        calls = names.calls
        eventually(lambda: names.calls > calls + 3, PATIENCE_S)
        assert names.bindings["A"] is other
    bound = BoundNames(names, 0.001)
    bound.start({"A": own})
    eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
    names.fails = True
    names.bindings["A"] = other
    bound.close()
    assert names.bindings == {"A": other}


def test_a_name_stays_with_another_process_while_that_is_there(
    names: Any, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    own, other = Reference(), Reference()
    names.bindings["A"] = other
    with contextlib.closing(BoundNames(names, 0.001, yields=True)) as bound, caplog.at_level(logging.WARNING):
        bound.start({"A": own, "B": own})
        eventually(lambda: names.bindings == {"A": other, "B": own} and caplog.messages, PATIENCE_S)
        assert caplog.messages == ["left the name RoboCorba/A to another: an object at 10.0.0.1:666 was bound to it"]
        names.gone = {other}
        eventually(lambda: names.bindings == {"A": own, "B": own}, PATIENCE_S)
        names.silent = {silent := Reference()}
        names.bindings["A"] = silent
        calls = names.calls
        eventually(lambda: names.calls > calls + 3, PATIENCE_S)
        assert names.bindings["A"] is silent  # it may only hang
        monkeypatch.setattr(module, "SILENT_S", 0.01)
        eventually(lambda: names.bindings["A"] is own, PATIENCE_S)
        names.bindings["A"] = Reference()
        calls = names.calls
        eventually(lambda: names.calls > calls + 3, PATIENCE_S)
        assert names.bindings["A"] is not own


def test_a_name_that_became_a_context_is_taken_back() -> None:
    bindings: dict[str, Any] = {"A": "context"}

    def rebind(path: Any, reference: Any) -> None:
        if bindings.get(path[-1].id) == "context":
            raise CosNaming.NamingContext.NotFound(CosNaming.NamingContext.not_object, path)
        bindings[path[-1].id] = reference

    root = SimpleNamespace(rebind=rebind, unbind=lambda path: bindings.pop(path[-1].id))
    service = module.NamingService(lambda uri: None, Address("127.0.0.1", 2809), "")
    service._root = lambda timeout_s=1.0: root  # type: ignore[method-assign]
    service.take_back("A", "own")
    assert bindings == {"A": "own"}


def test_a_stolen_name_is_resolved_once_it_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    right: Any = SimpleNamespace(_narrow=lambda interface: right, _non_existent=lambda: False)
    wrong = SimpleNamespace(_narrow=lambda interface: None)  # of another interface
    bound = [wrong, wrong, right]  # one after the other; the last one stays
    monkeypatch.setattr(module, "set_call_timeout", lambda reference, timeout_s: None)
    monkeypatch.setattr(NamingService, "_lookup", lambda *arguments: bound.pop(0) if len(bound) > 1 else bound[0])
    names = NamingService(lambda uri: None, Address("127.0.0.1", 2809), "RoboCorba")
    assert names.resolve("PathPlanner", RoboCorba.PathPlanner, 60.0, None) is right
    monkeypatch.setattr(module, "STOLEN_S", 0.1)
    bound[:] = [wrong]
    told = r"what is bound to RoboCorba/PathPlanner at 127.0.0.1:2809 is not a IDL:RoboCorba/PathPlanner:1.0$"
    for timeout_s, begin in ((60.0, "^"), (0.0, "")):
        with pytest.raises(NotReachable, match=begin + told):
            names.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s, None)


def test_an_outage_is_logged_once_and_a_bad_link_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    clock, failed = Clock(), [CORBA.TIMEOUT()]
    outages = module.BindingOutages(Address("127.0.0.1", 2809), clock)
    with caplog.at_level(logging.INFO):
        for problems in (*[failed] * 10, []):
            outages.note(problems)
        for _ in range(20):  # the link changes every second for 40 s
            clock.now += 2.0
            outages.note(failed)
            outages.note([])
        clock.now += 60.0
        outages.note(failed)
    fails = "cannot bind names at 127.0.0.1:2809 (TIMEOUT); retrying"
    again = "names are bound at 127.0.0.1:2809 again"
    assert caplog.messages == [fails, again, f"{fails}; 20 times more since the last line"]


def test_a_server_at_a_wrong_address_is_not_taken_for_the_naming_service(monkeypatch: pytest.MonkeyPatch) -> None:
    class Away:
        """An object, or a naming context, whose server does not answer."""

        def _narrow(self, interface: object) -> None:
            raise CORBA.TRANSIENT()

        def _unchecked_narrow(self, interface: object) -> Away:
            return self

    monkeypatch.setattr(module, "set_call_timeout", lambda reference, timeout_s: None)
    monkeypatch.setattr(module, "resolve", lambda context, name: Away())
    monkeypatch.setattr(module, "invoke", lambda *arguments: Away()._narrow(None))
    names = NamingService(lambda uri: Away(), Address("127.0.0.1", 2809), "RoboCorba")
    monkeypatch.setattr(names, "address_bound", lambda reference: "10.9.9.9:80")
    away = r"bound at 127\.0\.0\.1:2809, but its server at 10\.9\.9\.9:80 does not answer \(TRANSIENT\)"
    for call in (
        lambda: names.resolve("PathPlanner", RoboCorba.PathPlanner, 0.0, None),
        lambda: names.resolve_once("PathPlanner", RoboCorba.PathPlanner, 1.0),
        lambda: names.names("Robots", 0.0),
    ):
        with pytest.raises(NotReachable, match=away) as refused:
            call()
        assert "the naming service" not in str(refused.value)

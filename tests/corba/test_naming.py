"""Names that a process keeps bound, without a naming service."""

from __future__ import annotations

import contextlib
import logging
from typing import Any

import CosNaming
import pytest
from omniORB import CORBA

from robocorba.corba import naming as module
from robocorba.corba.ior import IorAddress, address_of
from robocorba.corba.naming import BoundNames, NamingService
from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually

PATIENCE_S = 30.0


class Reference:
    def _is_equivalent(self, other: object) -> bool:
        return other is self


class Names:
    """A naming service. `is_context`: a naming context is bound to the name, which `bind` can't replace."""

    address = Address("127.0.0.1", 2809)

    def __init__(self) -> None:
        self.bindings: dict[str, Any] = {}
        self.calls = 0
        self.fails = False
        #: Names that are bound to a reference that can't be read, unless it is the right one; and those that can't be
        #: bound.
        self.unreadable: set[str] = set()
        self.refused: set[str] = set()
        self._own: dict[str, Any] = {}

    def path(self, name: str) -> str:
        return f"RoboCorba/{name}"

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

    def address_bound(self, reference: Any) -> str:
        return "10.0.0.1:666"

    def unbind(self, name: str, reference: Any) -> None:
        if self.bindings.get(name) is reference:
            del self.bindings[name]


@pytest.fixture
def names(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(module, "BINDING_CHECK_INTERVAL_S", 0.001)
    return Names()


def test_a_lost_or_stolen_name_is_taken_back_and_logged_once(names: Any, caplog: pytest.LogCaptureFixture) -> None:
    own, false = Reference(), Reference()
    with contextlib.closing(BoundNames(names)) as bound, caplog.at_level(logging.WARNING):
        bound.start({"A": own})
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
        del names.bindings["A"]
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
        assert caplog.messages == []
        for _ in range(3):
            names.bindings["A"] = false
            eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
    assert caplog.messages == ["took back the name RoboCorba/A: an object at 10.0.0.1:666 was bound to it"]
    assert names.bindings == {}


def test_a_name_that_fails_does_not_stop_the_others(names: Any, caplog: pytest.LogCaptureFixture) -> None:
    """Such as one that another process has bound to a reference that can't be read."""
    own = Reference()
    names.unreadable = {"A"}
    with contextlib.closing(BoundNames(names)) as bound, caplog.at_level(logging.WARNING):
        bound.start({"A": own, "B": own})
        eventually(lambda: names.bindings.get("B") is own, PATIENCE_S)
        names.bindings["A"] = Reference()
        del names.bindings["B"]
        eventually(lambda: names.bindings == {"A": own, "B": own}, PATIENCE_S)
    assert caplog.messages == ["took back the name RoboCorba/A: an object at an unknown address was bound to it"]
    names.refused = {"A"}
    with contextlib.closing(BoundNames(names)) as bound:
        bound.start({"A": own, "B": own})
        eventually(lambda: names.bindings.get("B") is own, PATIENCE_S)
        assert not bound.are_bound.is_set()
        names.refused = set()
        assert bound.are_bound.wait(PATIENCE_S)
        assert names.bindings == {"A": own, "B": own}
    assert names.bindings == {}


def test_a_name_that_belongs_to_another_now_is_left_to_it(names: Any) -> None:
    own, other = Reference(), Reference()
    with contextlib.closing(BoundNames(names)) as bound:
        bound.start({"A": own}, lambda: False)
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
        names.bindings["A"] = other
        calls = names.calls
        eventually(lambda: names.calls > calls + 3, PATIENCE_S)
        assert names.bindings["A"] is other
    bound = BoundNames(names)
    bound.start({"A": own})
    eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
    names.fails = True
    names.bindings["A"] = other
    bound.close()
    assert names.bindings == {"A": other}


def test_a_name_that_became_a_context_is_taken_back() -> None:
    bindings: dict[str, Any] = {"A": "context"}

    class Root:
        def rebind(self, path: Any, reference: Any) -> None:
            if bindings.get(path[-1].id) == "context":
                raise CosNaming.NamingContext.NotFound(CosNaming.NamingContext.not_object, path)
            bindings[path[-1].id] = reference

        def unbind(self, path: Any) -> None:
            del bindings[path[-1].id]

    service = module.NamingService(lambda uri: None, Address("127.0.0.1", 2809), "")
    service._root = lambda timeout_s=1.0: Root()  # type: ignore[method-assign]
    service.take_back("A", "own")
    assert bindings == {"A": "own"}


def test_the_address_in_a_reference(orb: Orb) -> None:
    reference = orb.reference("corbaloc:iiop:1.2@10.1.2.3:4567/some/key", CORBA.Object)
    assert address_of(orb.uri(reference)) == IorAddress("10.1.2.3", 4567)
    for malformed in ("", "IOR:", "IOR:zz", "IOR:00", "IOR:01000000ffffffff", "corbaloc::h/a", "IOR:01" * 9):
        assert address_of(malformed) is None


class Bound:
    """An object of every interface, or of another one than all that are asked for."""

    def __init__(self, is_rightful: bool) -> None:
        self._is_rightful = is_rightful

    def _narrow(self, interface: object) -> Bound | None:
        return self if self._is_rightful else None

    def _non_existent(self) -> bool:
        return False


@pytest.fixture
def bound(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is bound to all names, one after the other; the last one stays."""
    found: list[Any] = []
    monkeypatch.setattr(module, "set_call_timeout", lambda reference, timeout_s: None)
    monkeypatch.setattr(
        NamingService, "_lookup", lambda self, name, deadline: found.pop(0) if len(found) > 1 else found[0]
    )
    return found


def test_a_stolen_name_is_resolved_once_its_owner_has_taken_it_back(
    bound: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    names, right = NamingService(lambda uri: None, Address("127.0.0.1", 2809), "RoboCorba"), Bound(True)
    bound += [Bound(False), Bound(False), right]
    assert names.resolve("PathPlanner", RoboCorba.PathPlanner, 60.0, None) is right
    monkeypatch.setattr(module, "STOLEN_S", 0.1)
    bound[:] = [Bound(False)]
    wrong = r"what is bound to RoboCorba/PathPlanner at 127.0.0.1:2809 is not a IDL:RoboCorba/PathPlanner:1.0$"
    for timeout_s, begin in ((60.0, "^"), (0.0, "")):
        with pytest.raises(NotReachable, match=begin + wrong):
            names.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s, None)


def test_an_outage_is_logged_once_and_a_bad_link_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    now = 0.0
    outages = module.BindingOutages(Address("127.0.0.1", 2809), lambda: now)
    failed = [CORBA.TIMEOUT()]
    with caplog.at_level(logging.INFO):
        for _ in range(10):
            outages.note(failed)
        outages.note([])
        for _ in range(20):  # the link changes every second for 40 s
            now += 2.0
            outages.note(failed)
            outages.note([])
        now += 60.0
        outages.note(failed)
    assert caplog.messages == [
        "cannot bind names at 127.0.0.1:2809 (TIMEOUT); retrying",
        "names are bound at 127.0.0.1:2809 again",
        "cannot bind names at 127.0.0.1:2809 (TIMEOUT); retrying; 20 times more since the last line",
    ]


class Away:
    """An object, or a naming context, whose server does not answer."""

    def _narrow(self, interface: object) -> None:
        raise CORBA.TRANSIENT()

    def _unchecked_narrow(self, interface: object) -> Away:
        return self


def test_a_server_at_a_wrong_address_is_not_taken_for_the_naming_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "set_call_timeout", lambda reference, timeout_s: None)
    monkeypatch.setattr(module, "resolve", lambda context, name: Away())

    def unanswered(*arguments: object) -> None:
        raise CORBA.TRANSIENT()

    monkeypatch.setattr(module, "invoke", unanswered)
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

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
from robocorba.corba.naming import BoundNames
from robocorba.corba.orb import Orb
from robocorba.settings import Address
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

    def path(self, name: str) -> str:
        return f"RoboCorba/{name}"

    def bound(self, name: str) -> Any:
        self.calls += 1
        if self.fails:
            raise CORBA.TIMEOUT()
        return self.bindings.get(name)

    def take_back(self, name: str, reference: Any) -> None:
        self.bindings[name] = reference

    def address_bound(self, reference: Any) -> str:
        return "10.0.0.1:666"

    def unbind(self, name: str, reference: Any) -> None:
        if self.bindings.get(name) is reference:
            del self.bindings[name]


@pytest.fixture
def names(monkeypatch: pytest.MonkeyPatch) -> Names:
    monkeypatch.setattr(module, "BINDING_CHECK_INTERVAL_S", 0.001)
    return Names()


def test_a_lost_or_stolen_name_is_taken_back_and_logged_once(names: Names, caplog: pytest.LogCaptureFixture) -> None:
    own, false = Reference(), Reference()
    with contextlib.closing(BoundNames(names)) as bound, caplog.at_level(logging.WARNING):  # type: ignore[arg-type]
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


def test_a_name_that_belongs_to_another_now_is_left_to_it(names: Names) -> None:
    own, other = Reference(), Reference()
    with contextlib.closing(BoundNames(names)) as bound:  # type: ignore[arg-type]
        bound.start({"A": own}, lambda: False)
        eventually(lambda: names.bindings.get("A") is own, PATIENCE_S)
        names.bindings["A"] = other
        calls = names.calls
        eventually(lambda: names.calls > calls + 3, PATIENCE_S)
        assert names.bindings["A"] is other


def test_at_its_end_a_process_leaves_the_name_of_another(names: Names) -> None:
    own, other = Reference(), Reference()
    bound = BoundNames(names)  # type: ignore[arg-type]
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


def test_the_address_in_a_reference() -> None:
    with Orb(Address("127.0.0.1", 2809)) as orb:
        reference = orb.reference("corbaloc:iiop:1.2@10.1.2.3:4567/some/key", CORBA.Object)
        assert address_of(orb.uri(reference)) == IorAddress("10.1.2.3", 4567)


@pytest.mark.parametrize(
    "text", ["", "IOR:", "IOR:zz", "IOR:00", "IOR:01000000ffffffff", "corbaloc::h/a", "IOR:01" * 9]
)
def test_a_malformed_reference_has_no_address(text: str) -> None:
    assert address_of(text) is None

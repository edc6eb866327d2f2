"""Objects of other processes: when they are resolved, and what their exceptions become."""

from __future__ import annotations

from typing import Any

import pytest
from omniORB import CORBA

from robocorba.corba.remote.remote_object import RemoteObject, translated
from robocorba.errors.maps import StaleVersion
from robocorba.errors.robots import RobotLost
from robocorba.errors.services import NotReachable
from robocorba.stubs import RoboCorba


class Naming:
    """An ORB that answers the number of its `resolve` calls."""

    def __init__(self) -> None:
        self.count = 0

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> int:
        assert (name, interface, timeout_s, call_timeout_s) == ("MapEditor", RoboCorba.MapEditor, 2.0, 1.0)
        self.count += 1
        return self.count


def fail(error: Exception) -> Any:
    def operation(reference: Any) -> Any:
        raise error

    return operation


@pytest.fixture
def editor() -> RemoteObject:
    return RemoteObject(Naming(), "MapEditor", RoboCorba.MapEditor, "the map editor", 2.0, 1.0)  # type: ignore[arg-type]


def test_it_is_resolved_once(editor: RemoteObject) -> None:
    assert [editor.call(lambda reference: reference) for _ in range(3)] == [1, 1, 1]


def test_it_is_resolved_again_after_it_did_not_answer(editor: RemoteObject) -> None:
    with pytest.raises(NotReachable, match=r"the map editor does not answer \(.*TRANSIENT"):
        editor.call(fail(CORBA.TRANSIENT()))
    assert editor.call(lambda reference: reference) == 2


def test_it_is_not_resolved_again_after_an_idl_exception(editor: RemoteObject) -> None:
    with pytest.raises(StaleVersion, match="5"):
        editor.call(fail(RoboCorba.StaleVersion(4, 5)))
    assert editor.call(lambda reference: reference) == 1


def test_the_caller_chooses_the_error_of_a_failure() -> None:
    with pytest.raises(RobotLost, match="the adaptor does not answer"), translated("the adaptor", RobotLost):
        raise CORBA.COMM_FAILURE()


def test_an_exception_that_has_no_domain_error_passes() -> None:
    class Strange(CORBA.UserException):
        pass

    with pytest.raises(Strange), translated("the adaptor"):
        raise Strange()

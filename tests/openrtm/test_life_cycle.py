"""The life cycle of components."""

from __future__ import annotations

import pytest

from robocorba.errors.services import NotReachable
from robocorba.openrtm.life_cycle import LifeCycle, ReturnCode, State

OK, REFUSED = ReturnCode.OK, ReturnCode.PRECONDITION_NOT_MET


def test_each_operation_is_allowed_in_one_state() -> None:
    calls: list[str] = []
    life = LifeCycle(lambda: calls.append("stand"), lambda: calls.append("reset"))
    assert life.state is State.INACTIVE
    assert [life.deactivate(), life.reset(), life.fail("why")] == [REFUSED] * 3
    assert life.activate() is OK
    assert life.is_active
    assert [life.activate(), life.reset()] == [REFUSED] * 2
    assert life.fail("the robot is stopped") is OK
    assert (life.state, life.reason) == (State.ERROR, "the robot is stopped")
    assert [life.activate(), life.deactivate(), life.fail("again")] == [REFUSED] * 3
    assert life.reset() is OK
    assert (life.state, life.reason) == (State.INACTIVE, "")
    assert [life.activate(), life.deactivate()] == [OK, OK]
    assert life.state is State.INACTIVE
    assert calls == ["stand", "reset", "stand"]


def test_a_reset_that_fails_keeps_the_error() -> None:
    def reset() -> None:
        raise NotReachable("A is away")

    life = LifeCycle(lambda: None, reset)
    life.activate()
    life.fail("the robot is stopped")
    assert life.reset() is ReturnCode.ERROR
    assert (life.state, life.reason) == (State.ERROR, "A is away")


@pytest.mark.parametrize("kind", [ReturnCode, State])
def test_numbers_are_those_of_the_idl(kind: type[ReturnCode] | type[State]) -> None:
    assert [one.value for one in kind] == list(range(len(kind)))

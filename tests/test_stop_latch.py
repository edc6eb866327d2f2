"""The latch of a robot's stops against a list of all of them."""

from __future__ import annotations

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robocorba.stop_latch import EMERGENCY_STOP, MAX_REASONS, StopLatch


class Latch(RuleBasedStateMachine):
    """An end may name any number, also one that an earlier look has returned."""

    def __init__(self) -> None:
        super().__init__()
        self.latch = StopLatch()
        self.holding: dict[int, str] = {}
        self.count = 0

    @rule(reason=st.sampled_from(["fire", "smoke", ""]))
    def stop(self, reason: str) -> None:
        self.count += 1
        assert self.latch.stop(reason) == self.count
        self.holding[self.count] = reason or EMERGENCY_STOP

    @rule(back=st.integers(-1, 4))
    def end(self, back: int) -> None:
        number = self.count - back
        self.latch.end(number)
        if number <= self.count:
            self.holding = {each: reason for each, reason in self.holding.items() if each > number}

    @rule()
    def restart(self) -> None:
        self.latch = StopLatch(self.latch.number, self.latch.reasons)

    @invariant()
    def holds_what_was_not_ended(self) -> None:
        assert self.latch.is_on == bool(self.holding)
        assert self.latch.reason in {"", *self.holding.values()}
        assert bool(self.latch.reason) == self.latch.is_on


TestLatch = Latch.TestCase


def test_many_reasons_are_kept_as_few() -> None:
    latch = StopLatch()
    for number in range(3 * MAX_REASONS):
        latch.stop(f"reason {number}")
    assert len(latch.reasons) == MAX_REASONS
    latch.end(3 * MAX_REASONS - 1)
    assert latch.is_on
    latch.end(3 * MAX_REASONS)
    assert not latch.is_on

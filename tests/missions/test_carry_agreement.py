"""A carry's leader and its carriers, over a channel that loses, delays and reorders orders, with clocks that differ: no
setpoint jumps, time without orders is no progress, and all are at the same place again once orders arrive."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robocorba.missions.carry_progress import CATCH_UP_RATE, STANDS_AFTER_S, CarryProgress, LeaderRhythm

CYCLE_S, ORDER_S, LEAD_S, BEGAN = 0.02, 0.1, 0.15, 1000.0
#: Carriers; the first one receives every order at once, and knows the leader's clock exactly.
CARRIERS = 3
EPSILON = 1e-6

Fate = st.sampled_from(["arrives", "arrives", "lost", "late"])


class Carrier:
    """What a carrier does with its progress, and how it moved."""

    def __init__(self) -> None:
        self.progress, self.late = CarryProgress(), []  # type: tuple[CarryProgress, list[tuple[Any, float]]]
        self.progress.hold()
        #: Error of the carrier's estimate of the leader's clock [s].
        self.off_s = 0.0
        self.last = (BEGAN, 0.0)
        self.jump = 0.0

    def control(self, now: float) -> None:
        """A control cycle, at `now` of the leader's clock."""
        now += self.off_s
        then, before_s = self.last
        reached_s, _ = self.progress.at(now)
        allowed_s = CATCH_UP_RATE * max(0.0, now - then)
        self.jump = max(self.jump, abs(reached_s - before_s) - allowed_s)
        self.last = (now, reached_s)

    @property
    def reached_s(self) -> float:
        return self.last[1]


class Carry(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.now = BEGAN
        self.leader = LeaderRhythm(BEGAN + 0.3, LEAD_S, 1e6)
        self.carriers = [Carrier() for _ in range(CARRIERS)]
        self.publish(["arrives"] * (CARRIERS - 1))

    def publish(self, fates: list[str], is_up: bool = True) -> None:
        order = self.leader.order(self.now)
        if not is_up:
            return
        self.leader.note_sent(order, self.now)
        for carrier, fate in zip(self.carriers, ["arrives", *fates], strict=True):
            if fate == "arrives":
                carrier.progress.follow(*order, sent=self.now)
            elif fate == "late":
                carrier.late.append((order, self.now))

    def pass_time(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / CYCLE_S))):
            self.now += CYCLE_S
            for carrier in self.carriers:
                carrier.control(self.now)

    @rule(fates=st.lists(st.lists(Fate, min_size=CARRIERS - 1, max_size=CARRIERS - 1), min_size=1, max_size=20))
    def orders_come(self, fates: list[list[str]]) -> None:
        for each in fates:
            self.pass_time(ORDER_S)
            self.publish(each)

    @rule(seconds=st.floats(0.1, 4.0), is_up=st.booleans())
    def the_leader_is_silent(self, seconds: float, is_up: bool) -> None:
        """Its process is stopped, or its channel is down: then it goes on trying."""
        before_s = self.carriers[0].reached_s
        for _ in range(round(seconds / ORDER_S)):
            self.pass_time(ORDER_S)
            if not is_up:
                self.publish([], is_up=False)
        assert self.carriers[0].reached_s <= before_s + CATCH_UP_RATE * STANDS_AFTER_S + EPSILON
        if seconds > STANDS_AFTER_S + ORDER_S:
            assert self.leader.order(self.now).at(self.now) == pytest.approx(self.carriers[0].reached_s, abs=EPSILON)

    @rule(rate=st.sampled_from([0.0, 0.5, 1.0]), is_late=st.booleans())
    def the_rate_changes(self, rate: float, is_late: bool) -> None:
        """The leader's thread may have been stopped before."""
        self.pass_time(1.2 if is_late else CYCLE_S)
        if self.leader.set_rate(rate, self.now):
            self.publish(["arrives"] * (CARRIERS - 1))

    @rule(carrier=st.integers(1, CARRIERS - 1), number=st.integers(0, 100))
    def a_late_order_arrives(self, carrier: int, number: int) -> None:
        """Whichever of them."""
        late = self.carriers[carrier].late
        if late:
            order, sent = late.pop(number % len(late))
            self.carriers[carrier].progress.follow(*order, sent=sent)

    @rule(carrier=st.integers(1, CARRIERS - 1), off_s=st.floats(-0.03, 0.03))
    def a_clock_is_measured_again(self, carrier: int, off_s: float) -> None:
        self.carriers[carrier].off_s = off_s

    @rule(carrier=st.integers(1, CARRIERS - 1), hours=st.sampled_from([-1.0, 1.0]))
    def a_clock_is_far_off_for_a_while(self, carrier: int, hours: float) -> None:
        """Before it is measured the first time, or after its computer slept."""
        self.carriers[carrier].off_s += 3600.0 * hours
        self.pass_time(0.5)
        self.carriers[carrier].off_s -= 3600.0 * hours

    @rule()
    def all_agree_after_the_next_orders(self) -> None:
        """At once, except for those that lost orders, which catch up."""
        self.publish(["arrives"] * (CARRIERS - 1))
        behind_s = max(abs(each.reached_s - self.carriers[0].reached_s) for each in self.carriers)
        for _ in range(round((1.0 + behind_s / (CATCH_UP_RATE - 1.0)) / ORDER_S) + 1):
            self.pass_time(ORDER_S)
            self.publish(["arrives"] * (CARRIERS - 1))
        for carrier in self.carriers:
            assert carrier.reached_s == pytest.approx(self.leader.at(self.now), abs=abs(carrier.off_s) + EPSILON)

    @invariant()
    def no_setpoint_jumps(self) -> None:
        assert all(carrier.jump <= EPSILON for carrier in self.carriers)


def test_an_order_of_a_moment_to_come_by_a_late_clock_is_no_jump() -> None:
    carry = Carry()
    carry.carriers[1].off_s = -0.027
    carry.all_agree_after_the_next_orders()
    carry.no_setpoint_jumps()


TestCarry = Carry.TestCase
TestCarry.settings = settings(
    max_examples=12, stateful_step_count=25, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)

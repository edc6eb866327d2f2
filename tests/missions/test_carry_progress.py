"""How far a carrier is in a carry, by the orders of its leader."""

from __future__ import annotations

import numpy as np
import pytest

from robocorba.missions.carry_control import UNKNOWN_AFTER_S, CarryMotion
from robocorba.missions.carry_progress import CATCH_UP_RATE, SLOWS_DOWN_AFTER_S, STANDS_AFTER_S, CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.trajectory import SPEED_M_S, Trajectory
from robocorba.motion.robot_state import RobotState
from robocorba.spatial.pose import Limits

#: Trajectory time for which a body moves on at the full rate after the last order [s].
COASTS_S = (SLOWS_DOWN_AFTER_S + STANDS_AFTER_S) / 2


@pytest.fixture
def progress() -> CarryProgress:
    """At half the planned rate from time 100 on; the last order was sent at 102."""
    progress = CarryProgress()
    progress.hold(4.0)
    for number in range(22):
        progress.follow(since=100.0, trajectory_s=4.0, rate=0.5, sent=99.9 + 0.1 * number)
    return progress


def test_it_goes_on_while_orders_come(progress: CarryProgress) -> None:
    assert progress.at(102.0) == (pytest.approx(5.0), 0.5)


def test_it_stands_without_orders(progress: CarryProgress) -> None:
    assert progress.at(102.0 + STANDS_AFTER_S) == (pytest.approx(5.0 + 0.5 * COASTS_S), 0.0)
    assert progress.at(110.0) == (pytest.approx(5.0 + 0.5 * COASTS_S), 0.0)


def test_it_slows_down_evenly_without_orders(progress: CarryProgress) -> None:
    """As fast as a base can from the speed of carries, and without a jump of place or rate."""
    times = np.linspace(102.0, 103.0, 1001)
    places, rates = np.array([progress.at(time) for time in times]).T
    slowing = (times > 102.0 + SLOWS_DOWN_AFTER_S) & (times < 102.0 + STANDS_AFTER_S)
    assert np.all(np.diff(rates) <= 1e-9)
    assert SPEED_M_S * np.max(-np.diff(rates) / np.diff(times)) <= 0.5 * Limits().acceleration + 1e-6
    assert np.allclose(np.diff(places) / np.diff(times), (rates[1:] + rates[:-1]) / 2, atol=1e-3)
    assert 0.0 < rates[slowing].min() < rates[slowing].max() < 0.5


def test_a_late_order_leads_back_to_the_rhythm(progress: CarryProgress) -> None:
    before_s, _ = progress.at(102.3)
    progress.follow(since=100.0, trajectory_s=4.0, rate=0.5, sent=102.25)
    assert progress.at(102.3) == (before_s, CATCH_UP_RATE)
    assert progress.at(102.39) == (pytest.approx(5.195), 0.5)


def test_lost_orders_are_caught_up_without_a_jump(progress: CarryProgress) -> None:
    """Those of this carrier only: the others went on. Until then the leader sees how far it is from its place."""
    stood_s, _ = progress.at(103.2)
    assert progress.ordered_s(103.2) == pytest.approx(5.6)
    progress.follow(since=100.0, trajectory_s=4.0, rate=0.5, sent=103.2)
    assert progress.at(103.2) == (stood_s, CATCH_UP_RATE)
    assert progress.at(103.3) == (pytest.approx(stood_s + 0.1 * CATCH_UP_RATE), CATCH_UP_RATE)


def test_it_changes_its_rate_in_time(progress: CarryProgress) -> None:
    progress.follow(since=102.3, trajectory_s=5.15, rate=1.0, sent=102.2)
    assert progress.at(102.25) == (pytest.approx(5.125), 0.5)
    assert progress.at(102.3) == (pytest.approx(5.15), 1.0)


def test_it_stands_until_the_first_change_after_lost_orders(progress: CarryProgress) -> None:
    """The order to stop was lost, and the next one to go on is for a moment that has not come yet."""
    progress.follow(since=110.1, trajectory_s=5.3, rate=1.0, sent=110.0)
    stood_s = 5.0 + 0.5 * COASTS_S
    assert progress.at(110.05) == (pytest.approx(stood_s), 0.0)
    assert progress.at(110.15) == (pytest.approx(stood_s + 0.1 * CATCH_UP_RATE), CATCH_UP_RATE)


def test_it_stands_until_the_orders_of_another_leader(progress: CarryProgress) -> None:
    """Whose clock is far behind."""
    progress.hold(progress.at(110.0)[0])
    stood_s = 5.0 + 0.5 * COASTS_S
    assert progress.at(20.0) == (pytest.approx(stood_s), 0.0)
    progress.follow(since=21.0, trajectory_s=stood_s, rate=1.0, sent=20.9)
    assert progress.at(20.95) == (pytest.approx(stood_s), 0.0)
    assert progress.at(21.05) == (pytest.approx(stood_s + 0.05), pytest.approx(1.0))


class Clock(LeaderClock):
    """The leader's clock, which the test sets [s]."""

    time = 100.0

    def now(self) -> float:
        return self.time


def test_a_carrier_whose_state_is_unknown_falls_behind() -> None:
    """So the leader stops the carry before the carrier is too far from its place to go on."""
    clock, progress = Clock(), CarryProgress()
    progress.hold(1.0)
    trajectory = Trajectory([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)], [(-1.0, 0.0, 0.0)])
    motion = CarryMotion(trajectory, (-1.0, 0.0, 0.0), progress, clock, lambda: 0.0)

    def wait(seconds: float) -> None:
        for _ in range(round(seconds / 0.1) + 1):
            clock.time += seconds / (round(seconds / 0.1) + 1)
            progress.follow(since=100.0, trajectory_s=1.0, rate=1.0, sent=clock.time)

    assert motion.error_m == 0.0
    wait(0.0)
    (x, y, heading), _ = trajectory.carrier(1.0, (-1.0, 0.0, 0.0))
    assert motion.command(RobotState(0.0, x, y, heading), 0.0)
    wait(UNKNOWN_AFTER_S / 2)
    assert motion.error_m == pytest.approx(0.0, abs=1e-9)
    wait(1.0)
    assert motion.error_m > LeaderPolicy().stop_error_m
    (x, y, heading), _ = trajectory.carrier(trajectory.duration, (-1.0, 0.0, 0.0))
    wait(trajectory.duration)
    assert motion.command(RobotState(0.0, x, y, heading), 0.0) is None
    wait(10.0)
    assert motion.error_m == pytest.approx(0.0, abs=1e-9)  # it has arrived

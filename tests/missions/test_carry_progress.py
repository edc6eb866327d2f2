"""How far a carrier is in a carry, by the orders of its leader."""

from __future__ import annotations

import pytest

from robocorba.missions.carry_control import LEADER_TIMEOUT_S, CarryProgress


@pytest.fixture
def progress() -> CarryProgress:
    """At half the planned rate from time 100 on; the last order was sent at 102."""
    progress = CarryProgress()
    progress.follow(since=100.0, trajectory_s=4.0, rate=0.5, sent=99.9)
    progress.follow(since=100.0, trajectory_s=4.0, rate=0.5, sent=102.0)
    return progress


def test_it_goes_on_while_orders_come(progress: CarryProgress) -> None:
    assert progress.at(102.0) == (5.0, 0.5)


def test_it_stands_without_orders(progress: CarryProgress) -> None:
    assert progress.at(110.0) == (pytest.approx(5.0 + 0.5 * LEADER_TIMEOUT_S), 0.0)


def test_it_changes_its_rate_in_time(progress: CarryProgress) -> None:
    progress.follow(since=102.5, trajectory_s=5.25, rate=1.0, sent=102.2)
    assert progress.at(102.4) == (pytest.approx(5.2), 0.5)
    assert progress.at(102.5) == (5.25, 1.0)


def test_it_stands_until_the_first_change_after_lost_orders(progress: CarryProgress) -> None:
    """The order to stop was lost, and the next one to go on is for a moment that has not come yet."""
    progress.follow(since=110.2, trajectory_s=5.3, rate=1.0, sent=110.0)
    stood_s = 5.0 + 0.5 * LEADER_TIMEOUT_S
    assert progress.at(110.1) == (pytest.approx(stood_s), 0.0)
    assert progress.at(110.3) == (pytest.approx(5.4), 1.0)


def test_it_stands_until_the_orders_of_another_leader(progress: CarryProgress) -> None:
    """Whose clock is far behind."""
    progress.hold(progress.at(110.0)[0])
    stood_s = 5.0 + 0.5 * LEADER_TIMEOUT_S
    assert progress.at(20.0) == (pytest.approx(stood_s), 0.0)
    progress.follow(since=21.0, trajectory_s=stood_s, rate=1.0, sent=20.8)
    assert progress.at(20.9) == (pytest.approx(stood_s), 0.0)
    assert progress.at(21.1) == (pytest.approx(stood_s + 0.1), 1.0)

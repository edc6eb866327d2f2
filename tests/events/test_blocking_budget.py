"""How long a consumer may hold up the suppliers of a channel."""

from __future__ import annotations

import logging

import pytest

from robocorba.events.blocking_budget import BUDGET_S, RETURNS_IN_S, BlockingBudget
from tests.clock import Clock


def test_time_is_used_up_and_returns(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    budget = BlockingBudget(clock)
    assert budget.left_s() == BUDGET_S
    with caplog.at_level(logging.WARNING):
        budget.spend(BUDGET_S - 1.0, "logger")
        assert budget.left_s() == pytest.approx(1.0)
        assert not caplog.records
        budget.spend(2.0, "logger")
        budget.spend(0.5, "logger")
    assert budget.left_s() == pytest.approx(-1.5)
    (record,) = caplog.records
    assert "consumer logger" in record.getMessage()
    clock.now += RETURNS_IN_S / 2
    assert budget.left_s() == pytest.approx(BUDGET_S / 2 - 1.5)
    clock.now += 10 * RETURNS_IN_S
    assert budget.left_s() == BUDGET_S


def test_it_is_reported_again_when_all_had_returned(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    budget = BlockingBudget(clock)
    for _ in range(2):
        budget.spend(BUDGET_S, "logger")
        clock.now += 2 * RETURNS_IN_S
    assert len(caplog.records) == 2

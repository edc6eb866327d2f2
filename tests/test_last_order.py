"""Orders of which only the newest counts."""

from __future__ import annotations

import queue

from robocorba.errors.base import RoboCorbaError
from robocorba.last_order import LastOrder

#: Whatever it runs on: a report is waited for at most this long [s].
LIMIT_S = 30.0


def test_each_order_ends_with_a_report_and_the_next_one_has_its_chance() -> None:
    reports: queue.Queue[str] = queue.Queue()

    def execute(order: Exception | str) -> None:
        if isinstance(order, Exception):
            raise order

    orders = LastOrder("test", execute, reports.put)
    orders.give(RoboCorbaError("not possible"))
    assert reports.get(timeout=LIMIT_S) == "not possible"
    orders.give(ValueError("a fault"))
    assert "internal fault (ValueError: a fault)" in reports.get(timeout=LIMIT_S)
    orders.give("an order")
    assert reports.get(timeout=LIMIT_S) == ""
    orders.close()

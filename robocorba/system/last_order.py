"""Orders of which only the newest counts, executed one after the other."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from robocorba.errors.base import RoboCorbaError
from robocorba.system.background import Background

OrderT = TypeVar("OrderT")

_log = logging.getLogger(__name__)


class LastOrder(Generic[OrderT]):
    """Executes orders in a thread of its own, one after the other; a new one replaces one that waits. report: called
    with the error of one that fails, also by a defect, or with empty text after one that does not."""

    def __init__(self, name: str, execute: Callable[[OrderT], None], report: Callable[[str], None]) -> None:
        self._execute, self._report = execute, report
        self._condition = threading.Condition()
        self._waiting: OrderT | None = None
        self._is_closed = False
        self._thread = Background(name, self._run, report)
        self._thread.start()

    def give(self, order: OrderT) -> None:
        with self._condition:
            self._waiting = order
            self._condition.notify()

    def close(self) -> None:
        """Drop what waits, and end the thread after the present order."""
        with self._condition:
            self._waiting, self._is_closed = None, True
            self._condition.notify()

    def _run(self) -> None:
        while (order := self._next()) is not None:
            try:
                self._execute(order)
                self._report("")
            except RoboCorbaError as error:
                self._report(str(error))
            except Exception as error:  # the next order has its chance
                _log.exception("an order failed by a defect")
                self._report(f"internal fault ({type(error).__name__}: {error}), see the log")

    def _next(self) -> OrderT | None:
        with self._condition:
            self._condition.wait_for(lambda: self._is_closed or self._waiting is not None)
            order, self._waiting = self._waiting, None
            return order

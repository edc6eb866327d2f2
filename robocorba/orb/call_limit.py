"""Limits of the calls that a server executes at the same time.

Each connection has a thread of its own, so a client that stalls blocks nobody. But threads that compute share one
interpreter: a hundred at once delay everything in the process, also what has a deadline. Calls beyond a limit wait
outside of the interpreter, which costs the others nothing."""

from __future__ import annotations

import functools
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from omniORB import CORBA

from robocorba.orb.texts import refuse_unreadable_texts
from robocorba.orb.workarounds import operations_of

#: Maximum number of waiting calls, unless CallLimit sets another one.
MAX_WAITING = 2000
#: Maximum time for which a call waits [s]. Callers of ours stop waiting after 10 s, and may not repeat it before.
WAITING_LIMIT_S = 8.0


class CallLimit:
    """At most `at_once` calls run at the same time, and `waiting` more wait, each for `limit_s` [s] at most; the one
    that has waited longest goes first.

    A call that can't wait, or has waited in vain, raises CORBA.TRANSIENT: it was not executed. Whether its client still
    waits is not looked up: that takes as long as most calls do, and just when there are too many.

    Python's own semaphore takes a lock in each operation. Where dozens of threads want it, the one that holds this lock
    often waits for the interpreter, and all others for it: a short call waited for 1.4 s behind sixty others. Here each
    waiting thread has a lock of its own, and single operations of deques, which are atomic, do the rest."""

    def __init__(self, at_once: int, waiting: int = MAX_WAITING, limit_s: float = WAITING_LIMIT_S) -> None:
        self._max_waiting, self._limit_s = waiting, limit_s
        self._free = deque([None] * at_once)
        #: Locks that are held until their thread gets a place.
        self._waiting: deque[threading.Lock] = deque()

    def apply(self, servant: Any, *operations: str) -> None:
        """Limit these operations of a servant, or all; attributes are called _get_NAME and _set_NAME."""
        kind: Any = type(servant)
        refuse_unreadable_texts(kind)  # before the operations are replaced
        for name in operations or tuple(operations_of(servant)):
            setattr(servant, name, self.limited(getattr(servant, name)))

    def limited(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, within this limit."""

        @functools.wraps(call)
        def within(*arguments: Any) -> Any:
            with self.place():
                return call(*arguments)

        return within

    @contextmanager
    def place(self) -> Iterator[None]:
        """A place for a part of a call. Raises CORBA.TRANSIENT."""
        has_place = not self._waiting and self._has_taken_free()
        if not has_place and not self._has_got_place():
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        try:
            yield
        finally:
            self._free.append(None)
            self._serve_waiting()

    def _has_got_place(self) -> bool:
        """Wait for a place; False if too many threads wait already, or none became free in time."""
        if len(self._waiting) >= self._max_waiting:
            return False
        got_place = threading.Lock()
        got_place.acquire()
        self._waiting.append(got_place)
        self._serve_waiting()  # a place may have become free before this thread began to wait
        if got_place.acquire(timeout=self._limit_s):
            return True
        try:
            self._waiting.remove(got_place)
        except ValueError:  # it has got a place just now
            return True
        return False

    def _serve_waiting(self) -> None:
        """Hand free places to waiting threads."""
        while self._waiting and self._has_taken_free():
            try:
                self._waiting.popleft().release()
            except IndexError:  # all have given up or been served meanwhile
                self._free.append(None)

    def _has_taken_free(self) -> bool:
        try:
            self._free.pop()
        except IndexError:
            return False
        return True

"""Limits of the calls that a server executes at the same time.

Each connection has a thread of its own, so a client that stalls blocks nobody. But threads that compute share one
interpreter: a hundred at once delay everything in the process, also what has a deadline. Calls beyond a limit wait
outside of the interpreter, which costs the others nothing."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

from omniORB import CORBA

from robocorba.corba.texts import refuse_unreadable_texts

#: Maximum number of waiting calls, unless CallLimit sets another one.
MAX_WAITING = 2000
#: Maximum time for which a call waits [s]. Callers of ours stop waiting after 10 s, and may not repeat it before.
WAITING_LIMIT_S = 8.0


class CallLimit:
    """At most `at_once` calls run at the same time, and `waiting` more wait, each for `limit_s` [s] at most.

    A call that can't wait, or has waited in vain, raises CORBA.TRANSIENT: it was not executed."""

    def __init__(self, at_once: int, waiting: int = MAX_WAITING, limit_s: float = WAITING_LIMIT_S) -> None:
        self._free = threading.Semaphore(at_once)
        self._places = threading.Semaphore(at_once + waiting)
        self._limit_s = limit_s

    def apply(self, servant: Any, *operations: str) -> None:
        """Limit these operations of a servant, or all; attributes are called _get_NAME and _set_NAME."""
        kind: Any = type(servant)
        refuse_unreadable_texts(kind)  # before the operations are replaced
        for name in operations or tuple(servant._omni_op_d):
            setattr(servant, name, self.limited(getattr(servant, name)))

    def limited(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, within this limit."""

        @functools.wraps(call)
        def within(*arguments: Any) -> Any:
            if not self._places.acquire(blocking=False):
                raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
            try:
                if not self._free.acquire(timeout=self._limit_s):
                    raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
                try:
                    return call(*arguments)
                finally:
                    self._free.release()
            finally:
                self._places.release()

        return within

"""The life cycle of an RT component in its execution context (OMG RTC 1.1, section 5.2.2.3)."""

from __future__ import annotations

import enum
import threading
from collections.abc import Callable

from robocorba.errors.base import RoboCorbaError


class ReturnCode(enum.Enum):
    """What operations of components answer, by its number in the IDL."""

    OK = 0
    ERROR = 1
    BAD_PARAMETER = 2
    UNSUPPORTED = 3
    OUT_OF_RESOURCES = 4
    PRECONDITION_NOT_MET = 5


class State(enum.Enum):
    """Of a component in an execution context, by its number in the IDL."""

    CREATED = 0
    INACTIVE = 1
    ACTIVE = 2
    ERROR = 3


class LifeCycle:
    """INACTIVE at first. Thread-safe; transitions happen one after the other, and wait for what they call.

    on_deactivated: called after ACTIVE. on_reset: called before ERROR ends; that it raises RoboCorbaError keeps it."""

    def __init__(self, on_deactivated: Callable[[], None], on_reset: Callable[[], None]) -> None:
        self._on_deactivated, self._on_reset = on_deactivated, on_reset
        self._lock = threading.Lock()
        self._state = State.INACTIVE
        #: Why it is in ERROR.
        self.reason = ""

    @property
    def state(self) -> State:
        return self._state

    @property
    def is_active(self) -> bool:
        return self._state is State.ACTIVE

    def activate(self) -> ReturnCode:
        with self._lock:
            if self._state is not State.INACTIVE:
                return ReturnCode.PRECONDITION_NOT_MET
            self._state = State.ACTIVE
            return ReturnCode.OK

    def deactivate(self) -> ReturnCode:
        return self._end(State.INACTIVE, "")

    def fail(self, reason: str) -> ReturnCode:
        """ACTIVE ends by an error."""
        return self._end(State.ERROR, reason)

    def reset(self) -> ReturnCode:
        with self._lock:
            if self._state is not State.ERROR:
                return ReturnCode.PRECONDITION_NOT_MET
            try:
                self._on_reset()
            except RoboCorbaError as error:
                self.reason = str(error)
                return ReturnCode.ERROR
            self._state, self.reason = State.INACTIVE, ""
            return ReturnCode.OK

    def _end(self, state: State, reason: str) -> ReturnCode:
        with self._lock:
            if self._state is not State.ACTIVE:
                return ReturnCode.PRECONDITION_NOT_MET
            self._state, self.reason = state, reason
            self._on_deactivated()
            return ReturnCode.OK

"""Calls to CORBA objects: their timeouts, and descriptions of their errors."""

from __future__ import annotations

from typing import Any

import omniORB
from omniORB import CORBA


def set_call_timeout(reference: Any, timeout_s: float | None) -> None:
    """Set the timeout of calls through this reference object; None: the timeout of the ORB."""
    omniORB.setClientCallTimeout(reference, 0 if timeout_s is None else max(1, round(timeout_s * 1000)))


def describe(error: BaseException) -> str:
    """The name of an error, with omniORB's minor code for system exceptions, such as TRANSIENT_ConnectFailed."""
    if isinstance(error, CORBA.SystemException):
        minor = omniORB.minorCodeToString(error)
        return str(minor) if isinstance(minor, str) else type(error).__name__
    return type(error).__name__

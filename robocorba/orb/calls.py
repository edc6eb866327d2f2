"""Calls to CORBA objects: their timeouts, and descriptions of their errors."""

from __future__ import annotations

from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.orb.exceptions import domain_error

#: What calls to CORBA objects raise that nobody has translated; `error_of` describes it.
CALL_ERRORS: tuple[type[Exception], ...] = (CORBA.Exception,)


def set_call_timeout(reference: Any, timeout_s: float | None) -> None:
    """Set the timeout of calls through this reference object; None: the timeout of the ORB."""
    omniORB.setClientCallTimeout(reference, 0 if timeout_s is None else max(1, round(timeout_s * 1000)))


def describe(error: BaseException) -> str:
    """The name of an error, with omniORB's minor code for system exceptions, such as TRANSIENT_ConnectFailed."""
    if isinstance(error, CORBA.SystemException):
        minor = omniORB.minorCodeToString(error)
        return str(minor) if isinstance(minor, str) else type(error).__name__
    return type(error).__name__


def error_of(error: Any) -> str:
    """A sentence that describes any error, also one of CORBA, for display."""
    if isinstance(error, CORBA.SystemException):
        return f"the call failed ({describe(error)})"
    if isinstance(error, CORBA.UserException):
        return str(domain_error(error) or f"{type(error).__name__}: {error}")
    return str(error)

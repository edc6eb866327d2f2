"""Calls to CORBA objects: how long they may take, and what went wrong."""

from __future__ import annotations

from typing import Any

import omniORB
from omniORB import CORBA


def limit_calls(reference: Any, timeout_s: float | None) -> None:
    """How long each call by this very reference may take; None: as long as its ORB says."""
    omniORB.setClientCallTimeout(reference, 0 if timeout_s is None else max(1, round(timeout_s * 1000)))


def describe(error: BaseException) -> str:
    """'TRANSIENT_ConnectFailed' for omniORB's system exceptions, which say little as text."""
    if isinstance(error, CORBA.SystemException):
        minor = omniORB.minorCodeToString(error)
        return str(minor) if isinstance(minor, str) else type(error).__name__
    return type(error).__name__

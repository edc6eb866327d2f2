"""Connections that arrive while a process starts wait until all its servants are active.

omniORB accepts calls as soon as its first adapter exists, and answers OBJECT_NOT_EXIST, which means permanently gone,
for objects that are not active yet. Its accepting thread reports each connection; while the door is closed, the report
of the first one waits, and all others wait in the kernel's queue. The threads that serve connections know nothing of
it: hundreds of them that Python knows would stop the process for seconds when they end at the same time."""

from __future__ import annotations

import threading

import omniORB
from omniORB import ConnectionInfo


class Door:
    """No connection is served while it is closed. A new one is open; close it before the first adapter exists."""

    def __init__(self) -> None:
        self._is_open = threading.Event()

    def close(self) -> None:
        omniORB.registerConnectionInfoFn(self._report)

    def open(self) -> None:
        if not self._is_open.is_set():
            omniORB.registerConnectionInfoFn(None)
            self._is_open.set()

    def _report(self, event: int, is_error: bool, address: str, info: str | None) -> None:
        if event == ConnectionInfo.ACCEPTED_CONNECTION:
            self._is_open.wait()

"""Connections that arrive while a process starts wait until all its servants are active.

omniORB accepts calls as soon as its first adapter exists, and answers OBJECT_NOT_EXIST, which means permanently gone,
for objects that are not active yet. Its accepting thread reports each connection; while the door is closed, the report
of the first one waits, and all others wait in the kernel's queue. The threads that serve connections know nothing of
it: hundreds of them that Python knows would stop the process for seconds when they end at the same time."""

from __future__ import annotations

import contextlib
import ctypes
import re
import threading
from pathlib import Path

import omniORB
from omniORB import ConnectionInfo

#: Where the kernel lists the libraries that this process has loaded.
_MAPS = Path("/proc/self/maps")
#: Of omniORB: the address of the object that gets the reports, null for none.
_RECEIVER = "_ZN4omni14ConnectionInfo9singletonE"


class Door:
    """No connection is served while it is closed. A new one is open; close it before the first adapter exists."""

    def __init__(self) -> None:
        self._is_open = threading.Event()

    def close(self) -> None:
        if (receiver := _receiver()) is not None and not receiver.value:
            omniORB.registerConnectionInfoFn(self._report)

    def open(self) -> None:
        if not self._is_open.is_set():
            if (receiver := _receiver()) is not None:
                receiver.value = None
            self._is_open.set()

    def _report(self, event: int, is_error: bool, address: str, info: str | None) -> None:
        if event == ConnectionInfo.ACCEPTED_CONNECTION:
            self._is_open.wait()


def _receiver() -> ctypes.c_void_p | None:
    """omniORB's own way to end the reports frees the receiver, in which other threads may be. None where it is unknown:
    then no connection waits."""
    with contextlib.suppress(OSError, ValueError):  # another operating system, another release
        if library := re.search(r"/\S*libomniORB4\S*", _MAPS.read_text()):
            return ctypes.c_void_p.in_dll(ctypes.CDLL(library[0]), _RECEIVER)
    return None

"""The request to stop a process: by a signal, or by its own code."""

from __future__ import annotations

import contextlib
import signal
import socket
import time
from typing import Any

#: The signals that ask for it.
SIGNALS = (signal.SIGINT, signal.SIGTERM)
#: Those that catch signals. While the interpreter has its descriptor, none of them may be closed as garbage: the bytes
#: would go to whatever gets the descriptor next.
_catching: list[StopRequest] = []


class StopRequest:
    """Whether this process has to stop, and a wait for that.

    The interpreter's C code writes a byte for each signal into a socket, which the wait reads. A wait for a lock, as in
    a queue's get(), would miss a signal that came just before it began, or in another thread: handlers run in the main
    thread, and only when that does not wait."""

    def __init__(self) -> None:
        self.is_made = False
        self._reading, self._writing = socket.socketpair()
        self._writing.setblocking(False)
        #: The handlers of signals that were there before, and the descriptor for their bytes.
        self._handlers: dict[int, Any] = {}
        self._descriptor = -1

    def catch_signals(self) -> None:
        """From now on SIGINT and SIGTERM make the request, instead of ending the process. Main thread only."""
        if not self._handlers:
            _catching.append(self)
            self._descriptor = signal.set_wakeup_fd(self._writing.fileno(), warn_on_full_buffer=False)
            self._handlers = {number: signal.signal(number, lambda *_: self.make()) for number in SIGNALS}

    def release_signals(self) -> None:
        """They do again what they did before `catch_signals`."""
        if not self._handlers:
            return
        try:
            signal.set_wakeup_fd(self._descriptor, warn_on_full_buffer=False)
        except OSError:  # its owner has closed it meanwhile
            signal.set_wakeup_fd(-1)
        while self._handlers:
            signal.signal(*self._handlers.popitem())
        _catching.remove(self)

    def make(self) -> None:
        """Let this process stop; from any thread or signal handler."""
        self.is_made = True
        with contextlib.suppress(OSError):  # full: there is enough to read; closed: nobody waits
            self._writing.send(b"\0")

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the request at most `timeout_s` [s], None: without a limit; returns whether it was made. Main
        thread only, if a signal has to end it."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while not self.is_made:
            left_s = None if deadline is None else deadline - time.monotonic()
            if left_s is not None and left_s <= 0:
                break
            self._reading.settimeout(left_s)
            with contextlib.suppress(TimeoutError):
                self._reading.recv(64)
        return self.is_made

    def close(self) -> None:
        self.release_signals()
        self._reading.close()
        self._writing.close()

"""The ends of child processes, in an event loop."""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
from collections import OrderedDict

_PR_SET_CHILD_SUBREAPER = 36
#: Ends remembered of processes that nobody has asked for.
MAX_UNCLAIMED = 1000


class Children:
    """The ends of all children of this process. It adopts the processes below it whose own parents have ended, so that
    their ends are noticed too. To be used in the thread of the event loop, one for a process; no other part of the
    process may wait for children."""

    def __init__(self) -> None:
        self._ends: dict[int, asyncio.Future[int]] = {}
        self._unclaimed: OrderedDict[int, int] = OrderedDict()
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
        asyncio.get_running_loop().add_signal_handler(signal.SIGCHLD, self._reap)

    def end_of(self, pid: int) -> asyncio.Future[int]:
        """Done when the child has ended, with its exit code, or the negative number of the signal that ended it."""
        future = asyncio.get_running_loop().create_future()
        if pid in self._unclaimed:
            future.set_result(self._unclaimed.pop(pid))
        else:
            self._ends[pid] = future
        return future

    def close(self) -> None:
        asyncio.get_running_loop().remove_signal_handler(signal.SIGCHLD)

    def _reap(self) -> None:
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            code = os.waitstatus_to_exitcode(status)
            future = self._ends.pop(pid, None)
            if future is None:
                self._unclaimed[pid] = code
                while len(self._unclaimed) > MAX_UNCLAIMED:
                    self._unclaimed.popitem(last=False)
            elif not future.done():
                future.set_result(code)

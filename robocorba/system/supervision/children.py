"""The ends of child processes, in an event loop."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import os
import signal


class Children:
    """The ends of child processes that lead sessions. Processes below this one whose own parents end become its
    children. To be used in the thread of the event loop, one for a process."""

    def __init__(self) -> None:
        self._ends: dict[int, asyncio.Future[int]] = {}
        #: Sessions whose leaders have ended, with processes that may still be there.
        self._sessions: set[int] = set()
        set_subreaper(True)
        asyncio.get_running_loop().add_signal_handler(signal.SIGCHLD, self._reap)

    def end_of(self, pid: int) -> asyncio.Future[int]:
        """Done when the child has ended, with its exit code, or the negative number of the signal that ended it."""
        self._ends[pid] = asyncio.get_running_loop().create_future()
        future = self._ends[pid]
        self._reap()  # it may have ended before
        return future

    def knows(self, pid: int) -> bool:
        """Whether somebody has asked for the end of a child that has not ended."""
        return pid in self._ends

    def close(self) -> None:
        asyncio.get_running_loop().remove_signal_handler(signal.SIGCHLD)
        set_subreaper(False)

    def _reap(self) -> None:
        for pid, future in list(self._ends.items()):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                del self._ends[pid]
                future.set_result(os.waitstatus_to_exitcode(status))
                self._sessions.add(pid)
        for session in list(self._sessions):
            try:
                while os.waitpid(-session, os.WNOHANG)[0]:
                    pass
            except ChildProcessError:
                self._sessions.remove(session)


def kill_session(leader: int) -> None:
    """Kill all processes in a session that have not left its process group."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)


def set_subreaper(is_one: bool) -> None:
    ctypes.CDLL(None).prctl(36, int(is_one))  # PR_SET_CHILD_SUBREAPER

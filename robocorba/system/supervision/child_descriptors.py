"""The descriptors of a child process, which has no limit of connections of its own: omniNames."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import socket
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from robocorba.orb.connections import check_tcp


class ChildDescriptors:
    """Those of the child whose process id `pid` returns; 0 while there is none. Where the operating system does not let
    a process have its child's descriptors, there are none."""

    def __init__(self, name: str, pid: Callable[[], int]) -> None:
        self.title = f" to {name}"
        self._current, self._pid, self._handle = pid, 0, -1
        self._library = ctypes.CDLL(None, use_errno=True)

    def renew(self) -> None:
        """Follow a restart of the child."""
        if (pid := self._current()) != self._pid:
            self.close()
            with contextlib.suppress(OSError, AttributeError):  # it has ended, or this is not Linux
                self._handle = os.pidfd_open(pid) if pid else -1
            self._pid = pid

    def close(self) -> None:
        if self._handle >= 0:
            os.close(self._handle)
        self._handle, self._pid = -1, 0

    def limit(self) -> int:
        with contextlib.suppress(OSError):
            soft, _ = resource.prlimit(self._pid, resource.RLIMIT_NOFILE) if self._pid else (0, 0)
            return soft if soft > 0 else 2**31
        return 2**31

    def in_use(self) -> Sequence[int]:
        if self._handle >= 0:
            with contextlib.suppress(OSError):
                return [int(path.name) for path in Path(f"/proc/{self._pid}/fd").iterdir()]
        return ()

    @contextlib.contextmanager
    def borrowed(self, descriptor: int) -> Iterator[socket.socket]:
        """A copy, which is closed again."""
        # 438 is pidfd_getfd (Linux 5.6) on all processors.
        copy = self._library.syscall(438, self._handle, descriptor, 0)
        if copy < 0:
            raise OSError(ctypes.get_errno(), "pidfd_getfd")
        try:
            connection = socket.socket(fileno=copy)
        except OSError:  # not a socket
            os.close(copy)
            raise
        with connection:
            check_tcp(connection)
            yield connection

"""The connections that clients have to a process: how many there may be, which one ends when there are too many, and
how many may wait to be accepted.

Each connection takes a descriptor and a thread. A process without a free descriptor can accept no connection and open
no file, so the connection that has been idle for longest ends before that. Robots call twice a second at least, so
theirs stay; a client that calls again connects again."""

from __future__ import annotations

import contextlib
import logging
import os
import resource
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from robocorba.system.repeating import Repeating

#: Maximum number of connections: more of them, each with a thread, would need gigabytes.
MAX_CONNECTIONS = 4096
#: Interval between checks [s].
CHECK_INTERVAL_S = 1.0
#: Time after which a connection that has never got an answer ends first [s].
UNANSWERED_S = 5.0
#: Minimum interval between log entries [s].
LOG_INTERVAL_S = 10.0
#: Where the kernel lists the descriptors of this process. Other systems than Linux have no limit of ours.
_LISTING = Path("/proc/self/fd")
#: GIOP 1.0, CloseConnection: requests without an answer were not executed.
_CLOSE_CONNECTION = b"GIOP\1\0\1\5\0\0\0\0"

_log = logging.getLogger(__name__)


def raise_descriptor_limit(wanted: int = 16_384) -> int:
    """Raise the soft limit of descriptors as far as the hard limit allows, never lower it; return it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return wanted
    raised = max(soft, wanted if hard == resource.RLIM_INFINITY else min(wanted, hard))
    if raised > soft:
        with contextlib.suppress(ValueError, OSError):  # a container may forbid it
            resource.setrlimit(resource.RLIMIT_NOFILE, (raised, hard))
            soft = raised
    return soft


class ConnectionLimit:
    """Keeps this process below `connections` that clients have opened, and below `descriptors` in use; None: what the
    operating system allows, less an eighth, for files and for connections until the next check."""

    def __init__(self, descriptors: int | None = None, connections: int = MAX_CONNECTIONS) -> None:
        self._most = descriptors or round(raise_descriptor_limit() * 7 / 8)
        self._connections = connections
        self._repeating = Repeating("connections", self.check, lambda: self._interval_s)
        self._interval_s = CHECK_INTERVAL_S
        self._ended, self._logged_at = 0, -LOG_INTERVAL_S

    def start(self) -> ConnectionLimit:
        if _LISTING.is_dir():
            self._repeating.start()
        return self

    def close(self) -> None:
        self._repeating.close()

    def check(self) -> None:
        """End connections if there are too many."""
        used, self._interval_s = len(descriptors_in_use()), CHECK_INTERVAL_S
        if used > min(self._most, self._connections):
            found = sorted(_connections())
            excess = max(used - self._most, len(found) - self._connections)
            if excess > 0:  # a few more, so that not each new connection ends another one
                ending = found[: excess + len(found) // 20]
                self._ended += sum(_end(descriptor) for _, _, descriptor in ending)
                self._interval_s = 0.1  # others may wait to be accepted, and take their places
        if self._ended and time.monotonic() >= self._logged_at + LOG_INTERVAL_S:
            reason = "%d connections have ended, the longest idle ones: there were more than %d, or %d descriptors"
            _log.warning(reason, self._ended, self._connections, self._most)
            self._ended, self._logged_at = 0, time.monotonic()


def descriptors_in_use() -> Sequence[int]:
    """Those of this process; all that may be in use if there is no way to know."""
    try:
        with os.scandir(_LISTING) as entries:  # each second, and there may be hundreds: without a path for each
            return [int(entry.name) for entry in entries]
    except OSError:  # none is free, and the list itself takes one
        return range(resource.getrlimit(resource.RLIMIT_NOFILE)[0])


@contextlib.contextmanager
def borrowed(descriptor: int) -> Iterator[socket.socket]:
    """The socket of a descriptor, which stays open; needs no further descriptor. Raises OSError if it is not TCP."""
    connection = socket.socket(fileno=descriptor)
    try:
        if connection.family not in (socket.AF_INET, socket.AF_INET6) or connection.type != socket.SOCK_STREAM:
            raise OSError("not a TCP socket")
        yield connection
    finally:
        connection.detach()


def enlarge_queue() -> None:
    """Let 4096 connections wait to be accepted at each port on which this process listens, as far as the kernel allows:
    when a server restarts, all its clients connect at once. Beyond omniORB's 128 they would wait for 1 s,
    then for 3 s."""
    for descriptor in descriptors_in_use():
        with contextlib.suppress(OSError), borrowed(descriptor) as listener:
            if listener.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                listener.listen(4096)


def is_established(connection: socket.socket) -> bool:
    """Whether neither end has closed a connection."""
    state = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0]  # the first byte of struct tcp_info
    return state == 1  # TCP_ESTABLISHED


def _connections() -> Iterator[tuple[bool, float, int]]:
    """The descriptors of connections at ports on which this process listens, so that those that end first are the
    least: those that have never got an answer for UNANSWERED_S, then those without data for the longest time."""
    found: list[tuple[int, tuple[bool, float, int]]] = []
    ports: set[int] = set()
    for descriptor in descriptors_in_use():
        with contextlib.suppress(OSError), borrowed(descriptor) as connection:
            if connection.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                ports.add(connection.getsockname()[1])
            else:
                if not is_established(connection):  # such as one that was ended a moment ago
                    continue
                info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 232)
                # Of struct tcp_info: time since data arrived [ms], and number of segments with data that were sent.
                (idle_ms,), (sent,) = struct.unpack_from("52xI", info), struct.unpack_from("156xI", info)
                is_in_use = sent > 0 or idle_ms < UNANSWERED_S * 1000
                found.append((connection.getsockname()[1], (is_in_use, -idle_ms, descriptor)))
    yield from (each for port, each in found if port in ports)


def _end(descriptor: int) -> bool:
    """End a connection; the thread that serves it closes its descriptor."""
    with contextlib.suppress(OSError), borrowed(descriptor) as connection:
        with contextlib.suppress(OSError):
            connection.send(_CLOSE_CONNECTION, socket.MSG_DONTWAIT)
        connection.shutdown(socket.SHUT_RDWR)
        return True
    return False

"""Whether the caller of a servant still waits for the answer.

A client whose call has timed out closes the connection, in omniORB, and so does the end of its process. omniORB can't
interrupt the servant: operations that wait for something ask here, and end. A client that has several calls on one
connection, and gives one of them up, stays unnoticed; operations that wait need a time limit, too.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable

import omniORB

from robocorba.orb.connections import borrowed, descriptors_in_use, is_established

#: The descriptor by which a thread was called last: omniORB has a thread for each connection.
_last = threading.local()


def present_caller() -> Callable[[], bool]:
    """A function that says whether the client has gone that made the call which this thread executes. A caller in this
    process never goes, and on other systems than Linux none is noticed."""
    peer = (omniORB.currentCallInfo() or {}).get("peer_address", "")
    address = peer.split(":", 2)[-1]  # without giop:tcp: or giop:ssl:
    descriptor = _descriptor_of(address) if address else None
    return lambda: descriptor is not None and not _is_open(descriptor, address)


def _descriptor_of(address: str) -> int | None:
    """The descriptor of the connection from HOST:PORT."""
    for descriptor in (getattr(_last, "descriptor", 0), *descriptors_in_use()):
        if _is_open(descriptor, address):
            _last.descriptor = descriptor
            return int(descriptor)
    return None


def _is_open(descriptor: int, address: str) -> bool:
    """Whether this is the connection from HOST:PORT, and neither end has closed it."""
    try:
        with borrowed(descriptor) as connection:
            host, port = connection.getpeername()[:2]
            is_it = address == (f"[{host}]:{port}" if connection.family == socket.AF_INET6 else f"{host}:{port}")
            return is_it and is_established(connection)
    except OSError:
        return False

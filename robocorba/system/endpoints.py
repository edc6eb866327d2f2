"""Where servers can listen."""

from __future__ import annotations

import contextlib
import errno
import socket

import psutil

from robocorba.errors.services import ServiceError


def is_free(host: str, port: int) -> bool:
    """Whether a server can listen there. Raises ServiceError if `host` is another machine or the port is denied."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            # As omniORB does: connections in TIME_WAIT do not block the port.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except socket.gaierror:
        raise ServiceError(f"unknown host {host}") from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return False
        if error.errno == errno.EADDRNOTAVAIL:
            raise ServiceError(f"{host} is not an address of this machine") from None
        raise ServiceError(f"can't listen on {host}:{port}: {error.strerror}") from None
    return True


def user_of(port: int) -> str:
    """The process that listens on a TCP port of this machine, as far as this user may know it."""
    with contextlib.suppress(psutil.Error, OSError):
        for connection in psutil.net_connections("tcp"):
            if connection.status == psutil.CONN_LISTEN and connection.laddr[1:] == (port,) and connection.pid:
                return f"process {connection.pid} ({' '.join(psutil.Process(connection.pid).cmdline())[:100]})"
    return "a process of another user"

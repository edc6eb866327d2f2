"""Network namespaces as computers: hosts on a bridge, a gateway, and a TUN device to the other sub-network.

The namespaces are anonymous: the kernel removes them with their devices when the process that made them and all
processes in them have ended, even by SIGKILL.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import struct
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TypeVar

CLONE_NEWNET = 0x40000000
TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
#: Timeout of a command that sets up a device [s].
COMMAND_LIMIT_S = 10.0

_libc = ctypes.CDLL(None, use_errno=True)
T = TypeVar("T")


class Namespace:
    """A network namespace with its loopback up, open inside a `with`. Raises OSError without the privilege."""

    def __init__(self) -> None:
        self._fd = _in_thread(_unshared)
        self.path = f"/proc/{os.getpid()}/fd/{self._fd}"
        try:
            self.inside(lambda: _write("/proc/sys/net/ipv6/conf/all/disable_ipv6", "1"))
            self.inside(lambda: _write("/proc/sys/net/ipv6/conf/default/disable_ipv6", "1"))
            self.ip("link", "set", "lo", "up")
        except OSError:
            os.close(self._fd)
            raise

    def __enter__(self) -> Namespace:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        os.close(self._fd)

    def inside(self, call: Callable[[], T]) -> T:
        """The result of `call` in this namespace. Sockets and devices that it opens stay in the namespace."""

        def enter_and_call() -> T:
            _checked(_libc.setns(self._fd, CLONE_NEWNET))
            return call()

        return _in_thread(enter_and_call)

    def enter(self) -> None:
        """Move the calling thread into the namespace, with all threads and processes that it starts later."""
        _checked(_libc.setns(self._fd, CLONE_NEWNET))

    def command(self, *command: str) -> tuple[str, ...]:
        """A command line that runs `command` in this namespace."""
        return ("nsenter", f"--net={self.path}", "--", *command)

    def ip(self, *arguments: str) -> None:
        """Run iproute2's `ip` in the namespace. Raises OSError with its stderr."""
        try:
            done = subprocess.run(
                self.command("ip", *arguments), capture_output=True, text=True, timeout=COMMAND_LIMIT_S
            )
        except subprocess.TimeoutExpired as error:
            raise OSError(f"ip {' '.join(arguments)}: {error}") from None
        if done.returncode:
            raise OSError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")

    def forward_packets(self) -> None:
        """Make it a gateway."""
        self.inside(lambda: _write("/proc/sys/net/ipv4/ip_forward", "1"))

    def add_bridge(self, address: str) -> None:
        """Add a switch for the hosts of a sub-network, with the gateway's ADDRESS/BITS."""
        self.ip("link", "add", "switch", "type", "bridge")
        self.ip("address", "add", address, "dev", "switch")
        self.ip("link", "set", "switch", "up")

    def add_host(self, host: Namespace, number: int, address: str, gateway: str) -> None:
        """Connect a host's eth0, with its ADDRESS/BITS, to the switch."""
        port = f"port{number}"
        self.ip("link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", host.path)
        self.ip("link", "set", port, "master", "switch", "up")
        host.ip("address", "add", address, "dev", "eth0")
        host.ip("link", "set", "eth0", "up")
        host.ip("route", "add", "default", "via", gateway)

    def add_tun(self, network: str) -> int:
        """Add a TUN device that routes to `network`; returns its file descriptor, which the caller closes."""
        fd = self.inside(_new_tun)
        self.ip("link", "set", "line", "up")
        self.ip("route", "add", network, "dev", "line")
        return fd


def _unshared() -> int:
    _checked(_libc.unshare(CLONE_NEWNET))
    return os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC)


def _new_tun() -> int:
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.ioctl(fd, TUNSETIFF, struct.pack("16sH22x", b"line", IFF_TUN | IFF_NO_PI))
    except OSError:
        os.close(fd)
        raise
    return fd


def _write(path: str, text: str) -> None:
    Path(path).write_text(text)


def _checked(result: int) -> None:
    if result:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _in_thread(call: Callable[[], T]) -> T:
    """The result of `call` in a new thread, so that it changes the namespace of no other thread."""
    results: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(call())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    if errors:
        raise errors[0]
    return results[0]

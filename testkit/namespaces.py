"""Network namespaces as computers: hosts on a bridge, a gateway, and a TUN device to the other sub-network.

The namespaces are anonymous: the kernel removes them with their devices when the process that made them and all
processes in them have ended, even by SIGKILL.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import struct
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from testkit.json_process import Process, checkout_command

CLONE_NEWNET = 0x40000000
TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
#: Timeout of a command that sets up a device, and of the start of a router [s].
COMMAND_LIMIT_S, START_LIMIT_S = 10.0, 60.0

_libc = ctypes.CDLL(None, use_errno=True)
T = TypeVar("T")


class Namespace:
    """A network namespace with its loopback up, open inside a `with`. Raises OSError without the privilege."""

    def __init__(self) -> None:
        with contextlib.ExitStack() as stack:
            self._fd = _in_thread(_unshared)
            stack.callback(os.close, self._fd)
            self.path = f"/proc/{os.getpid()}/fd/{self._fd}"
            self.inside(lambda: _write("/proc/sys/net/ipv6/conf/all/disable_ipv6", "1"))
            self.inside(lambda: _write("/proc/sys/net/ipv6/conf/default/disable_ipv6", "1"))
            self.ip("link", "set", "lo", "up")
            self._stack = stack.pop_all()

    def __enter__(self) -> Namespace:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def inside(self, call: Callable[[], T]) -> T:
        """The result of `call` in this namespace. Sockets and devices that it opens stay in the namespace."""

        def enter_and_call() -> T:
            self.enter()
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
        ip(*arguments, within=self.command())

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

    def add_tun(self, network: str, address: str = "") -> int:
        """Add a TUN device with an address, which routes to `network`; its descriptor ends with the namespace."""
        fd = self.inside(_new_tun)
        self._stack.callback(os.close, fd)
        self.ip("link", "set", "line", "up")
        self.ip("route", "add", network, "dev", "line")
        if address:
            self.ip("address", "add", f"{address}/32", "dev", "line")
        return fd


def ip(*arguments: str, within: Sequence[str] = ()) -> None:
    """Run iproute2's `ip`. Raises OSError with its stderr."""
    try:
        subprocess.run((*within, "ip", *arguments), check=True, capture_output=True, text=True, timeout=COMMAND_LIMIT_S)
    except subprocess.TimeoutExpired as error:
        raise OSError(f"ip {' '.join(arguments)}: {error}") from None
    except subprocess.CalledProcessError as error:
        raise OSError(f"ip {' '.join(arguments)}: {error.stderr.strip()}") from None


def own_network() -> None:
    """Move this process and its children into a network namespace of their own. Raises OSError."""
    _checked(_libc.unshare(CLONE_NEWNET))
    ip("link", "set", "lo", "up")


def start_router(devices: Sequence[int], folder: Path, cores: Sequence[int] = ()) -> Process:
    """Start testkit.router between two TUN devices; it is ready for commands."""
    command = checkout_command("testkit.router", *map(str, devices))
    router = Process(command, folder / "router.log", cores, pass_fds=devices)
    router.receive(START_LIMIT_S)
    return router


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
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(call).result()

"""Network namespaces as computers, each with a TUN device whose packets a router process carries.

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
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from testkit.json_process import Process, checkout_command

CLONE_NEWNET = 0x40000000
TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
#: Timeout of a command that sets up a device, and of the start of a router [s].
COMMAND_LIMIT_S, START_LIMIT_S = 60.0, 60.0

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

    def add_tun(self, address: str) -> int:
        """Add a TUN device with an address and the default route; its descriptor ends with the namespace."""
        fd = self.inside(_new_tun)
        self._stack.callback(os.close, fd)
        self.ip("address", "add", f"{address}/32", "dev", "line")
        self.ip("link", "set", "line", "up")
        self.ip("route", "add", "default", "dev", "line")
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


def start_router(devices: Mapping[str, int], folder: Path, cores: Sequence[int] = ()) -> Process:
    """Start testkit.router for the TUN devices of hosts by address; it is ready for commands."""
    command = checkout_command("testkit.router", *(f"{address}={fd}" for address, fd in devices.items()))
    router = Process(command, folder / "router.log", cores, pass_fds=list(devices.values()))
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

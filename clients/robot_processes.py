"""Processes that a client starts and ends: servers, robots, stand-ins of actual robots, recorders."""

from __future__ import annotations

import contextlib
import random
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from robocorba.backoff import Backoff
from robocorba.corba.orb import Orb
from robocorba.corba.remote.smartpal_units import RemoteSmartPalUnits
from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.services import StartFailed
from robocorba.settings import Address
from robocorba.supervision.launch import LoggedProcess, module_command
from robocorba.supervision.system import naming_service_command

#: Timeout for a process to get ready [s]; it may have to compile kernels on a busy machine.
START_TIMEOUT_S = 600.0
#: Timeout for a process to create its output file [s].
FILE_TIMEOUT_S = 60.0
#: Pauses between checks.
POLLING = Backoff(0.05, 0.05)
#: Ports for naming services, below the ephemeral ports that the system gives to clients.
NAMING_PORTS = range(12000, 20000, 20)


class ReadyProcess(LoggedProcess):
    """A program that prints `ready`, or creates a file, when it is ready."""

    def wait_ready(self, limit_s: float = START_TIMEOUT_S) -> None:
        """Wait until it prints `ready`. Raises StartFailed."""
        deadline = time.monotonic() + limit_s
        line = ""
        while line != "ready\n":
            try:
                line = self.read_line(deadline - time.monotonic())
            except TimeoutError:
                raise StartFailed(f"{self.log.stem} was not ready within {limit_s:g} s: {self.last_message}") from None
            if not line:
                raise StartFailed(f"{self.log.stem} did not start: {self.last_message}")

    def wait_file(self, file: Path) -> None:
        """Wait until it has created `file`. Raises StartFailed."""
        POLLING.poll(lambda: file.exists() or not self.is_running, FILE_TIMEOUT_S)
        if not file.exists():
            raise StartFailed(f"{self.log.stem} did not create {file}: {self.last_message}")

    @property
    def last_message(self) -> str:
        """The last line of its log."""
        return (self.log_tail().strip().splitlines() or ["its log is empty"])[-1]


class ActualRobot:
    """The stand-in for an actual SmartPal inside a `with`: its units, and its own naming service at `naming`."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        naming, endpoint = (Address("127.0.0.1", port) for port in free_ports(2))
        self.naming = naming
        self._stack = contextlib.ExitStack()
        units = ("--state", str(folder), "--endpoint", str(endpoint), "--naming", str(naming))
        self._commands = {
            "omniNames": naming_service_command(naming, folder),
            "smartpal": module_command("robocorba.servers.smartpal", *units),
        }
        self._folder = folder

    def wait_ready(self, orb: Orb) -> None:
        """Wait until all units answer. Raises StartFailed."""

        def connect() -> None:
            if not self._units.is_running:
                raise StartFailed(f"the stand-in has ended: {self._units.last_message}")
            RemoteSmartPalUnits(orb, self.naming)

        try:
            POLLING.call(connect, START_TIMEOUT_S, AdaptorFailed)
        except AdaptorFailed as error:
            raise StartFailed(f"the stand-in did not answer within {START_TIMEOUT_S:g} s: {error}") from None

    def __enter__(self) -> ActualRobot:
        with contextlib.ExitStack() as stack:
            for name, command in self._commands.items():
                self._units = stack.enter_context(ReadyProcess(self._folder / f"{name}.log", *command))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *raised: object) -> None:
        self._stack.close()


@contextlib.contextmanager
def servers(state: Path, *options: str) -> Iterator[Address]:
    """Run `robocorba up` inside the `with`; yields the address of its naming service. Raises StartFailed."""
    naming = Address(
        "127.0.0.1", next(port for port in random.sample(NAMING_PORTS, len(NAMING_PORTS)) if _is_free(port))
    )
    state.mkdir(parents=True, exist_ok=True)
    command = (robocorba(), "up", "--state", str(state), "--naming-port", str(naming.port))
    with ReadyProcess(state / "servers.log", *command, "--start-limit", str(START_TIMEOUT_S), *options) as up:
        up.wait_ready()
        yield naming


def robocorba() -> str:
    """The `robocorba` command of this Python environment."""
    return shutil.which("robocorba", path=str(Path(sys.executable).parent)) or "robocorba"


def free_ports(count: int) -> list[int]:
    """Ports on which no process listens now."""
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True

"""Processes that a client starts and ends: servers, robots, stand-ins of actual robots, recorders."""

from __future__ import annotations

import contextlib
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.services import StartFailed
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_smartpal_units import RemoteSmartPalUnits
from robocorba.system.backoff import Backoff
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import LoggedProcess, module_command
from robocorba.system.supervision.system import naming_service_command

#: Timeout for a process to get ready [s]; it may have to compile kernels on a busy machine.
START_TIMEOUT_S = 600.0
#: Timeout for a process to create its output file [s].
FILE_TIMEOUT_S = 60.0
#: Pauses between checks.
POLLING = Backoff(0.05, 0.05)


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

    naming: Address

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        self._folder = folder
        self._stack = contextlib.ExitStack()

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
            port = stack.enter_context(claimed_ports())
            self.naming, endpoint = Address("127.0.0.1", port), Address("127.0.0.1", port + 1)
            units = ("--state", str(self._folder), "--endpoint", str(endpoint), "--naming", str(self.naming))
            commands = {
                "omniNames": naming_service_command(self.naming, self._folder),
                "smartpal": module_command("robocorba.servers.smartpal", *units),
            }
            for name, command in commands.items():
                self._units = stack.enter_context(ReadyProcess(self._folder / f"{name}.log", *command))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *raised: object) -> None:
        self._stack.close()


@contextlib.contextmanager
def servers(state: Path, *options: str) -> Iterator[Address]:
    """Run `robocorba up` inside the `with`; yields the address of its naming service. Raises StartFailed."""
    state.mkdir(parents=True, exist_ok=True)
    with claimed_ports() as port:
        command = (robocorba(), "up", "--state", str(state), "--naming-port", str(port))
        with ReadyProcess(state / "servers.log", *command, "--start-limit", str(START_TIMEOUT_S), *options) as up:
            up.wait_ready()
            yield Address("127.0.0.1", port)


def robocorba() -> str:
    """The `robocorba` command of this Python environment."""
    return shutil.which("robocorba", path=str(Path(sys.executable).parent)) or "robocorba"

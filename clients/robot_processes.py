"""Processes of a client that ends them again: servers, robots, the stand-ins of actual ones, a recorder."""

from __future__ import annotations

import contextlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from robocorba.corba.orb import Orb
from robocorba.corba.remote.smartpal_units import RemoteSmartPalUnits
from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.services import StartFailed
from robocorba.settings import Address
from robocorba.supervision.launch import bound_command, module_command
from robocorba.supervision.system import find_omninames

#: To get ready, also where kernels are not compiled yet and the machine is busy; to make a file; to end, s.
START_LIMIT_S, FILE_LIMIT_S, END_LIMIT_S, LOOK_S = 600.0, 60.0, 15.0, 0.05
#: Naming services listen there: below the ports that the system gives to clients, which come and go.
NAMING_PORTS = range(12000, 20000, 20)


class Running:
    """A program that runs inside a `with`; then SIGTERM ends it. What it complains of is in `log`.

    It ends with our process however that ends, and hears no Ctrl-C of its own. Start it in the main thread."""

    def __init__(self, log: Path, *command: str) -> None:
        self.log = log
        with log.open("a") as complaints:
            self._process = subprocess.Popen(
                bound_command(*command),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=complaints,
                text=True,
                start_new_session=True,
            )

    def wait_ready(self, limit_s: float = START_LIMIT_S) -> None:
        """Until it prints `ready`. Raises StartFailed."""
        too_late = threading.Timer(limit_s, self._process.kill)
        too_late.start()
        try:
            assert self._process.stdout is not None
            if "ready\n" not in self._process.stdout:
                raise StartFailed(f"{self.log.stem} did not start: {self.complaint}")
        finally:
            too_late.cancel()

    def wait_file(self, file: Path) -> None:
        """Until it has made a file. Raises StartFailed."""
        deadline = time.monotonic() + FILE_LIMIT_S
        while not file.exists():
            if not self.is_running or time.monotonic() > deadline:
                raise StartFailed(f"{self.log.stem} did not make {file}: {self.complaint}")
            time.sleep(LOOK_S)

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None

    @property
    def complaint(self) -> str:
        """The last line."""
        return (self.log.read_text().strip().splitlines() or ["it says no more"])[-1]

    def __enter__(self) -> Running:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.communicate(timeout=END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()


class ActualRobot:
    """The stand-in of an actual SmartPal inside a `with`: its units, and the naming service aboard at `naming`."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        naming, endpoint = (Address("127.0.0.1", port) for port in free_ports(2))
        self.naming = naming
        self._stack = contextlib.ExitStack()
        names = ("-start", str(naming.port), "-always", "-nohostname", "-datadir", str(folder))
        units = ("--state", str(folder), "--endpoint", str(endpoint), "--naming", str(naming))
        self._commands = {
            "omniNames": (find_omninames(), *names, "-ORBendPoint", f"giop:tcp:{naming}"),
            "smartpal": module_command("robocorba.servers.smartpal", *units),
        }
        self._folder = folder

    def wait_ready(self, orb: Orb) -> None:
        """Until all units are there. Raises StartFailed."""
        deadline = time.monotonic() + START_LIMIT_S
        while True:
            try:
                RemoteSmartPalUnits(orb, self.naming)
                return
            except AdaptorFailed as wrong:
                if not self._units.is_running or time.monotonic() > deadline:
                    raise StartFailed(f"the stand-in did not start: {wrong}; {self._units.complaint}") from None
            time.sleep(LOOK_S)

    def __enter__(self) -> ActualRobot:
        with contextlib.ExitStack() as stack:
            for name, command in self._commands.items():
                self._units = stack.enter_context(Running(self._folder / f"{name}.log", *command))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()


@contextlib.contextmanager
def servers(state: Path, *options: str) -> Iterator[Address]:
    """`robocorba up` as long as the `with` lasts; gives where its naming service is. Raises StartFailed."""
    naming = Address(
        "127.0.0.1", next(port for port in random.sample(NAMING_PORTS, len(NAMING_PORTS)) if _is_free(port))
    )
    state.mkdir(parents=True, exist_ok=True)
    command = (robocorba(), "up", "--state", str(state), "--naming-port", str(naming.port))
    with Running(state / "servers.log", *command, "--start-limit", str(START_LIMIT_S), *options) as up:
        up.wait_ready()
        yield naming


def robocorba() -> str:
    """The command that belongs to this Python."""
    return shutil.which("robocorba", path=str(Path(sys.executable).parent)) or "robocorba"


def free_ports(count: int) -> list[int]:
    """That nobody listens on now."""
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

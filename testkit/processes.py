"""Real processes for tests, ended together with their child processes."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE, Popen
from typing import Any, ClassVar

import msgspec
import psutil

from robocorba.system.backoff import Backoff
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.settings import Address
from robocorba.system.state_folder import StateFolder, SystemRecord
from robocorba.system.supervision.launch import ChildProcess
from testkit.nursery import Nursery

ROBOCORBA = str(Path(sys.executable).with_name("robocorba"))
#: Pauses between checks of a condition. What takes seconds is asked for less often: each look costs several processes.
POLLING = Backoff(0.02, 0.1, 1.2)


def eventually(condition: Callable[[], Any], timeout_s: float = 60.0, what: str = "") -> Any:
    """The first truthy answer of `condition`; fails the test after `timeout_s`."""
    answer = POLLING.poll(condition, timeout_s)
    assert answer, f"not within {timeout_s:g} s: {what or condition}"
    return answer


def hang(pid: int) -> None:
    """Send SIGSTOP to a process and wait until it has stopped; on a busy machine its threads run on for a while."""
    os.kill(pid, signal.SIGSTOP)
    eventually(lambda: psutil.Process(pid).status() == psutil.STATUS_STOPPED, what=f"the stop of process {pid}")


class Launcher:
    """Starts commands in `folder`; the end of its `with` kills those that still run, with their child processes.

    nursery: where there is one, it forks the commands of RoboCorba that it can."""

    nursery: ClassVar[Nursery | None] = None

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._started: list[Popen[str]] = []

    def __call__(self, *command: str, **environment: str) -> Popen[str]:
        """A process with pipes for stdin, stdout and stderr; `environment` is added to ours. The user's robocorba.toml
        and instances are not seen."""
        users = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_STATE_HOME"), str(self.folder))
        options: dict[str, Any] = {"cwd": self.folder, "env": {**os.environ, **users, **environment}}
        options.update(stdin=PIPE, stdout=PIPE, stderr=PIPE)
        process = self.nursery and self.nursery.start(command, **options)
        self._started.append(process or ChildProcess(*command, **options))
        return self._started[-1]

    def __enter__(self) -> Launcher:
        return self

    def __exit__(self, *raised: object) -> None:
        for process in self._started:
            family = [] if process.poll() is not None else psutil.Process(process.pid).children(recursive=True)
            process.kill()
            process.communicate()
            for child in family:
                if is_running(child):
                    child.kill()


@contextlib.contextmanager
def forked_processes() -> Iterator[None]:
    """Launchers fork the commands of RoboCorba that they can, which saves most of the time of their starts."""
    if Launcher.nursery:
        yield
        return
    with Nursery() as Launcher.nursery:
        try:
            yield
        finally:
            Launcher.nursery = None


class Running:
    """A running `robocorba up`: its process, its state folder and the address of its naming service."""

    def __init__(self, process: Popen[str], state: Path, naming: Address) -> None:
        self.process, self.state, self.naming = process, state, naming
        self.printed: list[str] = []
        self.descendants: list[psutil.Process] = []

    def wait_ready(self) -> Running:
        """Wait until it prints `ready`; fails the test with its stderr if it ends before."""
        assert self.process.stdout is not None and self.process.stderr is not None
        for line in self.process.stdout:
            if line == "ready\n":
                self.note_descendants()
                return self
            self.printed.append(line.rstrip("\n"))
        raise AssertionError(f"robocorba up ended: {self.process.stderr.read()}")

    def note_descendants(self) -> list[psutil.Process]:
        """Add all its present descendants to those noted before; returns all."""
        self.descendants += psutil.Process(self.process.pid).children(recursive=True)
        return self.descendants

    def record(self) -> SystemRecord:
        """The content of up.json."""
        found = StateFolder(self.state).read_record()
        assert found is not None
        return found

    def pid(self, name: str) -> int:
        """The process id of the process `name`, 0 while it waits for its next start."""
        return next(process.pid for process in self.record().processes if process.name == name)

    def kill(self, name: str) -> int:
        """Kill a process by its name, with kill -9; return its process id."""
        pid = int(eventually(lambda: self.pid(name), what=f"the process {name}"))
        os.kill(pid, signal.SIGKILL)
        return pid

    def is_again(self, name: str, before: int) -> bool:
        """Whether it runs as another process than `before`."""
        return self.pid(name) not in (0, before)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Send it a signal and wait until it ends; returns its exit code."""
        self.process.send_signal(number)
        return self.process.wait(60)

    def left_behind(self) -> list[psutil.Process]:
        """The noted descendants that still run. Those that end with it by a signal may take a moment."""
        POLLING.poll(lambda: not any(map(is_running, self.descendants)), 5.0)
        return [process for process in self.descendants if is_running(process)]


def real_system(launch: Callable[..., Popen[str]], state: Path, naming_port: int, *more: str) -> Running:
    """Start `robocorba up` with the real servers; does not wait. Servers without a compiled planner take a minute, and
    one that the machine holds up for a while has not hung."""
    command = (ROBOCORBA, "up", "--state", str(state), "--naming-port", str(naming_port))
    limits = ("--start-limit", "300", "--hang-limit", "60")
    return Running(launch(*command, *limits, *more), state, Address("127.0.0.1", naming_port))


@contextlib.contextmanager
def running_system(folder: Path, *more: str) -> Iterator[tuple[Running, Launcher]]:
    """A ready `robocorba up` with its state in folder/state, and a launcher for other processes; all end with the
    `with`. One at a time in a process."""
    with claimed_ports() as port, Launcher(folder) as launch:
        running = real_system(launch, folder / "state", port, *more).wait_ready()
        drain(running.process)
        yield running, launch


def drain(process: Popen[str]) -> None:
    """Discard the stderr of a process from now on: a full pipe would block it."""
    threading.Thread(target=deque, args=(process.stderr, 0), daemon=True).start()


def refusal(process: Popen[str], timeout_s: float = 60.0) -> str:
    """The error line of a process that must fail with exit code 1, an empty stdout and no traceback."""
    out, err = process.communicate(timeout=timeout_s)
    assert process.returncode == 1
    assert out == ""
    assert "Traceback" not in err
    return err.strip().splitlines()[-1]


def is_running(process: psutil.Process) -> bool:
    """Whether it runs; a zombie has ended."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def command_line(process: psutil.Process) -> str:
    """Its words, with a space between them; empty if it has ended."""
    try:
        return " ".join(process.cmdline())
    except psutil.NoSuchProcess:  # or a zombie
        return ""


def read_json(text: str) -> Any:
    """Decode JSON."""
    return msgspec.json.decode(text)

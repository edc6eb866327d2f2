"""Real processes for tests: started, watched, and ended with whatever they started."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec
import psutil

from robocorba.settings import Address
from robocorba.supervision.folder import StateFolder, SystemRecord

ROBOCORBA = str(Path(sys.executable).with_name("robocorba"))
#: Ports of a test: the naming service's, then those of its servers; the last one is held while the test has the block.
BLOCK = 16


def eventually(condition: Callable[[], Any], timeout_s: float = 10.0, what: str = "") -> Any:
    """The first truthy answer of `condition`; fails the test after `timeout_s`."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if answer := condition():
            return answer
        time.sleep(0.02)
    raise AssertionError(f"not within {timeout_s:g} s: {what or condition}")


def hang(pid: int) -> None:
    """Stop a process by SIGSTOP, and wait until it has: on a busy machine its threads may go on for a while."""
    os.kill(pid, signal.SIGSTOP)
    eventually(lambda: psutil.Process(pid).status() == psutil.STATUS_STOPPED, what=f"the stop of process {pid}")


@contextlib.contextmanager
def claimed_ports() -> Iterator[int]:
    """A port for a naming service such that it and the 14 after it are the caller's alone inside the `with`."""
    for base in range(20000 + BLOCK * (os.getpid() % 700), 32000, BLOCK):
        claim = socket.socket()
        try:
            claim.bind(("127.0.0.1", base + BLOCK - 1))
            for port in range(base, base + BLOCK - 1):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            claim.close()
            continue
        with claim:
            yield base
        return
    raise AssertionError("no free ports")


class Launcher:
    """Starts commands in `folder`; at the end of its `with` what still runs of them is killed, children included."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._started: list[subprocess.Popen[str]] = []

    def __call__(self, *command: str, **environment: str) -> subprocess.Popen[str]:
        """A process with pipes for stdin, stdout and stderr; `environment` is added to ours."""
        process = subprocess.Popen(
            command,
            cwd=self.folder,
            env={**os.environ, **environment},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._started.append(process)
        return process

    def __enter__(self) -> Launcher:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for process in self._started:
            family = [] if process.poll() is not None else psutil.Process(process.pid).children(recursive=True)
            process.kill()
            process.communicate()
            for child in family:
                if is_running(child):
                    child.kill()


class Running:
    """A `robocorba up` of a test: `process`, its state folder and the address of its naming service."""

    def __init__(self, process: subprocess.Popen[str], state: Path, naming: Address) -> None:
        self.process, self.state, self.naming = process, state, naming
        self.printed: list[str] = []
        self.descendants: list[psutil.Process] = []

    def wait_ready(self) -> Running:
        """Until it printed `ready`; fails the test with what it printed on stderr where it ends before."""
        assert self.process.stdout is not None and self.process.stderr is not None
        for line in self.process.stdout:
            if line == "ready\n":
                self.note_descendants()
                return self
            self.printed.append(line.rstrip("\n"))
        raise AssertionError(f"robocorba up ended: {self.process.stderr.read()}")

    def note_descendants(self) -> list[psutil.Process]:
        """All processes below it now, added to those known before."""
        self.descendants += psutil.Process(self.process.pid).children(recursive=True)
        return self.descendants

    def record(self) -> SystemRecord:
        """What up.json says."""
        found = StateFolder(self.state).read_record()
        assert found is not None
        return found

    def pid(self, name: str) -> int:
        """The process id of a process by its name, 0 while it waits for its next start."""
        return next(process.pid for process in self.record().processes if process.name == name)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Signal it and wait for its end; its exit code."""
        self.process.send_signal(number)
        return self.process.wait(15)

    def left_behind(self) -> list[psutil.Process]:
        """Which of the processes noted still run."""
        return [process for process in self.descendants if is_running(process)]


def real_system(launch: Callable[..., subprocess.Popen[str]], state: Path, naming_port: int, *more: str) -> Running:
    """`robocorba up` with the real servers, not waited for. Servers that find no compiled planner take a minute."""
    command = (ROBOCORBA, "up", "--state", str(state), "--naming-port", str(naming_port), "--start-limit", "300")
    return Running(launch(*command, *more), state, Address("127.0.0.1", naming_port))


def refusal(process: subprocess.Popen[str], timeout_s: float = 20.0) -> str:
    """The one line with which a process refused; nothing on stdout, exit code 1."""
    out, err = process.communicate(timeout=timeout_s)
    assert process.returncode == 1
    assert out == ""
    assert "Traceback" not in err
    return err.strip().splitlines()[-1]


def is_running(process: psutil.Process) -> bool:
    """Whether it has not ended; one that nobody waited for yet has."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def read_json(text: str) -> Any:
    """The value of a JSON text."""
    return msgspec.json.decode(text)

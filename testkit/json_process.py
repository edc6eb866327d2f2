"""Processes that exchange lines of JSON with a bench, objects in other processes, and calls of servers."""

from __future__ import annotations

import contextlib
import gc
import json
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

import psutil
from omniORB import CORBA

from robocorba.orb.calls import describe, error_of
from robocorba.system.supervision.launch import LoggedProcess, module_command

ROOT = Path(__file__).resolve().parents[1]


class ProcessFailed(Exception):
    """A process did not answer in time, or ended."""


class Process(LoggedProcess):
    """A command in the repository, on some cores or on all. environment: added to that of this process."""

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        cores: Sequence[int] = (),
        environment: Mapping[str, str] | None = None,
        pass_fds: Sequence[int] = (),
    ) -> None:
        self._name = " ".join(command[-4:])
        both = {**os.environ, **(environment or {})}
        options = {"cwd": ROOT, "env": both, "cores": cores, "pass_fds": pass_fds, "stdin": subprocess.PIPE}
        super().__init__(log, *command, **options)

    def send(self, value: Any) -> None:
        """Send a value. Raises ProcessFailed where the process has ended."""
        assert self.stdin is not None
        try:
            self.stdin.write(json.dumps(value) + "\n")
            self.stdin.flush()
        except OSError:
            raise ProcessFailed(f"{self._name} ended: {self.log_tail()}") from None

    def receive(self, limit_s: float) -> Any:
        """Receive the next value. Raises ProcessFailed."""
        try:
            line = self.read_line(limit_s)
        except TimeoutError:
            raise ProcessFailed(f"{self._name} did not answer within {limit_s:g} s: {self.log_tail()}") from None
        if not line:
            raise ProcessFailed(f"{self._name} ended: {self.log_tail()}")
        return json.loads(line)

    def ask(self, value: Any, limit_s: float = 5.0) -> Any:
        """Send a value and receive the answer. Raises ProcessFailed."""
        self.send(value)
        return self.receive(limit_s)


def checkout_command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command line of a module of the repository, such as one of testkit, in any directory."""
    return ("env", f"PYTHONPATH={ROOT}", *module_command(module, *arguments))


def busy_process(folder: Path, cores: Sequence[int] = ()) -> Process:
    """A process that keeps a core busy."""
    return Process((sys.executable, "-c", "while True: pass"), folder / "busy.log", cores)


def answer_lines(answer: Callable[[Any], Any], ready: Any = None) -> None:
    """Print `ready`, then the answer to each line of JSON on stdin, until stdin ends."""
    print(json.dumps(ready), flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)


def answer_commands(*commands: Callable[..., Any], ready: Any = None) -> None:
    """Print `ready`, then answer lines of JSON on stdin by calls: {"do": NAME, **ARGUMENTS}, where NAME is that of a
    command."""
    by_name = {command.__name__: command for command in commands}
    answer_lines(lambda asked: by_name[asked.pop("do")](**asked), ready)


class Cpu:
    """CPU time of processes since the creation of this object or the last query; ended processes count as idle."""

    def __init__(self, pids: Sequence[int]) -> None:
        self.processes = [psutil.Process(pid) for pid in pids]
        self._before = self._now()

    def spent_s(self) -> list[float]:
        """CPU time of each process [s]."""
        before, self._before = self._before, self._now()
        return [max(0.0, now - then) for now, then in zip(self._before, before, strict=True)]

    def _now(self) -> list[float]:
        return [_cpu_s(process) for process in self.processes]


def _cpu_s(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.NoSuchProcess:
        return 0.0
    return float(times.user + times.system)


# ---- an object in a process of its own ----


class ObjectProcess:
    """The object of the context manager `make(*arguments)`, in a process that ends with the `with`."""

    def __init__(self, make: Callable[..., AbstractContextManager[Any]], *arguments: Any) -> None:
        processes = multiprocessing.get_context("spawn")
        self._ours, theirs = processes.Pipe()
        # Not a daemon: it may have child processes. It ends with the pipe.
        self._process = processes.Process(target=_answer, args=(theirs, make, arguments))
        self._process.start()
        theirs.close()

    def __enter__(self) -> ObjectProcess:
        self.receive()
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        self._process.join()

    def call(self, method: str, *arguments: Any) -> Any:
        """The result of a method; it must not raise."""
        self.send(method, *arguments)
        return self.receive()

    def send(self, method: str, *arguments: Any) -> None:
        """Begin a call; `receive` gets the results in the order of the calls. Raises OSError where it has ended."""
        self._ours.send((method, arguments))

    def receive(self) -> Any:
        """Raises EOFError where it has ended."""
        return self._ours.recv()


def _answer(connection: Connection, make: Callable[..., AbstractContextManager[Any]], arguments: Any) -> None:
    with make(*arguments) as target, contextlib.suppress(EOFError):
        gc.collect()
        gc.freeze()  # as servers do
        connection.send(None)
        while True:
            method, more = connection.recv()
            connection.send(getattr(target, method)(*more))


# ---- CORBA calls whose exceptions can be pickled and read ----


T = TypeVar("T")


class LoggedOff(RuntimeError):
    """The object of a call, such as a robot's session, has ended."""


def checked_call(call: Callable[..., T], *arguments: object) -> T:
    """Make a call, and convert CORBA exceptions to RuntimeError with a description."""
    try:
        return call(*arguments)
    except CORBA.UserException as error:
        raise RuntimeError(error_of(error)) from None
    except CORBA.OBJECT_NOT_EXIST as error:
        raise LoggedOff(describe(error)) from None
    except CORBA.SystemException as error:
        raise RuntimeError(describe(error)) from None

"""How long a server is away, as a client sees it that keeps a reference and calls 200 times a second."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import psutil

from bench.starts.caller import NAMING_SERVICE
from bench.starts.systems import SERVERS, System
from robocorba.system.supervision.system import NAMING_SERVICE as OMNINAMES
from testkit.json_process import Process, checkout_command
from testkit.processes import eventually

#: Greatest time that a server may be away [s]; it may have to compile.
LIMIT_S = 300.0
#: Time with answers before and after it was away [s].
AROUND_S = 0.3
OBJECTS = {OMNINAMES: NAMING_SERVICE, **SERVERS}


class Client:
    """A process that calls one server of one system at a time."""

    def __init__(self, process: Process, system: System) -> None:
        self._process, self._system = process, system

    @contextlib.contextmanager
    def calling(self, server: str) -> Iterator[None]:
        """Calls inside the `with`; it answers already."""
        endpoint = self._system.endpoint(server)
        self._process.ask({"do": "begin", "endpoint": endpoint, "name": OBJECTS[server]})
        try:
            self._until_answered(time.monotonic() + AROUND_S)
            yield
        finally:
            self._process.ask({"do": "end"})

    def away_s(self, began: float, over: float) -> float:
        """The longest time without an answer since `began` [s], once it answers again after `over`."""
        self._until_answered(over)
        answers = self._answered(began - AROUND_S)
        return max(later - earlier for earlier, later in pairwise(answers))

    def _until_answered(self, since: float) -> None:
        """Wait for an answer, and then for more of them."""
        eventually(lambda: self._answered(since), LIMIT_S, "an answer")
        time.sleep(AROUND_S)

    def _answered(self, since: float) -> list[float]:
        found: list[float] = self._process.ask({"do": "answered", "since": since})
        return found


@contextlib.contextmanager
def client(system: System, folder: Path) -> Iterator[Client]:
    with Process(checkout_command("bench.starts.caller"), folder / f"caller-{system.version.name}.log") as process:
        process.receive(LIMIT_S)
        yield Client(process, system)


def killed(system: System, calls: Client, server: str) -> float:
    """How long a server is away that is killed [s]."""
    with calls.calling(server):
        process = psutil.Process(system.running.pid(server))
        began = time.monotonic()
        process.send_signal(signal.SIGKILL)
        process.wait()
        away_s = calls.away_s(began, time.monotonic())
    eventually(lambda: system.is_running(server), LIMIT_S, f"{server} that runs")
    return away_s

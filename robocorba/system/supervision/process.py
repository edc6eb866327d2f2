"""One supervised process: started, probed until it answers, restarted when it ends."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import ServiceError, StartFailed
from robocorba.system.backoff import Backoff
from robocorba.system.supervision.children import kill_session
from robocorba.system.supervision.hangs import HangLimit, watch_for_hang
from robocorba.system.supervision.launch import ModuleRun
from robocorba.system.supervision.output import Pipe
from robocorba.system.supervision.starter import Child, Starter, cause

#: Time from SIGTERM to SIGKILL [s].
GRACE_PERIOD_S = 5.0
#: Interval between probes while a process starts [s].
PROBE_INTERVAL_S = 0.05

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ProcessSpec:
    """The command of a process, or the module that it runs, and how to check that it serves.

    probe: makes a real call, in a thread; raises a RoboCorbaError while there is no answer.
    output: called with each line that the process prints. start_limit_s: timeout for the answer to the first call.
    is_alive: a call to the process alone, in a thread; raises a RoboCorbaError when it does not answer. None: nobody
    asks.
    endpoint: HOST:PORT where it listens, empty if it chooses a port. names: that it binds in the naming service.
    grace_period_s: time from SIGTERM to SIGKILL. before_start: called before each start; raises ServiceError if the
    process can't be started now."""

    name: str
    command: tuple[str, ...] | ModuleRun
    cwd: Path
    probe: Callable[[], None]
    output: Callable[[str], None]
    start_limit_s: float = 60.0
    is_alive: Callable[[], None] | None = None
    endpoint: str = ""
    names: tuple[str, ...] = ()
    grace_period_s: float = GRACE_PERIOD_S
    before_start: Callable[[], None] = lambda: None


@dataclass
class Supervised:
    """A process under supervision. changed: called whenever one of the following fields has changed.

    state: starting, running, stopping, ended, or waiting for its start. pid: 0 while waiting and after its end.
    started: POSIX time of its last start [s]. restarts: starts after the first one.
    problem: why it is not running; empty while it runs. turns: held from each start until the process answers, such as
    a semaphore that many processes share."""

    spec: ProcessSpec
    starter: Starter
    hang_limit: HangLimit = field(default_factory=HangLimit)
    changed: Callable[[], None] = lambda: None
    turns: AbstractAsyncContextManager[object] = field(default_factory=contextlib.nullcontext)
    state: str = "waiting"
    pid: int = 0
    started: float = 0.0
    restarts: int = 0
    problem: str = ""
    ready: asyncio.Event = field(default_factory=asyncio.Event)
    #: Its last start on the monotonic clock [s].
    _started_at: float = 0.0
    _lines: deque[str] = field(default_factory=lambda: deque(maxlen=50))

    async def supervise(self) -> None:
        """Run until cancelled, then end the process. Raises StartFailed if it does not answer after its first start."""
        for delay_s in self._restart_delays():
            self.set_state("waiting", pid=0)
            await asyncio.sleep(delay_s)
            try:
                await self.run()
            except StartFailed as failure:
                if not self.ready.is_set():
                    raise
                self.problem = str(failure)
                _log.error("%s", failure)
            self.restarts += 1

    async def run(self) -> None:
        """Run it once, until it ends or until cancelled. Raises StartFailed if it does not answer."""
        async with contextlib.AsyncExitStack() as turn:
            self.set_state("waiting", pid=0)
            await turn.enter_async_context(self.turns)
            await self._run_in(turn)

    async def _run_in(self, turn: contextlib.AsyncExitStack) -> None:
        process, reader = await self._start()
        try:
            await self._until_ready(process)
            await turn.aclose()
            self.problem = ""
            self.set_state("running")
            self.ready.set()
            self.problem = await self._until_ended(process)
            _log.error("%s %s", self.spec.name, self.problem)
        finally:
            await self._end(process)
            await self._drain(reader)

    def last_error(self) -> str:
        """The last printed line that names an error, else the last line, else empty."""
        errors = [line for line in self._lines if line.startswith(("ERROR", "CRITICAL")) or "Error" in line]
        return (errors or list(self._lines) or [""])[-1]

    def _restart_delays(self) -> Iterator[float]:
        """Delay before each start [s]: 0 for the first two and after a steady run of 2 s, else growing."""
        short_runs, backoff = 0, Backoff(0.1, 5.0)
        yield 0.0
        while True:
            if time.monotonic() - self._started_at >= 2.0:
                short_runs = 0
            yield backoff.pause_s(short_runs)
            short_runs += 1

    async def _start(self) -> tuple[Child, asyncio.Task[None]]:
        try:
            self.spec.before_start()
        except ServiceError as error:
            raise StartFailed(f"{self.spec.name} can't start: {error}") from None
        pipe = await Pipe.open()
        with pipe.write_end() as output:
            process = await self.starter.start(self.spec.command, self.spec.cwd, output)
        self.started, self._started_at = time.time(), time.monotonic()
        self.set_state("starting", pid=process.pid)
        _log.info("%s started with process id %d", self.spec.name, process.pid)
        return process, asyncio.create_task(pipe.read(self._handle_line))

    async def _until_ready(self, process: Child) -> None:
        limit_s = self.spec.start_limit_s
        deadline = time.monotonic() + limit_s
        while True:
            probe = asyncio.create_task(asyncio.to_thread(self.spec.probe))
            probe.add_done_callback(lambda done: done.cancelled() or done.exception())  # even if nobody waits
            either: set[asyncio.Future[Any]] = {process.ended, probe}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if process.ended.done():
                await _ignore(probe)
                await asyncio.sleep(PROBE_INTERVAL_S)  # its last lines may still be in the pipe
                raise StartFailed(self._failure(f"ended {cause(process.ended.result())} before it answered a call"))
            try:
                return probe.result()
            except RoboCorbaError as error:
                if time.monotonic() > deadline:
                    raise StartFailed(self._failure(f"did not answer within {limit_s:g} s: {error}")) from None
            await asyncio.wait({process.ended}, timeout=PROBE_INTERVAL_S)

    async def _until_ended(self, process: Child) -> str:
        """How it ended, by itself or because it hung."""
        watch = asyncio.create_task(watch_for_hang(process, self.spec.is_alive, self.hang_limit))
        try:
            code = await process.wait()
            return (
                watch.result() if watch.done() and not watch.cancelled() and watch.result() else f"ended {cause(code)}"
            )
        finally:
            watch.cancel()

    def _failure(self, description: str) -> str:
        last = self.last_error()
        return f"{self.spec.name} {description}" + (f"; its last error: {last}" if last else "")

    async def _end(self, process: Child) -> None:
        """End the process and all processes in its session."""
        if not process.ended.done():
            self.set_state("stopping")
            process.send_signal(signal.SIGTERM)
            await asyncio.wait({process.ended}, timeout=self.spec.grace_period_s)
            if not process.ended.done():
                _log.warning("%s did not end within %g s; killed", self.spec.name, self.spec.grace_period_s)
        process.send_signal(signal.SIGKILL)
        kill_session(process.pid)
        await process.wait()

    async def _drain(self, reader: asyncio.Task[None]) -> None:
        await asyncio.wait({reader}, timeout=1.0)
        reader.cancel()

    def _handle_line(self, line: str) -> None:
        self._lines.append(line)
        self.spec.output(line)

    def set_state(self, state: str, pid: int | None = None) -> None:
        self.state = state
        self.pid = self.pid if pid is None else pid
        self.changed()


async def _ignore(probe: Awaitable[None]) -> None:
    with contextlib.suppress(RoboCorbaError):
        await probe

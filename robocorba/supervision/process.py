"""One process from its first start to its end: started, asked until it answers, started again when it ends."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import StartFailed
from robocorba.supervision.launch import bound_command

#: A process that ran this long starts again at once; one that keeps ending waits longer each time.
STEADY_S = 2.0
FIRST_BACKOFF_S, LONGEST_BACKOFF_S = 0.1, 5.0
#: From SIGTERM to SIGKILL.
GRACE_S = 5.0
PROBE_PAUSE_S = 0.05
LONGEST_LINE = 16 * 1024

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ProcessSpec:
    """What to run and how to tell that it serves.

    probe: makes a real call, on a thread; raises a RoboCorbaError while there is no answer.
    output: gets each line that the process prints."""

    name: str
    command: tuple[str, ...]
    cwd: Path
    probe: Callable[[], None]
    output: Callable[[str], None]
    start_limit_s: float = 60.0


@dataclass
class Supervised:
    """A process under supervision; `changed` is called whenever a field below it has changed.

    state: starting, running or waiting (for its next start). pid: of the process that runs, 0 while waiting.
    started: POSIX time of its last start. restarts: starts after the first one."""

    spec: ProcessSpec
    changed: Callable[[], None] = lambda: None
    state: str = "starting"
    pid: int = 0
    started: float = 0.0
    restarts: int = 0
    ready: asyncio.Event = field(default_factory=asyncio.Event)
    _lines: deque[str] = field(default_factory=lambda: deque(maxlen=50))

    async def supervise(self) -> None:
        """Until cancelled, which ends the process. Raises StartFailed if it never answers in the first place."""
        for pause_s in self._pauses():
            self._now("waiting", pid=0)
            await asyncio.sleep(pause_s)
            process, reader = await self._spawn()
            try:
                await self._until_ready(process)
                self._now("running")
                self.ready.set()
                code = await process.wait()
                _log.error("%s ended %s", self.spec.name, _how(code))
            except StartFailed as failure:
                if not self.ready.is_set():
                    raise
                _log.error("%s", failure)
            finally:
                await self._end(process)
                await self._drain(reader)
            self.restarts += 1

    def last_error(self) -> str:
        """The last line printed that names an error, else the last line; empty if nothing was printed."""
        errors = [line for line in self._lines if line.startswith(("ERROR", "CRITICAL")) or "Error" in line]
        return (errors or list(self._lines) or [""])[-1]

    def _pauses(self) -> Iterator[float]:
        """Seconds to wait before each start: none before the first two, then growing until a run was steady."""
        backoff_s = 0.0
        yield 0.0
        while True:
            if time.time() - self.started >= STEADY_S:
                backoff_s = 0.0
            yield backoff_s
            backoff_s = min(2 * backoff_s or FIRST_BACKOFF_S, LONGEST_BACKOFF_S)

    async def _spawn(self) -> tuple[asyncio.subprocess.Process, asyncio.Task[None]]:
        # A pipe of our own: with asyncio's, some versions of Python take a process for alive while others hold its end.
        read_end, write_end = os.pipe()
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(read_end, "rb", 0)
        )
        try:
            process = await asyncio.create_subprocess_exec(
                # -I -S: a bare interpreter starts in 20 ms and can't be led astray by the environment.
                *bound_command(*self.spec.command),
                cwd=self.spec.cwd,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=write_end,
                stderr=write_end,
                start_new_session=True,  # Ctrl-C in the terminal is for the supervisor alone
            )
        finally:
            os.close(write_end)
        self.started = time.time()
        self._now("starting", pid=process.pid)
        _log.info("%s started with process id %d", self.spec.name, process.pid)
        return process, asyncio.create_task(self._read(reader))

    async def _until_ready(self, process: asyncio.subprocess.Process) -> None:
        limit_s = self.spec.start_limit_s
        deadline = time.monotonic() + limit_s
        ended = asyncio.create_task(process.wait())
        try:
            while True:
                probe = asyncio.create_task(asyncio.to_thread(self.spec.probe))
                await asyncio.wait({ended, probe}, return_when=asyncio.FIRST_COMPLETED)
                if ended.done():
                    await _ignore(probe)
                    # Its last words may still be on their way through the pipe.
                    await asyncio.sleep(PROBE_PAUSE_S)
                    raise StartFailed(self._failure(f"ended {_how(ended.result())} before it answered a call"))
                try:
                    return probe.result()
                except RoboCorbaError as wrong:
                    if time.monotonic() > deadline:
                        raise StartFailed(self._failure(f"did not answer within {limit_s:g} s: {wrong}")) from None
                await asyncio.wait({ended}, timeout=PROBE_PAUSE_S)
        finally:
            ended.cancel()

    def _failure(self, what: str) -> str:
        last = self.last_error()
        return f"{self.spec.name} {what}" + (f"; its last error: {last}" if last else "")

    async def _end(self, process: asyncio.subprocess.Process) -> None:
        """End the process, and with it whatever it started in its session."""
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            try:
                await asyncio.wait_for(process.wait(), GRACE_S)
            except asyncio.TimeoutError:
                _log.warning("%s did not end within %g s; killed", self.spec.name, GRACE_S)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        await process.wait()

    async def _drain(self, reader: asyncio.Task[None]) -> None:
        await asyncio.wait({reader}, timeout=1.0)
        reader.cancel()

    async def _read(self, stream: asyncio.StreamReader) -> None:
        rest = b""
        while chunk := await stream.read(65536):
            *lines, rest = (rest + chunk).split(b"\n")
            if len(rest) > LONGEST_LINE:
                lines, rest = [*lines, rest], b""
            for line in lines:
                self._printed(line)
        self._printed(rest)

    def _printed(self, line: bytes) -> None:
        text = line.decode(errors="backslashreplace").strip()
        if text:
            self._lines.append(text)
            self.spec.output(text)

    def _now(self, state: str, pid: int | None = None) -> None:
        self.state = state
        self.pid = self.pid if pid is None else pid
        self.changed()


def _how(code: int) -> str:
    if code >= 0:
        return f"with exit code {code}"
    try:
        return f"by {signal.Signals(-code).name}"
    except ValueError:
        return f"by signal {-code}"


async def _ignore(work: Awaitable[None]) -> None:
    with contextlib.suppress(RoboCorbaError):
        await work

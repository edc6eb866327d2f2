"""Starts the processes of a system: modules as forks of a warm parent, other commands alone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import shlex
import signal
import socket
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import psutil

from robocorba.errors.services import StartFailed
from robocorba.system.backoff import Backoff
from robocorba.system.supervision.children import Children
from robocorba.system.supervision.launch import ModuleRun, bound_command, module_command
from robocorba.system.supervision.output import Pipe, relay
from robocorba.system.supervision.warm_parent import ENVIRONMENT, MAX_REQUEST

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Child:
    """A child process. ended: done with its exit code, or the negative number of the signal that ended it."""

    pid: int
    ended: asyncio.Future[int]

    async def wait(self) -> int:
        """Its exit code, or the negative number of the signal, when it has ended."""
        return await asyncio.shield(self.ended)

    def send_signal(self, number: int) -> None:
        """Send a signal, to nobody if it has ended."""
        if not self.ended.done():
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)


class Starter:
    """Starts processes that lead sessions of their own, and that are killed when this process ends. To be used in the
    thread of the event loop, which must be the main one: the kernel kills them when the thread that started them ends.

    warm: process id of a child of this process that is a warm parent already, and a socket to it."""

    warm: ClassVar[tuple[int, socket.socket] | None] = None

    def __init__(self) -> None:
        self._children = Children()
        self._warm = _WarmParent(self, self.warm)

    def prepare(self, command: Sequence[str] | ModuleRun) -> None:
        """Let the warm parent load the module of a command in the background, before it is started."""
        if isinstance(command, ModuleRun):
            self._warm.prepare(command)

    async def start(self, command: Sequence[str] | ModuleRun, cwd: Path, output: int) -> Child:
        """Start a command in a folder, with its stdout and stderr to a descriptor. Raises StartFailed."""
        if not isinstance(command, ModuleRun):
            return self.spawn(command, cwd=cwd, stdout=output, stderr=output)
        started = asyncio.create_task(self._fork(command, cwd, os.dup(output)))
        try:
            return await asyncio.shield(started)
        except asyncio.CancelledError:  # what has been asked for can't be taken back
            started.add_done_callback(_kill)
            raise

    def spawn(self, command: Sequence[str], **options: Any) -> Child:
        """Start a command alone. options: as of subprocess.Popen."""
        process = subprocess.Popen(
            bound_command(*command),
            **{"stdin": subprocess.DEVNULL, **options},
            start_new_session=True,  # Ctrl-C in the terminal reaches only the supervisor
        )
        process.returncode = 0  # `Children` waits for it
        return self.child(process.pid)

    async def close(self) -> None:
        """End the warm parent. All other processes must have ended."""
        await self._warm.close()
        self._children.close()

    def knows(self, pid: int) -> bool:
        """Whether a running process is one that was started here."""
        return self._children.knows(pid)

    async def _fork(self, module: ModuleRun, cwd: Path, output: int) -> Child:
        try:
            return self.child(await self._warm.fork(module, cwd, output))
        finally:
            os.close(output)

    def child(self, pid: int) -> Child:
        """A child of this process, whose end is noticed from now on."""
        return Child(pid, self._children.end_of(pid))


class _WarmParent:
    """The warm parent as seen by the supervisor: started for the first fork, and again when it has ended."""

    def __init__(self, starter: Starter, given: tuple[int, socket.socket] | None) -> None:
        self._starter, self._given = starter, given
        #: Held during a request: the answers come in their order.
        self._lock = asyncio.Lock()
        self._loaded: list[str] = []
        self._command: tuple[str, ...] = ()
        self._process: Child | None = None
        self._channel: socket.socket | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._failures = 0
        self._is_closed = False

    def prepare(self, module: ModuleRun) -> None:
        """Load a module in the background."""
        self._tasks.append(asyncio.create_task(self._load(module)))

    async def fork(self, module: ModuleRun, cwd: Path, output: int) -> int:
        """The process id of a new process. Raises StartFailed."""
        request = {"module": module.name, "arguments": module.arguments, "cwd": str(cwd), "title": module.title}
        answer = await self._ask(request, [output])
        if module.name not in self._loaded:
            self._loaded.append(module.name)
        return int(answer["pid"])

    async def close(self) -> None:
        self._is_closed = True
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._process:
            self._process.send_signal(signal.SIGKILL)
            await self._process.wait()
        if self._channel:
            self._channel.close()

    async def _load(self, module: ModuleRun) -> None:
        with contextlib.suppress(StartFailed):  # the start of the module fails too, and reports it
            await self._ask({"module": module.name})

    async def _ask(self, request: dict[str, Any], descriptors: Sequence[int] = ()) -> dict[str, Any]:
        """The answer to a request. Raises StartFailed."""
        async with self._lock:
            answer = await self._exchange(request, descriptors)
            if answer is None and not self._is_closed:  # it had ended, or ended meanwhile
                self._kill_strays(request.get("title", ""))
                answer = await self._exchange(request, descriptors)
        if answer is None or "error" in answer:
            reason = answer["error"] if answer else "the warm parent has ended"
            raise StartFailed(f"can't start {request['module']}: {reason}")
        return answer

    async def _exchange(self, request: dict[str, Any], descriptors: Sequence[int]) -> dict[str, Any] | None:
        """The answer to a request, None for no answer; then the warm parent has ended."""
        if self._process is None or self._process.ended.done():
            await self._start()
        assert self._process and self._channel
        loop = asyncio.get_running_loop()
        limit_s = 600.0  # it may have to compile the kernels of a module
        try:
            socket.send_fds(self._channel, [json.dumps(request).encode()], descriptors)
            if answer := await asyncio.wait_for(loop.sock_recv(self._channel, MAX_REQUEST), limit_s):
                return dict(json.loads(answer))
        except (OSError, asyncio.TimeoutError) as error:
            if not self._is_closed:
                _log.error("the warm parent does not answer (%s)", type(error).__name__)
        self._process.send_signal(signal.SIGKILL)  # a late answer must not be taken for that to another request
        await self._process.wait()
        return None

    def _kill_strays(self, title: str) -> None:
        """Kill what the warm parent has forked without telling."""
        titles = {title, shlex.join(self._command)}
        for child in psutil.Process().children():
            with contextlib.suppress(psutil.Error):
                if not self._starter.knows(child.pid) and " ".join(child.cmdline()) in titles:
                    self._starter.child(child.pid).send_signal(signal.SIGKILL)

    async def _start(self) -> None:
        if self._channel:
            self._channel.close()
        if self._given:
            (pid, self._channel), self._given = self._given, None
            self._channel.setblocking(False)
            self._process = self._starter.child(pid)
            self._tasks.append(asyncio.create_task(self._watch(self._process)))
            return
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.setblocking(False)
        self._command = module_command("robocorba.system.supervision.warm_parent", str(theirs.fileno()))
        pipe = await Pipe.open()
        with theirs, pipe.write_end() as output:
            options = {"cwd": "/", "stdout": output, "stderr": output, "pass_fds": (theirs.fileno(),)}
            self._process = self._starter.spawn(("env", *ENVIRONMENT, *self._command), **options)
        _log.info("the warm parent started with process id %d", self._process.pid)
        reading = asyncio.create_task(pipe.read(lambda line: relay("warm_parent", line)))
        watching = asyncio.create_task(self._watch(self._process))
        self._tasks = [task for task in self._tasks if not task.done()] + [reading, watching]

    async def _watch(self, process: Child) -> None:
        """Start it again when it has ended, so that it is warm for the next fork."""
        code = await process.wait()
        if self._is_closed:
            return
        _log.error("the warm parent ended %s", cause(code))
        self._failures += 1
        await asyncio.sleep(Backoff(0.05, 10.0).pause_s(self._failures))
        for name in self._loaded:
            try:
                await self._ask({"module": name})
            except StartFailed as error:
                _log.error("%s", error)
                return
        self._failures = 0


def _kill(started: asyncio.Task[Child]) -> None:
    if not started.cancelled() and not started.exception():
        started.result().send_signal(signal.SIGKILL)


def cause(code: int) -> str:
    """How a process ended, such as "with exit code 1" or "by SIGKILL"."""
    if code >= 0:
        return f"with exit code {code}"
    try:
        return f"by {signal.Signals(-code).name}"
    except ValueError:
        return f"by signal {-code}"

"""The whole system: starts the naming service, then all servers; stops them in reverse order on a signal."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import logging
import os
import re
import shutil
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from robocorba import logs
from robocorba.corba.orb import CONTEXT, Orb
from robocorba.errors.services import PortInUse, ServiceError
from robocorba.settings import Address
from robocorba.supervision.folder import ProcessRecord, StateFolder, SystemRecord, is_free
from robocorba.supervision.launch import module_command
from robocorba.supervision.process import ProcessSpec, Supervised
from robocorba.supervision.servers import Server

NAMING_SERVICE = "omniNames"
_log = logging.getLogger(__name__)
_LEVELS = {"WARNING": logging.WARNING, "ERROR": logging.ERROR, "CRITICAL": logging.CRITICAL}


@dataclass(frozen=True)
class System:
    """A naming service at `naming` and `servers` on ports of the same host, with their data in `folder`.

    before_ready: called in a thread once every server has answered, before the system is ready.
    building: absolute path passed to the servers, or None. start_limit_s: time limit for each process to
    answer its first call."""

    folder: StateFolder
    naming: Address
    servers: Sequence[Server]
    before_ready: Callable[[Orb], None] = lambda orb: None
    building: Path | None = None
    start_limit_s: float = 60.0

    def run(self, ready: Callable[[SystemRecord], None]) -> None:
        """Run until SIGINT, SIGTERM or SIGHUP; calls `ready` once every server has answered a real call.

        Raises AlreadyRunning, PortInUse, StartFailed and other ServiceErrors, after all processes have ended."""
        with self.folder.locked():
            logs.setup("up", self.folder.logs)
            if not is_free(self.naming.host, self.naming.port):
                raise PortInUse(self.naming.host, self.naming.port, "the naming service")
            ports = self.folder.ports([server.name for server in self.servers], self.naming)
            try:
                with Orb(self.naming) as orb:
                    asyncio.run(self._run(orb, ports, ready))
            finally:
                self.folder.remove_record()

    async def _run(self, orb: Orb, ports: dict[str, int], ready: Callable[[SystemRecord], None]) -> None:
        stop_requested = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(number, stop_requested.set)
        stop = asyncio.create_task(stop_requested.wait())
        created = psutil.Process().create_time()
        processes: list[Supervised] = []

        def record() -> SystemRecord:
            rows = tuple(self._row(process, ports) for process in processes)
            return SystemRecord(str(self.naming), os.getpid(), created, rows)

        def changed() -> None:
            try:
                self.folder.write_record(record())
            except ServiceError as error:  # a full disk must not stop the system
                _log.error("%s", error)

        names = Supervised(self._naming_service(orb), changed)
        servers = [Supervised(self._server(server, ports[server.name], orb), changed) for server in self.servers]
        processes += [names, *servers]
        tasks: list[asyncio.Task[None]] = []
        try:
            for group in ([names], servers):  # servers need the naming service: they start after it and end before it
                tasks += [asyncio.create_task(process.supervise()) for process in group]
                await _first(asyncio.create_task(_all_ready(group)), stop, *tasks)
                if stop.done():
                    return
            await _first(asyncio.create_task(asyncio.to_thread(self.before_ready, orb)), stop, *tasks)
            if stop.done():
                return
            _log.info("ready")
            ready(record())
            await _first(stop, *tasks)
        finally:
            await _cancel(tasks[1:])
            await _cancel(tasks[:1])
            _log.info("stopped")

    def _row(self, process: Supervised, ports: dict[str, int]) -> ProcessRecord:
        name = process.spec.name
        objects = next((server.objects for server in self.servers if server.name == name), {})
        return ProcessRecord(
            name=name,
            state=process.state,
            pid=process.pid,
            endpoint=str(Address(self.naming.host, ports[name]) if name in ports else self.naming),
            names=tuple(f"{CONTEXT}/{bound}" for bound in objects),
            started=process.started,
            restarts=process.restarts,
        )

    def _naming_service(self, orb: Orb) -> ProcessSpec:
        command = naming_service_command(self.naming, self.folder.names)
        log = logs.open_log(NAMING_SERVICE, self.folder.logs)

        def log_line(line: str) -> None:
            log.info("%s", re.sub(r"^omniNames: \(\d+\) [\d-]+ [\d:.]+: ", "", line))  # without its own time

        return ProcessSpec(
            NAMING_SERVICE, command, self.folder.path, orb.check_naming, log_line, start_limit_s=self.start_limit_s
        )

    def _server(self, server: Server, port: int, orb: Orb) -> ProcessSpec:
        command = [*module_command(server.module), "--state", str(self.folder.path)]
        command += ["--endpoint", str(Address(self.naming.host, port)), "--naming", str(self.naming)]
        command += server.arguments
        if self.building:
            command += ["--building", str(self.building)]

        def probe() -> None:
            for name, object_probe in server.objects.items():
                object_probe.call_object(orb, name)

        def relay(line: str) -> None:
            level, _, text = line.partition(" ")
            text = text if level in _LEVELS else line
            _log.log(_LEVELS.get(level, logging.WARNING), "%s: %s", server.name, text)

        # In the state folder, so that files in the user's folder cannot replace modules.
        return ProcessSpec(
            server.name, tuple(command), self.folder.path, probe, relay, start_limit_s=self.start_limit_s
        )


def naming_service_command(naming: Address, data: Path) -> tuple[str, ...]:
    """The command of a naming service at `naming`, with its bindings in the folder `data`. Raises ServiceError."""
    # With -nohostname the data stay readable after the machine is renamed.
    options = ("-start", str(naming.port), "-always", "-nohostname", "-datadir", str(data))
    return (find_omninames(), *options, "-ORBendPoint", f"giop:tcp:{naming}")


def find_omninames() -> str:
    """omniNames of the omniORB in this Python environment, else from PATH. Raises ServiceError."""
    package = importlib.util.find_spec("jeteve_omniorb")
    for folder in package.submodule_search_locations or () if package else ():
        # Not the environment's command omniNames: it is a wrapper, and a kill would reach only the wrapper.
        program = Path(folder) / "bin" / "omniNames"
        if program.is_file():
            return str(program)
    found = shutil.which("omniNames")
    if found is None:
        raise ServiceError("omniNames is missing: install jeteve-omniorb, or omniORB 4.2 or later")
    return found


async def _all_ready(processes: Sequence[Supervised]) -> None:
    for process in processes:
        await process.ready.wait()


async def _first(*awaited: asyncio.Future) -> None:
    """Wait until one is done; raises its exception."""
    done, _ = await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)
    for future in done:
        future.result()


async def _cancel(tasks: Sequence[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    for task in tasks:
        with contextlib.suppress(asyncio.CancelledError, ServiceError):
            await task

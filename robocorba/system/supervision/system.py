"""The whole system: starts the naming service, then all servers; stops them in reverse order on a signal."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import importlib.util
import logging
import os
import re
import secrets
import shutil
import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from robocorba.errors.services import PortInUse, ServiceError
from robocorba.orb.orb import CONTEXT, Orb
from robocorba.orb.reference_file import write_reference
from robocorba.system import logs
from robocorba.system.corba.servers import Server
from robocorba.system.corba.supervisor_servant import SupervisorServant
from robocorba.system.endpoints import is_free
from robocorba.system.names import ADMINISTRATOR, CONSOLE, SUPERVISOR
from robocorba.system.processes import RobotOrder
from robocorba.system.roles import Role
from robocorba.system.settings import Address, omniorb_trace
from robocorba.system.state_folder import ProcessRecord, StateFolder, SystemRecord, started_s
from robocorba.system.supervision.access import Access, remove_access
from robocorba.system.supervision.hangs import HangLimit
from robocorba.system.supervision.launch import ModuleRun
from robocorba.system.supervision.naming_data import mend_naming_data
from robocorba.system.supervision.output import ReadyLine, relay
from robocorba.system.supervision.process import ProcessSpec, Supervised
from robocorba.system.supervision.robots import Robots, robot_spec
from robocorba.system.supervision.starter import Starter
from robocorba.system.supervision.supervisor import Supervisor

NAMING_SERVICE = "omniNames"
#: Naming services: that of a guarded system is a server of ours.
GUARDED_NAMING_SERVICE = "names"
NAMING_SERVICES = (NAMING_SERVICE, GUARDED_NAMING_SERVICE)
#: Signals that stop the system.
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class System:
    """A naming service at `naming` and `servers` on ports of the same host, with their data in `folder`.

    before_ready: called in a thread once every server has answered, before the system is ready.
    building: absolute path passed to the servers, or None. start_limit_s: time limit for each process to
    answer its first call. hang_limit: when one that does not answer any more is restarted. console: where the
    operator's console listens, None for no console; port 0: a free one, kept as those of servers.
    is_guarded: roles decide who may do what, see robocorba.system.roles.
    certificates: a folder with ca.pem and tls.pem, for a guarded system that uses TLS; None for no TLS."""

    folder: StateFolder
    naming: Address
    servers: Sequence[Server]
    before_ready: Callable[[Orb], None] = lambda orb: None
    building: Path | None = None
    start_limit_s: float = 60.0
    console: Address | None = None
    hang_limit: HangLimit = field(default_factory=HangLimit)
    is_guarded: bool = False
    certificates: Path | None = None

    def run(self, ready: Callable[[SystemRecord], None], prepare: Callable[[], object] = lambda: None) -> None:
        """Run until SIGINT, SIGTERM or SIGHUP; calls `prepare` before anything is started, and `ready` once every
        server has answered a real call.

        Raises AlreadyRunning, PortInUse, StartFailed and other ServiceErrors, after all processes have ended."""
        with self.folder.locked():
            logs.setup("up", self.folder.logs)
            if not is_free(self.naming.host, self.naming.port):
                raise PortInUse(self.naming.host, self.naming.port, "the naming service")
            if self.console and not is_free(self.console.host, self.console.port):
                raise PortInUse(self.console.host, self.console.port, "the console")
            self.folder.set_damaged_record_aside()
            try:
                with _interrupted_by_signals():
                    prepare()
            except KeyboardInterrupt:
                return
            names = [server.name for server in self.servers]
            is_open = self.console is not None and not self.console.port
            ports = self.folder.ports([*names, CONSOLE] if is_open else names, self.naming)
            if self.is_guarded:
                Access.create(self.folder.path, self.naming, self.certificates)
            else:
                remove_access(self.folder.path)
            try:
                with Orb(self._naming(Role.SERVER)) as orb:
                    asyncio.run(self._run(orb, ports, ready))
            finally:
                self.folder.remove_record()
                (self.folder.path / SUPERVISOR).unlink(missing_ok=True)

    async def _run(self, orb: Orb, ports: dict[str, int], ready: Callable[[SystemRecord], None]) -> None:
        stop_requested = asyncio.Event()
        for number in STOP_SIGNALS:
            asyncio.get_running_loop().add_signal_handler(number, stop_requested.set)
        stop = asyncio.create_task(stop_requested.wait())
        created = started_s(os.getpid())
        processes: list[Supervised] = []

        def record() -> SystemRecord:
            rows = tuple(_row(process) for process in (*processes, *robots.processes))
            return SystemRecord(str(self.naming), os.getpid(), created, rows, self.hang_limit.limit_s)

        def changed() -> None:
            try:
                self.folder.write_record(record())
            except ServiceError as error:  # a full disk must not stop the system
                _log.error("%s", error)

        starter = Starter()
        service = self._guarded_naming_service(orb) if self.is_guarded else self._naming_service(orb)
        names = Supervised(service, starter, self.hang_limit, changed)
        servers = [
            Supervised(self._server(server, ports[server.name], orb), starter, self.hang_limit, changed)
            for server in self.servers
        ]
        consoles = []
        if self.console:
            address = Address(self.console.host, self.console.port or ports[CONSOLE])
            consoles.append(Supervised(self._console(address), starter, changed=changed))
        robots = Robots(self._robot, starter, changed)
        processes += [names, *servers, *consoles]
        self._serve_supervisor(orb, processes, robots)
        started: list[list[asyncio.Task[None]]] = []
        try:
            # Servers need the naming service, and the console needs both: each group ends before those that it needs.
            # The warm parent loads for one server after the other, so that those which others need come first.
            pairs = sorted(zip(self.servers, servers, strict=True), key=lambda pair: not pair[0].starts_first)
            ordered = [process for _, process in pairs]
            for first in ordered[:1]:  # while the naming service starts
                starter.prepare(first.spec.command)
            for group in filter(None, ([names], ordered, consoles)):
                started.append([asyncio.create_task(process.supervise()) for process in group])
                await _first(asyncio.create_task(_all_ready(group)), stop, *chain.from_iterable(started))
                if stop.done():
                    return
            tasks = list(chain.from_iterable(started))
            await _first(asyncio.create_task(asyncio.to_thread(self.before_ready, orb)), stop, *tasks)
            if stop.done():
                return
            _log.info("ready")
            ready(record())
            await _first(stop, *tasks)
        finally:
            await robots.close()
            for group_tasks in reversed(started):
                await _cancel(group_tasks)
            await starter.close()
            _log.info("stopped")

    def _serve_supervisor(self, orb: Orb, processes: Sequence[Supervised], robots: Robots) -> None:
        loop = asyncio.get_running_loop()

        def check(order: RobotOrder) -> RobotOrder:
            from robocorba.system.supervision.order_checker import checked  # loads half of RoboCorba

            return checked(orb, order)

        supervisor = Supervisor(loop, processes, robots, check, self.folder.logs)
        # Its secret key is the right to call it.
        reference = orb.activate(SupervisorServant(supervisor), secrets.token_hex(16))
        orb.accept_calls()
        write_reference(orb, reference, self.folder.path / SUPERVISOR)

    def _console(self, address: Address) -> ProcessSpec:
        """With the rights of the administrator and to start robots."""
        state, naming = self.folder.path, self._naming(Role.OPERATOR).setting
        options = ["--host", address.host, "--port", str(address.port), "--naming", naming, "--state", str(state)]
        options += ["--administrator", str(state / ADMINISTRATOR), "--supervisor", str(state / SUPERVISOR)]
        command, output = ModuleRun("robocorba.clients.console", tuple(options)), ReadyLine(CONSOLE, ignored="http")
        return ProcessSpec(
            CONSOLE, command, state, output.probe, output, start_limit_s=self.start_limit_s, endpoint=str(address)
        )

    def _robot(self, order: RobotOrder) -> ProcessSpec:
        return robot_spec(order, self.folder.path, self._naming(Role.ROBOT), self.start_limit_s)

    def _naming(self, role: Role) -> Address:
        """The naming service, as processes of a role see it."""
        return Access.read(self.folder.path).naming(role) if self.is_guarded else self.naming

    def _guarded_naming_service(self, orb: Orb) -> ProcessSpec:
        name, endpoint = GUARDED_NAMING_SERVICE, str(self.naming)
        naming = self._naming(Role.SERVER).setting
        arguments = ("--state", str(self.folder.path), "--endpoint", endpoint, "--naming", naming)
        return ProcessSpec(
            name,
            ModuleRun("robocorba.servers.names", arguments),
            self.folder.path,
            orb.check_naming,
            functools.partial(relay, name),
            start_limit_s=self.start_limit_s,
            is_alive=orb.check_naming,
            endpoint=endpoint,
        )

    def _naming_service(self, orb: Orb) -> ProcessSpec:
        command = naming_service_command(self.naming, self.folder.names)
        log = logs.open_log(NAMING_SERVICE, self.folder.logs)

        def log_line(line: str) -> None:
            log.info("%s", re.sub(r"^omniNames: \(\d+\) [\d-]+ [\d:.]+: ", "", line))  # without its own time

        return ProcessSpec(
            NAMING_SERVICE,
            command,
            self.folder.path,
            orb.check_naming,
            log_line,
            start_limit_s=self.start_limit_s,
            is_alive=orb.check_naming,
            endpoint=str(self.naming),
            before_start=functools.partial(mend_naming_data, self.folder.names),
        )

    def _server(self, server: Server, port: int, orb: Orb) -> ProcessSpec:
        endpoint = str(Address(self.naming.host, port))
        naming = self._naming(Role.SERVER).setting
        arguments = ["--state", str(self.folder.path), "--endpoint", endpoint, "--naming", naming]
        arguments += server.arguments
        if self.building:
            arguments += ["--building", str(self.building)]
        module = ModuleRun(server.module, tuple(arguments))

        def probe() -> None:
            for name, object_probe in server.objects.items():
                object_probe.call_object(orb, name)

        def is_alive() -> None:
            for name, object_probe in server.objects.items():
                object_probe.call_at(orb, endpoint, name)

        # In the state folder, so that files in the user's folder cannot replace modules.
        return ProcessSpec(
            server.name,
            module,
            self.folder.path,
            probe,
            functools.partial(relay, server.name),
            start_limit_s=self.start_limit_s,
            is_alive=is_alive,
            endpoint=endpoint,
            names=tuple(f"{CONTEXT}/{bound}" for bound in server.objects),
        )


@contextlib.contextmanager
def _interrupted_by_signals() -> Iterator[None]:
    """Inside, signals that stop the system raise KeyboardInterrupt."""
    former = {number: signal.signal(number, signal.default_int_handler) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def _row(process: Supervised) -> ProcessRecord:
    spec = process.spec
    return ProcessRecord(
        spec.name, process.state, process.pid, spec.endpoint, spec.names, process.started, process.restarts
    )


def naming_service_command(naming: Address, data: Path) -> tuple[str, ...]:
    """The command of a naming service at `naming`, with its bindings in the folder `data`. Raises ServiceError."""
    # With -nohostname the data stay readable after the machine is renamed.
    options = ("-start", str(naming.port), "-always", "-nohostname", "-datadir", str(data))
    # A request of which only a part arrives ends its connection after this time [ms]; see robocorba.orb.orb. So does
    # one that is idle [s]; ours are closed by their clients before.
    limits = ("-ORBserverCallTimeOutPeriod", "20000", "-ORBinConScanPeriod", "90")
    # Beyond this number, by default 10,000, connections would share a few threads, which those that stall keep.
    threads = ("-ORBthreadPerConnectionUpperLimit", "100000", "-ORBthreadPerConnectionLowerLimit", "90000")
    calls = ("-ORBmaxServerThreadPerConnection", "16")
    quiet = [argument for option, value in omniorb_trace().items() for argument in (f"-ORB{option}", value)]
    return (find_omninames(), *options, *limits, *threads, *calls, *quiet, "-ORBendPoint", f"giop:tcp:{naming}")


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

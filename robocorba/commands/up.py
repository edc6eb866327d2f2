"""robocorba up: start the naming service and all servers, stop them on Ctrl-C or SIGTERM."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.compiling import compile_with_progress
from robocorba.commands.options import State, only_for
from robocorba.commands.reporting import reporting
from robocorba.commands.tables import Sheet, show
from robocorba.console.settings import DEFAULT_PORT
from robocorba.errors.services import PortInUse, ServiceError
from robocorba.map_editor.samples import map_file
from robocorba.orb.naming import corbaname
from robocorba.orb.tls import load_transport
from robocorba.system.corba.servers import servers
from robocorba.system.corba.subnets import default_subnets, parse_subnets, remove_former_links, subnets_of_map
from robocorba.system.endpoints import user_of
from robocorba.system.extras import require_extra
from robocorba.system.instances import port_to_start
from robocorba.system.names import CONSOLE
from robocorba.system.printing import Console, echo, line
from robocorba.system.settings import DEFAULT_HOST, Address, InvalidSetting, Settings, accept_rule
from robocorba.system.state_folder import StateFolder, SystemRecord
from robocorba.system.supervision.hangs import HangLimit
from robocorba.system.supervision.system import NAMING_SERVICES, System


def up(
    context: typer.Context,
    building: Annotated[
        Path | None, typer.Option(metavar="MAP", help="Map file or sample. Default: the stored one, else five-floors.")
    ] = None,
    state: State = None,
    naming_port: Annotated[
        int | None, typer.Option(metavar="N", help="Naming service's port. Default: by ROBOCORBA_NAMING, else 2809.")
    ] = None,
    host: Annotated[
        str | None, typer.Option(metavar="H", help="Address to serve at. Default: by ROBOCORBA_NAMING, else 127.0.0.1.")
    ] = None,
    subnets: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="Event channels to start. Default: the map's, else main.")
    ] = None,
    sensors: Annotated[int, typer.Option(metavar="N", min=1, max=64, help="Number of virtual sensor servers.")] = 1,
    start_limit: Annotated[
        float, typer.Option(metavar="S", help="Stop everything if a process needs more than S seconds to start.")
    ] = 180.0,
    hang_limit: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Restart a server that does not answer for S seconds; 0: never.")
    ] = 10.0,
    spare_stopped: Annotated[
        bool, typer.Option("--spare-stopped", help="Do not restart servers that a debugger or SIGSTOP has paused.")
    ] = False,
    guarded: Annotated[
        bool, typer.Option("--guarded", help="Let clients only observe unless they use a role's file from access/.")
    ] = False,
    tls: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Encrypt by ca.pem and tls.pem in DIR, and check as --guarded.")
    ] = None,
    bidirectional: Annotated[
        bool, typer.Option("--bidirectional", help="Reach consumers behind NAT over the connections that they open.")
    ] = False,
    accept: Annotated[
        str,
        typer.Option(
            metavar="ROBOTS,SECONDS",
            help="Add an obstacle to the map once ROBOTS robots have seen it for SECONDS. Default: by hand.",
        ),
    ] = "",
    console: Annotated[
        bool, typer.Option("--console", help="Also serve the operator's console, to browsers on this machine.")
    ] = False,
    console_port: Annotated[
        int | None, typer.Option(metavar="N", min=0, max=65535, help="Port of --console; 0: a free one. Default: 8800.")
    ] = None,
) -> None:
    """Start the naming service and all servers, each in its own process, and print `ready` when all answer.

    A server that ends is restarted. Ctrl-C or SIGTERM stops everything."""
    only_for("--console", console, context, "console_port")
    only_for("a --hang-limit above 0", hang_limit, context, "spare_stopped")
    with reporting("up"):
        settings = Settings.read(state=state, choose_port=port_to_start)
        if console_port is None:
            console_port = 0 if settings.instance else DEFAULT_PORT
        naming = Address.checked(
            host or settings.naming.host,
            settings.naming.port if naming_port is None else naming_port,
            "--host or --naming-port",
        )
        if building is not None and not (building := map_file(building)).is_file():
            raise InvalidSetting("--building", str(building), "there is no such file")
        accept_rule(accept)
        if tls is not None:
            load_transport()
        folder = StateFolder(settings.state)
        names = default_subnets(folder, building) if subnets is None else parse_subnets(subnets)
        if missing := [name for name in subnets_of_map(folder, building) if name not in names]:
            line(f"warning: sub-networks of the map without a channel: {', '.join(missing)}", err=True)
        system = System(
            folder=folder,
            naming=naming,
            servers=servers(names, sensors, bidirectional, accept),
            before_ready=functools.partial(remove_former_links, folder, names),
            building=building.absolute() if building else None,
            start_limit_s=start_limit,
            console=_console_address(console_port) if console else None,
            hang_limit=HangLimit(hang_limit, spare_stopped),
            is_guarded=guarded or tls is not None,
            certificates=tls,
        )
        run(system)


def _console_address(port: int) -> Address:
    """Where the console listens: on the loopback only, since it has the rights of an administrator and no password."""
    require_extra("console", "pages of the console")
    return Address(DEFAULT_HOST, port)


def run(system: System) -> None:
    """Run `system` until a signal; print its processes and `ready` once it is. Raises as System.run does."""
    waiting = Console(stderr=True).status("starting the naming service and the servers ...")

    def prepare() -> None:
        compile_with_progress(system.folder.logs)
        if Console(stderr=True).is_terminal:
            waiting.start()

    def ready(record: SystemRecord) -> None:
        waiting.stop()
        show(sheet_of(record))
        echo("ready")

    try:
        system.run(ready, prepare)
    except PortInUse as error:
        raise ServiceError(
            f"{error}: {user_of(error.port)} listens there. A second system gets ports of its own from "
            "`robocorba up --instance NAME`"
        ) from None
    finally:
        waiting.stop()


def sheet_of(record: SystemRecord) -> Sheet:
    """The objects of a system, with their whole addresses."""
    naming = Address.parse(record.naming)
    rows = []
    for process in record.processes:
        names = ("",) if process.name in NAMING_SERVICES else process.names
        objects = [corbaname(naming, name) for name in names]
        if process.name == CONSOLE:
            objects.append(record.console_address)
        rows += [(process.name, process.pid, where) for where in objects]
    return Sheet(("process", "pid", "object"), rows, spare=("pid",))

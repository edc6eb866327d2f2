"""robocorba robots: start a fleet of robots, each as a process; show what they do, end them on Ctrl-C or SIGTERM."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from robocorba.commands.options import Naming, State, connected, only_for
from robocorba.commands.reporting import reporting
from robocorba.commands.waiting import RESOLVE_TIMEOUT_S
from robocorba.system import logs
from robocorba.system.names import CHANNELS
from robocorba.system.printing import Console
from robocorba.system.private_files import claim_state
from robocorba.system.roles import Role
from robocorba.system.settings import Settings
from robocorba.system.supervision.robots import STARTING


def robots(
    context: typer.Context,
    fleet: Annotated[
        Path | None, typer.Argument(metavar="FLEET.yaml", help="File that lists the robots. Without it give --count.")
    ] = None,
    count: Annotated[int, typer.Option(metavar="N", min=0, help="Number of robots.")] = 0,
    prefix: Annotated[str, typer.Option(metavar="R", help="Prefix of their names: R gives R1, R2 and so on.")] = "R",
    floor: Annotated[str | None, typer.Option(metavar="F", help="Floor on which they start.")] = None,
    channel: Annotated[
        str | None, typer.Option(metavar="C", help="Event channel. Default: that of the area in which they start.")
    ] = None,
    program: Annotated[Path | None, typer.Option(metavar="FILE", help="Program that each robot runs at once.")] = None,
    adaptor: Annotated[str | None, typer.Option(metavar="A", help="Robot adaptor. Default: simulated.")] = None,
    argument: Annotated[
        list[str] | None, typer.Option(metavar="ARG", help="Argument of the adaptor. Repeatable.")
    ] = None,
    perceive: Annotated[
        str | None,
        typer.Option(
            metavar="simulation|sensors",
            help="Avoid what the simulation knows, or what the robots' sensors see. Default: simulation.",
        ),
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Start robots again when they end.")] = False,
    starting: Annotated[
        int, typer.Option(metavar="N", min=1, max=200, help="Number of robots to start at the same time.")
    ] = STARTING,
    start_limit: Annotated[
        float, typer.Option(metavar="S", min=1.0, help="Limit for the start of each robot [s].")
    ] = 180.0,
    naming: Naming = None,
    state: State = None,
) -> None:
    """Start many robots, each in its own process, and show what they do. Ctrl-C or SIGTERM ends them.

    A robot that ends is shown with the reason, while the others continue. Exit code 0 if none did, else 1."""
    from robocorba.commands.compiling import compile_with_progress
    from robocorba.commands.fleet_view import FleetView
    from robocorba.simulation.corba.remote_database import RemoteDatabase
    from robocorba.system.supervision.fleet import Fleet
    from robocorba.system.supervision.fleet_file import group_of, read_fleet

    given = {"floor": floor, "channel": channel, "program": program and str(program), "adaptor": adaptor}
    given["perceive"] = perceive
    options: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if argument:
        options["arguments"] = argument
    if (fleet is None) == (count == 0):
        raise typer.BadParameter("name a file, or give --count")
    only_for("robots of --count, a file has its own", count, context, "prefix", "argument", *given)
    with reporting("robots"):
        settings = Settings.read(naming=naming, state=state, role=Role.ROBOT)
        orders_in = read_fleet(fleet) if fleet else group_of({**options, "prefix": prefix, "count": count})
        console = Console()
        claim_state(settings.state)
        logs.setup("robots", settings.state / "logs", with_stderr=not console.is_terminal)
        compile_with_progress(settings.state / "logs")
        with connected("robots", naming, state=state, role=Role.ROBOT) as orb:
            floors, channels = RemoteDatabase(orb, RESOLVE_TIMEOUT_S).floors(), orb.names(CHANNELS, RESOLVE_TIMEOUT_S)
            orders = orders_in(floors, channels)
            with FleetView(console) as view:
                running = Fleet(orders, settings, view, starting, restart, start_limit)
                is_fine = running.run(orb)
    if not is_fine:
        raise typer.Exit(1)

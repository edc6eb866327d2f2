"""robocorba robot, stop, switch: start a robot, stop robots, replace an agent's adaptor."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from robocorba.commands.options import Naming, connected
from robocorba.supervision.launch import module_command


def robot(context: typer.Context) -> None:
    """Start a robot: NAME [--adaptor A] [--program FILE] [--floor F] [--at X,Y[,HEADING]] [--channel C] [--record FILE]
    [-- ...].

    It logs on, is bound as RoboCorba/Robots/NAME, and runs until Ctrl-C or SIGTERM. `--help` lists the options."""
    command = module_command("robocorba.clients.robot", *context.args)
    os.execv(command[0], command)


def stop(
    name: Annotated[str, typer.Argument(metavar="ROBOT", help="Name of the robot.")] = "",
    all_robots: Annotated[bool, typer.Option("--all", help="Stop all robots.")] = False,
    reset: Annotated[bool, typer.Option("--reset", help="Restart the robot after a stop.")] = False,
    naming: Naming = None,
) -> None:
    """Emergency stop: a robot stops as soon as possible, and does not move until `--reset`."""
    if bool(name) == all_robots:
        raise typer.BadParameter("name a robot, or give --all")
    from robocorba.corba.remote.control_agent import RemoteAgent, order_all, robots

    with connected("stop", naming) as orb:
        names = robots(orb) if all_robots else [name]
        is_failed = False
        for each, problem in order_all(orb, names, RemoteAgent.reset_stop if reset else RemoteAgent.stop):
            typer.echo(f"{each}\t{problem or ('may move again' if reset else 'stopped')}", err=bool(problem))
            is_failed |= bool(problem)
    if is_failed:
        raise typer.Exit(1)


def switch(
    name: Annotated[str, typer.Argument(metavar="ROBOT", help="Name of the robot.")],
    adaptor: Annotated[str, typer.Argument(metavar="ADAPTOR", help="Such as simulated or smartpal.")],
    arguments: Annotated[list[str] | None, typer.Argument(metavar="...", help="The adaptor's, after --.")] = None,
    naming: Naming = None,
) -> None:
    """Switch a robot's agent to the actual or the virtual robot. It refuses while a program runs."""
    from robocorba.corba.remote.control_agent import RemoteAgent

    with connected("switch", naming) as orb:
        agent = RemoteAgent(orb, name)
        agent.switch(adaptor, arguments or [])
        typer.echo(f"{name}\t{adaptor}")

"""robocorba robot, stop, switch: start a robot, stop robots, replace an agent's adaptor."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated

import typer

from robocorba.commands.forwarding import forwarding
from robocorba.commands.options import Naming, RobotName, State, administrator, connected
from robocorba.errors.base import RoboCorbaError
from robocorba.system.printing import line
from robocorba.system.settings import RobotSettings, Settings

if TYPE_CHECKING:
    from robocorba.orb.orb import Orb


@forwarding("robocorba.clients.robot", RobotSettings.add_arguments)
def robot() -> None:
    """Start a robot, log it on and bind it as RoboCorba/Robots/NAME. Ctrl-C or SIGTERM ends it."""


def stop(
    name: RobotName = "",
    all_robots: Annotated[bool, typer.Option("--all", help="Stop all robots.")] = False,
    reset: Annotated[bool, typer.Option("--reset", help="Release the robot after a stop.")] = False,
    naming: Naming = None,
    state: State = None,
) -> None:
    """Emergency stop: stop a robot as soon as possible, and hold it until `--reset`.

    `--all` also holds robots that log on later, until `--all --reset`.

    Prints `stands` only for a robot that is confirmed to stand. Exit code 0 if all do, else 1. Give the system's state
    folder to stop robots even without the naming service."""
    if bool(name) == all_robots:
        raise typer.BadParameter("name a robot, or give --all")
    names = [] if all_robots else [name]
    with connected("stop", naming, state=state) as orb:
        settings = Settings.read(naming=naming, state=state)
        is_fine = _reset(orb, names, settings) if reset else _stop(orb, names, settings)
        if not is_fine:
            orb.check_naming()  # else the hint is printed too
            raise typer.Exit(1)


def _stop(orb: Orb, names: list[str], settings: Settings) -> bool:
    """Stop robots, without names all; whether all are shown to stand."""
    from robocorba.robot.corba.emergency_stop import OTHERS, stop_robots
    from robocorba.system.supervision.stop_addresses import stop_addresses

    verdicts = stop_robots(orb, names, stop_addresses(settings.state, settings.naming))
    for verdict in verdicts:
        if verdict.stands:
            line(verdict.robot, "holds" if verdict.robot == OTHERS else "stands", verdict.text)
        else:
            line(verdict.robot, verdict.text, err=True)
    # A name that anybody may have bound is no robot.
    return all(verdict.stands or not (verdict.is_known or names) for verdict in verdicts)


def _reset(orb: Orb, names: list[str], settings: Settings) -> bool:
    from robocorba.robot.corba.emergency_stop import reset_robots
    from robocorba.robot.corba.remote_agent import robots
    from robocorba.system.supervision.stop_addresses import stop_addresses

    problems = dict(reset_robots(orb, names, stop_addresses(settings.state, settings.naming)))
    for name in {*names} - {*robots(orb)}:  # it has left, or has no agent
        with contextlib.suppress(RoboCorbaError):
            administrator(orb, settings.state).reset_stop(name)
            problems[name] = ""
    for name, problem in problems.items():
        line(name, problem or "may move again", err=bool(problem))
    return not any(problems.values())


def switch(
    name: RobotName,
    adaptor: Annotated[str, typer.Argument(metavar="ADAPTOR", help="Adaptor, such as simulated or smartpal.")],
    arguments: Annotated[list[str] | None, typer.Argument(metavar="...", help="Arguments of it, after --.")] = None,
    naming: Naming = None,
) -> None:
    """Switch a robot's agent between the virtual and the actual robot. Refused while a program runs."""
    from robocorba.robot.corba.remote_agent import RemoteAgent

    with connected("switch", naming) as orb:
        agent = RemoteAgent(orb, name)
        agent.switch(adaptor, arguments or [])
        line(name, adaptor)

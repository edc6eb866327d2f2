"""robocorba simulation: administration of the simulation server."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Json, RobotName, State, administrator, connected, only_for
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.simulation.corba.remote_administrator import RemoteAdministrator
from robocorba.system.printing import line

app = typer.Typer(no_args_is_help=True)


@app.command()
def limit(
    robots: Annotated[int, typer.Argument(min=0, max=10_000, help="Maximum number. Robots that are logged on stay.")],
    state: State = None,
) -> None:
    """Limit how many robots may be logged on."""
    with _administrator(state) as simulation:
        simulation.set_limit(robots)


@app.command()
def evict(robot: RobotName, state: State = None) -> None:
    """Log a robot off and keep it out until `admit`, even after a restart."""
    with _administrator(state) as simulation:
        was_here = simulation.keep_out(robot)
        done = "is logged off and kept out" if was_here else "is kept out; it was not logged on"
        line(robot, f"{done}. To let it in again: robocorba simulation admit {robot}")


@app.command()
def admit(
    context: typer.Context,
    robot: Annotated[str, typer.Argument(help="Name of the robot. Without it, list evicted robots.")] = "",
    json: Json = False,
    state: State = None,
) -> None:
    """Let an evicted robot log on again."""
    only_for("the list of robots that are kept out", not robot, context, "json")
    with _administrator(state) as simulation:
        if json:
            print_json(simulation.kept_out())
        elif not robot:
            show(Sheet(["kept out"], [(name,) for name in simulation.kept_out()]))
        elif simulation.admit(robot):
            line(robot, "may log on again")
        else:
            line(robot, "was not kept out")


@app.command()
def pace(
    factor: Annotated[
        float, typer.Argument(help="Simulated seconds per second; 1: real time, 0: as fast as possible.")
    ],
    state: State = None,
) -> None:
    """Set the pace of simulated time."""
    with _administrator(state) as simulation:
        simulation.set_pace(factor)


@app.command()
def pause(state: State = None) -> None:
    """Pause simulated time."""
    with _administrator(state) as simulation:
        simulation.pause()


@app.command()
def resume(state: State = None) -> None:
    """Resume simulated time."""
    with _administrator(state) as simulation:
        simulation.resume()


@app.command()
def step(
    steps: Annotated[int, typer.Argument(min=1, max=10_000, help="Number of steps of 0.02 s.")] = 1, state: State = None
) -> None:
    """Advance paused simulated time by some steps."""
    with _administrator(state) as simulation:
        simulation.step(steps)


@contextlib.contextmanager
def _administrator(state: Path | None) -> Iterator[RemoteAdministrator]:
    with connected("simulation", None, state=state) as orb:
        yield administrator(orb, state)

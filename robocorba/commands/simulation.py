"""robocorba simulation: administration of the simulation server."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import State, administrator
from robocorba.commands.reporting import reporting
from robocorba.corba.orb import Orb
from robocorba.corba.remote.administrator import RemoteAdministrator
from robocorba.settings import Settings

app = typer.Typer(help="Set limit and pace of the simulation, and log robots off.", no_args_is_help=True)


@app.command()
def limit(
    robots: Annotated[int, typer.Argument(min=0, help="Robots at most. Robots that are logged on stay.")],
    state: State = None,
) -> None:
    """Limit the number of logged-on robots."""
    with _administrator(state) as simulation:
        simulation.set_limit(robots)


@app.command()
def evict(robot: str, state: State = None) -> None:
    """Log a robot off."""
    with _administrator(state) as simulation:
        simulation.evict(robot)


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
    steps: Annotated[int, typer.Argument(help="Steps of 0.02 s, at most 10,000.")] = 1, state: State = None
) -> None:
    """Execute steps while simulated time is paused."""
    with _administrator(state) as simulation:
        simulation.step(steps)


@contextlib.contextmanager
def _administrator(state: Path | None) -> Iterator[RemoteAdministrator]:
    with reporting("simulation"):
        settings = Settings.read(state=state)
        with Orb(settings.naming) as orb:
            yield administrator(orb, settings)

"""The robocorba command: one module a subcommand."""

from __future__ import annotations

import contextlib
import os
import sys

import typer

from robocorba import __version__
from robocorba.commands.events import app as events_app
from robocorba.commands.map import app as map_app
from robocorba.commands.mission import app as mission_app
from robocorba.commands.path import path
from robocorba.commands.program_run import app as program_app
from robocorba.commands.record import record
from robocorba.commands.replay import replay
from robocorba.commands.robot import robot, stop, switch
from robocorba.commands.simulation import app as simulation_app
from robocorba.commands.status import status
from robocorba.commands.up import up
from robocorba.commands.watch import watch

app = typer.Typer(
    help="A CORBA-based cooperative mobile robot system.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(up)
app.command()(status)
app.command()(path)
app.command()(watch)
app.command()(record)
app.command()(replay)
# All of its arguments are the robot process's, the -- among them too: without interspersed ones it stays where it is.
_AS_GIVEN = {"allow_extra_args": True, "ignore_unknown_options": True, "allow_interspersed_args": False}
app.command(context_settings={**_AS_GIVEN, "help_option_names": []})(robot)
app.command()(stop)
app.command()(switch)
app.add_typer(simulation_app, name="simulation")
app.add_typer(map_app, name="map")
app.add_typer(program_app, name="program")
app.add_typer(mission_app, name="mission")
app.add_typer(events_app, name="events")


@app.command()
def version() -> None:
    """Print the version."""
    typer.echo(__version__)


def main() -> None:
    """Entry point of the command."""
    code = 0
    try:
        app()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    # Without the interpreter's own end: threads of the ORB that are just ending themselves would find it gone, and
    # abort the process.
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)

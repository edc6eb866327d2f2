"""robocorba access: files that give rights to a guarded system."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from robocorba.commands.options import State
from robocorba.commands.reporting import reporting
from robocorba.errors.services import ServiceError
from robocorba.system.printing import line
from robocorba.system.roles import Role
from robocorba.system.settings import Settings, role_file

app = typer.Typer(no_args_is_help=True)


@app.callback()
def access() -> None:
    """Files that give rights to a guarded system."""


@app.command()
def robot(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the robot.")], state: State = None) -> None:
    """Print the file by which one robot takes part, as itself only: it binds its own name, logs on by it, publishes
    events with it as their source, and stores missions that it leads. Remove the file to end that right."""
    with reporting("access"):
        from robocorba.system.supervision.access import Access

        folder = Settings.read(state=state).state
        if not os.access(role_file(folder, Role.ROBOT), os.R_OK):
            raise ServiceError(f"{folder} is not the state folder of a guarded system (`robocorba up --guarded`)")
        line(str(Access.read(folder).robot(name)))

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
from robocorba.system.settings import role_file, state_folder

app = typer.Typer(no_args_is_help=True)


@app.callback()
def access() -> None:
    """Files that give rights to a guarded system."""


@app.command()
def robot(name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the robot.")], state: State = None) -> None:
    """Create the file of a robot's own rights, and print its path. Remove the file to withdraw the rights.

    With it the robot may log on, bind its name, publish events and store missions, under its own name only."""
    with reporting("access"):
        from robocorba.system.supervision.access import Access

        folder = state_folder(state)
        if not os.access(role_file(folder, Role.ROBOT), os.R_OK):
            raise ServiceError(f"{folder} is not the state folder of a guarded system (`robocorba up --guarded`)")
        line(str(Access.read(folder).robot(name)))

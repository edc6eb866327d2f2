"""robocorba robot-model: the robot's model for other programs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.reporting import reporting
from robocorba.errors.base import RoboCorbaError
from robocorba.printing import echo

app = typer.Typer(help="Export the robot's model for other programs.", no_args_is_help=True)


@app.callback()
def robot_model() -> None:
    """Export the robot's model for other programs."""


@app.command()
def urdf(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Where to write; - is the standard output.")],
) -> None:
    """Write the robot as a URDF, for RViz, MuJoCo, Gazebo and others: links, joints, limits, masses, looks."""
    with reporting("robot-model urdf"):
        from robocorba.kinematics.urdf import urdf as document

        text = document()
        if str(file) == "-":
            sys.stdout.write(text)
            return
        try:
            file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise RoboCorbaError(f"can't write {file}: {error.strerror}") from None
        echo(f"{file}\t{len(text)} bytes")

"""robocorba robot-model: the robot's model for other programs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Force
from robocorba.commands.reporting import reporting
from robocorba.system.output_files import write_outputs
from robocorba.system.printing import echo

app = typer.Typer(no_args_is_help=True)


@app.callback()
def robot_model() -> None:
    """Export the robot's model for other programs."""


Output = Annotated[Path, typer.Argument(metavar="FILE", help="File to write; - is the standard output.")]


@app.command()
def urdf(file: Output, force: Force = False) -> None:
    """Write the robot's links, joints, limits, masses and looks as URDF, for RViz, MuJoCo, Gazebo and others."""
    from robocorba.robot.kinematics.urdf import urdf as document

    _write("urdf", document(), file, force)


@app.command()
def srdf(file: Output, force: Force = False) -> None:
    """Write groups of joints, hands and links that always touch as SRDF, which MoveIt reads beside the URDF."""
    from robocorba.robot.kinematics.srdf import srdf as document

    _write("srdf", document(), file, force)


def _write(command: str, text: str, file: Path, force: bool) -> None:
    with reporting(f"robot-model {command}"):
        if str(file) == "-":
            sys.stdout.write(text)
            return
        write_outputs({file: text.encode()}, replace=force)
        echo(f"{file}\t{len(text)} bytes")

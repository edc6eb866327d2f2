"""robocorba backup, restore: save the state of a system in one file, and put it back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Force, State
from robocorba.commands.reporting import reporting
from robocorba.system.printing import echo
from robocorba.system.settings import Settings
from robocorba.system.supervision import backups


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The backup to write, such as monday.tar.gz.")],
    force: Force = False,
    state: State = None,
) -> None:
    """Save map, simulation, event channels, ports and names of a system, which may run, in one file."""
    with reporting("backup"):
        content = backups.back_up(Settings.read(state=state).state, file, overwrite=force)
        echo(f"wrote {file}: {len(content.files)} files, {file.stat().st_size} bytes")


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A backup that `robocorba backup` has written.")],
    state: State = None,
) -> None:
    """Replace the state of a system that does not run by that of a backup; the former state is kept."""
    with reporting("restore"):
        folder = Settings.read(state=state).state
        former = backups.restore(file, folder)
        echo(f"restored {folder}" + (f"; its former state is in {former}" if former else ""))

"""robocorba backup, restore: save the state of a system in one file, and put it back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import Force, State
from robocorba.commands.reporting import reporting
from robocorba.system.printing import echo
from robocorba.system.settings import state_folder
from robocorba.system.supervision import backups


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Backup to write, such as monday.tar.gz.")],
    force: Force = False,
    state: State = None,
) -> None:
    """Save a running or stopped system in one file: map, simulation, event channels, ports and names."""
    with reporting("backup"):
        content = backups.back_up(state_folder(state), file, overwrite=force)
        echo(f"wrote {file}: {len(content.files)} files, {file.stat().st_size} bytes")


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Backup to restore, written by `robocorba backup`.")],
    state: State = None,
) -> None:
    """Restore a stopped system from a backup. Its previous state is moved aside, not deleted."""
    with reporting("restore"):
        folder = state_folder(state)
        former = backups.restore(file, folder)
        echo(f"restored {folder}" + (f"; its previous state is in {former}" if former else ""))

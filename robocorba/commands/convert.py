"""robocorba convert: writes a recording with the messages of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import require_extra
from robocorba.commands.reporting import reporting
from robocorba.printing import echo
from robocorba.simulation.recording import Recording


def convert(
    recording: Annotated[Path, typer.Argument(metavar="IN", help="A recording of `robocorba record`.")],
    file: Annotated[Path, typer.Argument(metavar="OUT", help="The MCAP file with Foxglove's messages.")],
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> None:
    """Write a recording as an MCAP file with Foxglove's messages: scene, frames, poses, robots and log."""
    with reporting("convert"):
        require_extra("foxglove", "foxglove")
        from robocorba.foxglove import files

        files.convert(Recording(recording), file, overwrite=force)
        echo(f"wrote {file}: {file.stat().st_size} bytes")

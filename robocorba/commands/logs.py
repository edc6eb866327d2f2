"""robocorba logs: what a process of a system has logged."""

from __future__ import annotations

import contextlib
from collections import deque
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.options import State
from robocorba.commands.reporting import reporting
from robocorba.commands.waiting import StopSignal
from robocorba.errors.services import ServiceError
from robocorba.system.printing import line
from robocorba.system.settings import state_folder
from robocorba.system.state_folder import StateFolder


def _logs(state: Path | None) -> dict[str, Path]:
    return {file.stem: file for file in sorted(StateFolder(state_folder(state)).logs.glob("*.log"))}


def logs(
    name: Annotated[
        str, typer.Argument(help="Process, as `status` names it.", autocompletion=lambda: list(_logs(None)))
    ],
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Also print new lines, until Ctrl-C.")] = False,
    lines: Annotated[int, typer.Option(metavar="N", min=0, max=100_000, help="Number of lines from the end.")] = 50,
    state: State = None,
) -> None:
    """Print the log of a process."""
    with reporting("logs", OSError), contextlib.ExitStack() as opened:
        files = _logs(state)
        if name not in files:
            raise ServiceError(f"there is no log of {name[:80]!r}; there are {', '.join(files) or 'none'}")
        log = opened.enter_context(files[name].open(encoding="utf-8", errors="replace"))
        last = deque(log, lines)
        for _ in StopSignal().ticks(every_s=0.2) if follow else (0.0,):
            for text in (*last, *log):
                line(text.rstrip("\n"))
            last.clear()
            with contextlib.suppress(FileNotFoundError):  # while it is replaced
                if not files[name].samefile(f"/dev/fd/{log.fileno()}"):
                    log = opened.enter_context(files[name].open(encoding="utf-8", errors="replace"))

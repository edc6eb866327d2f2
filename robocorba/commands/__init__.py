"""The robocorba command: one module a subcommand, loaded when it is asked for."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable
from importlib import import_module

import typer

from robocorba import __version__

#: Of each subcommand: its module here, and what of it is the command; an `app` has subcommands of its own.
SUBCOMMANDS = {
    "up": ("up", "up"),
    "status": ("status", "status"),
    "path": ("path", "path"),
    "watch": ("watch", "watch"),
    "record": ("record", "record"),
    "replay": ("replay", "replay"),
    "robot": ("robot", "robot"),
    "stop": ("robot", "stop"),
    "switch": ("robot", "switch"),
    "simulation": ("simulation", "app"),
    "map": ("map", "app"),
    "program": ("program_run", "app"),
    "mission": ("mission", "app"),
    "events": ("events", "app"),
}
#: All arguments of `robot` are the robot process's, the -- among them too: without interspersed ones it stays.
_AS_GIVEN = {
    "allow_extra_args": True,
    "ignore_unknown_options": True,
    "allow_interspersed_args": False,
    "help_option_names": [],
}


def command(names: Iterable[str] = SUBCOMMANDS) -> typer.Typer:
    """The command with these subcommands; their modules are loaded."""
    app = typer.Typer(
        help="A CORBA-based cooperative mobile robot system.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    for name in names:
        module, what = SUBCOMMANDS[name]
        found = getattr(import_module(f"robocorba.commands.{module}"), what)
        if what == "app":
            app.add_typer(found, name=name)
        else:
            app.command(name, context_settings=_AS_GIVEN if name == "robot" else None)(found)

    @app.command()
    def version() -> None:
        """Print the version."""
        typer.echo(__version__)

    return app


def main() -> None:
    """Entry point of the command."""
    asked = sys.argv[1] if len(sys.argv) > 1 else ""
    code = 0
    try:
        command([asked] if asked in SUBCOMMANDS else SUBCOMMANDS)()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    # Without the interpreter's own end: threads of the ORB that are just ending themselves would find it gone, and
    # abort the process.
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)

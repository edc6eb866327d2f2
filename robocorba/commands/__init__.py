"""The robocorba command: one module per subcommand, loaded on demand.

It may import every room. Read first: this file, options (those that several commands have), up, path, robot."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module

import typer

from robocorba import __version__
from robocorba.system.printing import echo

#: Its name, as help and errors show it.
NAME = "robocorba"
#: Module and attribute of each subcommand; an `app` has further subcommands.
SUBCOMMANDS = {
    "up": ("up", "up"),
    "status": ("status", "status"),
    "backup": ("backup", "backup"),
    "restore": ("backup", "restore"),
    "console": ("console", "console"),
    "path": ("path", "path"),
    "watch": ("watch", "watch"),
    "record": ("record", "record"),
    "replay": ("replay", "replay"),
    "convert": ("convert", "convert"),
    "foxglove": ("foxglove", "foxglove"),
    "ros2": ("ros2", "ros2"),
    "openrtm": ("openrtm", "openrtm"),
    "access": ("access", "app"),
    "robot": ("robot", "robot"),
    "robots": ("robots", "robots"),
    "robot-model": ("robot_model", "app"),
    "stop": ("robot", "stop"),
    "switch": ("robot", "switch"),
    "simulation": ("simulation", "app"),
    "map": ("map", "app"),
    "program": ("program_upload", "app"),
    "mission": ("mission", "app"),
    "events": ("events", "app"),
}
#: Commands whose arguments all go to another process.
FORWARDING = ("robot", "console")
#: Settings of these. Without interspersed arguments, -- is passed on too.
_PASS_THROUGH = {
    "allow_extra_args": True,
    "ignore_unknown_options": True,
    "allow_interspersed_args": False,
    "help_option_names": [],
}


def command(names: Iterable[str] = SUBCOMMANDS) -> typer.Typer:
    """The command with these subcommands; loads their modules."""
    app = typer.Typer(
        help="A CORBA-based cooperative mobile robot system.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    for name in names:
        module, attribute = SUBCOMMANDS[name]
        found = getattr(import_module(f"robocorba.commands.{module}"), attribute)
        if attribute == "app":
            app.add_typer(found, name=name)
        else:
            app.command(name, context_settings=_PASS_THROUGH if name in FORWARDING else None)(found)

    @app.command()
    def version() -> None:
        """Print the version."""
        echo(__version__)

    return app


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command. Never returns. arguments: those of the process by default."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name = arguments[0] if arguments else ""
    code = 0
    try:
        command([name] if name in SUBCOMMANDS else SUBCOMMANDS)(arguments, NAME)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    # Skip the interpreter's finalisation: ORB threads that end during it would abort the process.
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)

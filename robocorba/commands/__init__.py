"""The robocorba command: one module per subcommand, loaded on demand.

It may import every room. Read first: this file, options (those that several commands have), up, path, robot."""

from __future__ import annotations

import signal
import sys

if sys.argv[0].endswith(("/robocorba", "/robocorba/__main__.py")):
    # Ctrl-C ends the command without a traceback; commands that clean up install handlers of their own.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import ast
import contextlib
import os
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from rich.markup import escape
from typer.core import TyperGroup

from robocorba import __version__
from robocorba.commands.options import add_instance, defaults_of
from robocorba.system.defaults_file import InvalidDefaults
from robocorba.system.printing import echo, fail
from robocorba.system.settings import typed_words

#: Its name, as help and errors show it.
NAME = "robocorba"
#: Module and attribute of each subcommand; an `app` has further subcommands, and its help is here.
SUBCOMMANDS: dict[str, tuple[str, ...]] = {
    "up": ("up", "up"),
    "status": ("status", "status"),
    "logs": ("logs", "logs"),
    "doctor": ("doctor", "doctor"),
    "console": ("console", "console"),
    "watch": ("watch", "watch"),
    "simulation": ("simulation", "app", "Pause and pace the simulation, limit its robots and log them off."),
    "access": ("access", "app", "Create files with rights in a guarded system."),
    "backup": ("backup", "backup"),
    "restore": ("backup", "restore"),
    "robot": ("robot", "robot"),
    "robots": ("robots", "robots"),
    "stop": ("robot", "stop"),
    "switch": ("robot", "switch"),
    "program": ("program_upload", "app", "Write, check and run robot programs, which are lists of icons."),
    "robot-model": ("robot_model", "app", "Export the robot's model to other programs."),
    "map": ("map", "app", "Read, write, check and show map files."),
    "samples": ("samples", "app", "List and copy sample maps, programs and fleets."),
    "path": ("path", "path"),
    "mission": ("mission", "app", "Start, watch and abort missions of several robots."),
    "events": ("events", "app", "Inspect event channels, print and publish events, list types."),
    "record": ("record", "record"),
    "replay": ("replay", "replay"),
    "convert": ("convert", "convert"),
    "foxglove": ("foxglove", "foxglove"),
    "ros2": ("ros2", "ros2"),
    "openrtm": ("openrtm", "openrtm"),
}
_HELP = ["-h", "--help"]


class _Commands(TyperGroup):
    """Shows helps as they are written, since rich would take [...] for markup, and flags without a type."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        add_instance(self.commands.values())

    def main(self, *arguments: Any, **settings: Any) -> Any:
        waiting: list[Any] = [self]
        while waiting:
            each = waiting.pop()
            waiting += getattr(each, "commands", {}).values()
            for shown in (each, *each.get_params(typer.Context(each, help_option_names=_HELP))):
                if getattr(shown, "help", None):
                    shown.help = escape(shown.help)
                if getattr(shown, "is_flag", False):
                    shown.metavar = ""
        try:
            return super().main(*arguments, default_map=defaults_of(self, SUBCOMMANDS), **settings)
        except InvalidDefaults as error:
            fail(f"{NAME}: {error}")


def command(names: Iterable[str] = SUBCOMMANDS, *, only_for_help: bool = False) -> typer.Typer:
    """The command with these subcommands; loads their modules. only_for_help: loads none of them, which takes most of
    the time; `--help` lists them, and they do nothing."""
    app = typer.Typer(
        help="Run a CORBA-based cooperative mobile robot system.",
        cls=_Commands,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": _HELP},
    )
    firsts = {"up": "System", "robot": "Robots", "map": "Maps and paths", "mission": "Missions and events"}
    firsts |= {"record": "Recordings", "foxglove": "Bridges"}
    panel = "System"
    for name in names:
        panel = firsts.get(name, panel)
        module, attribute, *text = SUBCOMMANDS[name]
        found = None if only_for_help else getattr(import_module(f"robocorba.commands.{module}"), attribute)
        if attribute == "app":
            app.add_typer(found or typer.Typer(), name=name, help=text[0], rich_help_panel=panel)
        else:
            shown = _docstring(module, attribute) if only_for_help else None
            app.command(name, help=shown, rich_help_panel=panel)(found or (lambda: None))

    @app.command(rich_help_panel="System")
    def version() -> None:
        """Print the version."""
        echo(__version__)

    return app


def _docstring(module: str, function: str) -> str | None:
    """The docstring of a function, from the source of its module."""
    tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8"))
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    return next(ast.get_docstring(node) for node in functions if node.name == function)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command. Never returns. arguments: those of the process by default."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    words = ["version"] if words == ["--version"] else words
    code = 0
    try:
        # While a shell asks for completions there are no arguments.
        first, *others = words or typed_words()[1:] or [""]
        is_list = (not others and first not in SUBCOMMANDS) or first == "version"
        command([first] if first in SUBCOMMANDS else SUBCOMMANDS, only_for_help=is_list)(words, NAME)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    # Skip the interpreter's finalisation: ORB threads that end during it would abort the process.
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)

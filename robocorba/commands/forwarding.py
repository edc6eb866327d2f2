"""Commands that are programs of their own: their options are those of the program."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from inspect import Parameter, Signature
from typing import Annotated, Any

import typer

from robocorba.commands.options import COMPLETIONS
from robocorba.system.settings import AddArgument
from robocorba.system.supervision.launch import module_command


def forwarding(
    module: str, add_arguments: Callable[[AddArgument], None]
) -> Callable[[Callable[[], None]], Callable[..., None]]:
    """Turns a function into a command with a module's arguments, which calls the function and then runs the module in
    place of this process. A module with an argument that is no option also gets what follows `--`."""

    def decorate(prepare: Callable[[], None]) -> Callable[..., None]:
        add, actions = argparse.ArgumentParser().add_argument, list[argparse.Action]()
        add_arguments(lambda *names, **options: actions.append(add(*names, **options)))
        parameters = [
            Parameter(action.dest, Parameter.KEYWORD_ONLY, default=default, annotation=kind)
            for action in actions
            for kind, default in (_kind(action),)
        ]
        if any(not action.option_strings for action in actions):
            rest = Annotated[list[str] | None, typer.Argument(metavar="-- ...", help="Arguments of the adaptor.")]
            parameters.append(Parameter("rest", Parameter.KEYWORD_ONLY, default=None, annotation=rest))

        def run(rest: list[str] | None = None, **given: Any) -> None:
            prepare()
            words = [word for action in actions for word in _words(action, given[action.dest])]
            command = module_command(module, *words, *(["--", *rest] if rest else []))
            os.execv(command[0], command)

        run.__name__, run.__doc__ = prepare.__name__, prepare.__doc__
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        return run

    return decorate


def _kind(action: argparse.Action) -> tuple[Any, object]:
    """Annotation and default of a parameter."""
    help = f"{(action.help or '')[:1].upper()}{(action.help or '')[1:]}."
    if not action.option_strings:
        return Annotated[str, typer.Argument(metavar=str(action.metavar), help=help)], Parameter.empty
    if action.nargs == 0:
        return Annotated[bool, typer.Option(*action.option_strings, help=help)], False
    metavar, completion = action.metavar or "|".join(action.choices or ()), COMPLETIONS.get(action.dest)
    option = typer.Option(*action.option_strings, metavar=str(metavar), help=help, autocompletion=completion)
    return Annotated[str | None, option], None


def _words(action: argparse.Action, value: Any) -> list[str]:
    """A value as words of the command line."""
    if value in (None, False):
        return []
    if not action.option_strings:
        return [value]
    return [action.option_strings[0] if value is True else f"{action.option_strings[0]}={value}"]

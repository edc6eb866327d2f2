"""The robocorba command: one module a subcommand."""

from __future__ import annotations

import typer

from robocorba import __version__
from robocorba.commands.map import app as map_app
from robocorba.commands.path import path
from robocorba.commands.status import status
from robocorba.commands.up import up

app = typer.Typer(
    help="A CORBA-based cooperative mobile robot system.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(up)
app.command()(status)
app.command()(path)
app.add_typer(map_app, name="map")


@app.command()
def version() -> None:
    """Print the version."""
    typer.echo(__version__)


def main() -> None:
    """Entry point of the command."""
    app()

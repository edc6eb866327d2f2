"""Options that several commands have, and the connection to the system that they choose."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

from robocorba.commands.reporting import reporting
from robocorba.corba.orb import Orb
from robocorba.errors.services import ServiceError
from robocorba.settings import Settings

Naming = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="The naming service [ROBOCORBA_NAMING, 127.0.0.1:2809].")
]
State = Annotated[Path | None, typer.Option(metavar="DIR", help="The state folder [ROBOCORBA_STATE].")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def require_extra(name: str, package: str) -> None:
    """Raise ServiceError if a package of an extra of RoboCorba is not installed."""
    if importlib.util.find_spec(package) is None:
        raise ServiceError(f"{package} is not installed: pip install 'robocorba[{name}]'")


@contextlib.contextmanager
def connected(command: str, naming: str | None, options: Mapping[str, str] | None = None) -> Iterator[Orb]:
    """This command's ORB; errors are reported as by `reporting`."""
    with reporting(command), Orb(Settings.read(naming=naming).naming, options=options) as orb:
        yield orb

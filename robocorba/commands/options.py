"""Options that several commands have, and the connection to the system that they choose."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robocorba.commands.reporting import reporting
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_administrator import RemoteAdministrator
from robocorba.system.names import ADMINISTRATOR
from robocorba.system.settings import Settings

if TYPE_CHECKING:
    from robocorba.map_editor.model import Building

Naming = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="The naming service [ROBOCORBA_NAMING, 127.0.0.1:2809].")
]
State = Annotated[Path | None, typer.Option(metavar="DIR", help="The state folder [ROBOCORBA_STATE].")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def served_building(orb: Orb, timeout_s: float = 3.0) -> Building:
    """The map of the running map editor. Raises NotReachable, MapFileError."""
    from robocorba.map_editor import native  # imported here, since they take a moment to load
    from robocorba.map_editor.corba.remote_map import exported

    return native.loads(exported(orb, timeout_s), "the served map")


def administrator(orb: Orb, settings: Settings) -> RemoteAdministrator:
    """The simulation's administrator, for those who may read its state folder. Raises NotReachable."""
    file = settings.state / ADMINISTRATOR
    if not file.exists():
        raise NotReachable(f"no simulation server runs in {settings.state} ({file.name} is missing)")
    return RemoteAdministrator(orb, file)


def only_for(purpose: str, applies: object, context: typer.Context, *parameters: str) -> None:
    """Refuse parameters that are on the command line and have no effect. purpose: what they are for. applies: whether
    the command line asks for that. Raises BadParameter."""
    for parameter in context.command.params if not applies else ():
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if name in parameters and source and source.name == "COMMANDLINE":
            raise typer.BadParameter(f"it has no effect, it is for {purpose}", param_hint=f"'{parameter.opts[-1]}'")


@contextlib.contextmanager
def connected(command: str, naming: str | None, options: Mapping[str, str] | None = None) -> Iterator[Orb]:
    """This command's ORB; errors are reported as by `reporting`."""
    with reporting(command), Orb(Settings.read(naming=naming).naming, options=options) as orb:
        try:
            yield orb
        except NotReachable as error:
            try:
                orb.check_naming()
            except NotReachable:
                setting = "--naming" if naming else "ROBOCORBA_NAMING, or the default"
                raise NotReachable(f"{error}; is `robocorba up` running? Its address is that of {setting}") from None
            raise

"""Options that several commands have, and the connection to the system that they choose.

What is loaded for a call only is imported where it is called, for quick helps and completions."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robocorba.commands.reporting import reporting
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.system.names import ADMINISTRATOR, CHANNELS, ROBOTS
from robocorba.system.settings import Settings

if TYPE_CHECKING:
    from robocorba.map_editor.model import Building
    from robocorba.orb.orb import Orb
    from robocorba.simulation.corba.remote_administrator import RemoteAdministrator

#: Longest that completion of a word waits for an answer of the running system [s].
_COMPLETION_LIMIT_S = 0.5


def _completing(find: Callable[[Orb], Iterable[str]]) -> Callable[[typer.Context], list[str]]:
    """Completes words by what the running system has; by nothing where none answers."""

    def complete(context: typer.Context) -> list[str]:
        from robocorba.orb.orb import Orb

        with contextlib.suppress(RoboCorbaError):
            address = Settings.read(context.params.get("naming")).naming
            with Orb(address, call_timeout_s=_COMPLETION_LIMIT_S) as orb:
                return list(find(orb))
        return []

    return complete


def _floors(orb: Orb) -> Iterable[str]:
    from robocorba.simulation.corba.remote_database import RemoteDatabase

    return RemoteDatabase(orb, _COMPLETION_LIMIT_S).floors()


#: How words of the command line are completed, by what they name.
COMPLETIONS = {
    "robot": _completing(lambda orb: orb.names(ROBOTS, _COMPLETION_LIMIT_S)),
    "channel": _completing(lambda orb: orb.names(CHANNELS, _COMPLETION_LIMIT_S)),
    "floor": _completing(_floors),
}

RobotName = Annotated[
    str, typer.Argument(metavar="ROBOT", help="Name of the robot.", autocompletion=COMPLETIONS["robot"])
]
ChannelName = Annotated[
    str, typer.Argument(metavar="CHANNEL", help="The channel's name.", autocompletion=COMPLETIONS["channel"])
]
Floors = Annotated[
    list[str] | None,
    typer.Option(metavar="F", help="Only this floor; repeatable.", autocompletion=COMPLETIONS["floor"]),
]
Naming = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT", help="The naming service [ROBOCORBA_NAMING, that of the state folder, 127.0.0.1:2809]."
    ),
]
State = Annotated[Path | None, typer.Option(metavar="DIR", help="The state folder [ROBOCORBA_STATE].")]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists with another content.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def served_building(orb: Orb, timeout_s: float = 3.0) -> Building:
    """The map of the running map editor. Raises NotReachable, MapFileError."""
    from robocorba.map_editor import native  # imported here, since they take a moment to load
    from robocorba.map_editor.corba.remote_map import exported

    return native.loads(exported(orb, timeout_s), "the served map")


def administrator(orb: Orb, settings: Settings) -> RemoteAdministrator:
    """The simulation's administrator, for those who may read its state folder. Raises NotReachable."""
    from robocorba.simulation.corba.remote_administrator import RemoteAdministrator

    file = settings.state / ADMINISTRATOR
    if not file.exists():
        raise NotReachable(
            f"no simulation server runs in {settings.state} ({file.name} is missing); is `robocorba up` running, and "
            "with this --state or ROBOCORBA_STATE?"
        )
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
    from robocorba.orb.orb import Orb

    with reporting(command):
        settings = Settings.read(naming=naming)
        with Orb(settings.naming, options=options) as orb:
            try:
                yield orb
            except NotReachable as error:
                try:
                    orb.check_naming()
                except NotReachable:
                    hint = f"is `robocorba up` running? {settings.naming} is from {settings.origin}"
                    raise NotReachable(f"{error}; {hint}") from None
                raise

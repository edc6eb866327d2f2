"""Options that several commands have, and the connection to the system that they choose.

What is loaded for a call only is imported where it is called, for quick helps and completions."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.main import get_command

from robocorba.commands.reporting import reporting
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import ServiceError
from robocorba.system.defaults_file import InvalidDefaults, read_defaults
from robocorba.system.names import ADMINISTRATOR, CHANNELS, ROBOTS
from robocorba.system.roles import Role
from robocorba.system.settings import InvalidSetting, Settings, choose_instance, state_folder

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
    str, typer.Argument(metavar="CHANNEL", help="Name of the channel.", autocompletion=COMPLETIONS["channel"])
]
Floors = Annotated[
    list[str] | None,
    typer.Option(metavar="F", help="Only this floor. Repeatable.", autocompletion=COMPLETIONS["floor"]),
]
Naming = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT|FILE", help="Naming service, or a role's file. Default: that of the running system."
    ),
]
State = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="State folder. Default: ROBOCORBA_STATE, else ~/.local/state/robocorba."),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite a file that has other content.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def served_building(orb: Orb, timeout_s: float = 3.0) -> Building:
    """The map of the running map editor. Raises NotReachable, MapFileError."""
    from robocorba.map_editor import native  # imported here, since they take a moment to load
    from robocorba.map_editor.corba.remote_map import exported

    return native.loads(exported(orb, timeout_s), "the served map")


def administrator(orb: Orb, state: Path | None) -> RemoteAdministrator:
    """The simulation's administrator, for those who may read its state folder. Raises ServiceError."""
    from robocorba.simulation.corba.remote_administrator import RemoteAdministrator

    file = state_folder(state) / ADMINISTRATOR
    if not file.exists():
        raise ServiceError(
            f"no simulation server runs in {file.parent} ({file.name} is missing); is `robocorba up` running, and with "
            "this --instance or --state?"
        )
    return RemoteAdministrator(orb, file)


def is_given(context: typer.Context, parameter: str) -> bool:
    """Whether a parameter is on the command line."""
    source = context.get_parameter_source(parameter)
    return source is not None and source.name == "COMMANDLINE"


def only_for(purpose: str, applies: object, context: typer.Context, *parameters: str) -> None:
    """Refuse parameters that are on the command line and have no effect. purpose: what they are for. applies: whether
    the command line asks for that. Raises BadParameter."""
    for parameter in context.command.params if not applies else ():
        if parameter.name in parameters and is_given(context, parameter.name):
            raise typer.BadParameter(f"it has no effect, it is for {purpose}", param_hint=f"'{parameter.opts[-1]}'")


def defaults_of(commands: Any, names: Iterable[str]) -> dict[str, Any]:
    """Options from robocorba.toml by command and parameter, for those of the commands with these names that are loaded.
    Raises InvalidDefaults."""
    file, members = read_defaults()
    tables = {name: value for name, value in members.items() if name not in ("naming", "state", "instance")}
    return _defaults_in(tables, "robocorba", commands, {*names}, file) if file else {}


def _defaults_in(table: dict[str, Any], words: str, command: Any, names: set[str], file: Path) -> dict[str, Any]:
    """names: of the command's subcommands."""
    options = {option.removeprefix("--"): each.name for each in command.params for option in each.opts}
    found: dict[str, Any] = {}
    for name, value in table.items():
        if names and not isinstance(value, dict):
            raise InvalidDefaults(file, f"{name!r} is no table with options of a command")
        if names and name not in names:
            raise InvalidDefaults(file, f"`{words}` has no command {name!r}")
        if not names and (name not in options or isinstance(value, dict)):
            raise InvalidDefaults(file, f"`{words}` has no option {name!r}")
        if not names:
            found[options[name]] = value
        elif part := command.commands.get(name):
            parts = {*getattr(part, "commands", ())}
            # Without either it is only there for the list of commands.
            found[name] = _defaults_in(value, f"{words} {name}", part, parts, file) if parts or part.params else {}
    return found


def add_instance(commands: Iterable[Any]) -> None:
    """Let each command that takes --naming or --state take --instance, which replaces the defaults of both."""
    app = typer.Typer(add_completion=False)
    app.command()(_with_instance)
    (option,) = get_command(app).params
    waiting = [*commands]
    for each in waiting:
        waiting += getattr(each, "commands", {}).values()
        names = [parameter.name for parameter in each.params]
        if "instance" not in names and (of_system := {"naming", "state"} & {*names}):
            each.params.insert(min(map(names.index, of_system)), option)


def _choose_instance(name: str | None) -> None:
    try:
        if name is not None:
            choose_instance(name)
    except InvalidSetting as error:
        raise typer.BadParameter(error.reason) from None


def _with_instance(
    instance: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="One of several systems on this machine. Default: ROBOCORBA_INSTANCE.",
            callback=_choose_instance,
            expose_value=False,
            is_eager=True,
        ),
    ] = None,
) -> None:
    """Has the option for add_instance."""


@contextlib.contextmanager
def connected(
    command: str,
    naming: str | None,
    options: Mapping[str, str] | None = None,
    state: Path | None = None,
    role: Role = Role.OPERATOR,
) -> Iterator[Orb]:
    """This command's ORB; errors are reported as by `reporting`, with a hint if no naming service answers."""
    from robocorba.orb.orb import Orb

    with reporting(command):
        settings = Settings.read(naming, state, role=role)
        with Orb(settings.naming, options=options) as orb, settings.hinting(orb.check_naming):
            yield orb

"""robocorba program: checks and shows programs, prints their schema.

Modules that need the robot model or the map are imported where they are used, because they take a second to load.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import typer
from rich.text import Text
from rich.tree import Tree

from robocorba.commands.options import Json, connected, is_given
from robocorba.commands.path import parse_place
from robocorba.commands.reporting import reporting
from robocorba.commands.samples import add_new
from robocorba.commands.tables import print_json
from robocorba.errors.robots import InvalidProgram
from robocorba.system.printing import Console, echo, line

if TYPE_CHECKING:
    from robocorba.robot.programs.base_checks import Planner
    from robocorba.robot.programs.icons import Icon
    from robocorba.robot.programs.program import Program

app = typer.Typer(no_args_is_help=True)
add_new(app, "drive.json", "a program with drives on floor L1 of the sample building five-floors")

_FILE = typer.Argument(metavar="FILE", help="Program file, or - for the standard input.")


@app.command()
def check(
    context: typer.Context,
    file: Annotated[File, _FILE],
    at: Annotated[str | None, typer.Option(metavar="FLOOR:X,Y", help="Start point of the robot [m].")] = None,
    heading: Annotated[float | None, typer.Option(metavar="RAD", help="Heading at the start [rad].")] = None,
    building: Annotated[
        str | None, typer.Option(metavar="MAP", help="Check drives on this map: a file or the name of a sample.")
    ] = None,
    naming: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Check drives on the map of the system with this naming service."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a program without running it. Exit code 0 if it is valid, else 1 with every wrong icon and parameter.

    Needs no server. To check drives too, give --building, --naming or --instance."""
    with reporting("program check"):
        place = parse_place(at, "at") if at else None
        is_served = bool(naming) or is_given(context, "instance")
        if building and is_served:
            raise typer.BadParameter("give only one of --building, --naming and --instance")
        program = read("check", file)

        from robocorba.robot.kinematics.inverse import InverseKinematics
        from robocorba.robot.programs.checker import Start
        from robocorba.robot.programs.checker import check as check_program
        from robocorba.robot.programs.program import icons_with_paths

        with _planner(building, naming, is_served) as planner:
            report = check_program(program, InverseKinematics(), planner, Start(place, heading))
        count = sum(1 for _ in icons_with_paths(program))
        if as_json:
            found = {"notes": list(map(str, report.notes)), "findings": list(map(str, report.findings))}
            print_json({"file": str(file), "is_valid": report.is_valid, "icons": count, **found})
        else:
            for note in report.notes:
                line(f"note: {note}")
            for finding in report.findings:
                line(f"{file}: {finding}", err=True)
            if report.is_valid:
                echo(f"{file} is valid: {count} icons")
        if not report.is_valid:
            raise typer.Exit(1)


@app.command()
def show(file: Annotated[File, _FILE]) -> None:
    """Print the icons of a program as a tree."""
    program = read("show", file)
    Console(highlight=False).print(as_tree(program))


@app.command()
def schema() -> None:
    """Print the JSON schema of programs, for editors that validate as you type."""
    from robocorba.robot.programs.program import schema as found

    echo(json.dumps(found(), indent=2))


def read(command: str, file: File) -> Program:
    """The program in a file. Prints the error and exits if it is invalid."""
    from robocorba.robot.programs.program import MAX_BYTES, load, loads

    try:
        if str(file) == "-":
            return loads(typer.get_binary_stream("stdin").read(MAX_BYTES + 1))
        return load(file)
    except OSError as error:
        echo(f"robocorba program {command}: {file}: {error.strerror or error}", err=True)
    except InvalidProgram as error:
        line(f"{file}: {error}", err=True)
    raise typer.Exit(1)


def as_tree(program: Program) -> Tree:
    """A program for the terminal: metres, radians, seconds, as in its file."""
    tree = Tree(Text(f"{program.name} ({program.robot})", "bold"))
    _add_to(tree, program.icons, "icons")
    return tree


def _add_to(tree: Tree, icons: Sequence[Icon], at: str) -> None:
    from robocorba.robot.programs.icons import bodies

    for number, icon in enumerate(icons):
        inside = bodies(icon)
        branch = tree.add(_line(icon, f"{at}[{number}]", {name for name, _ in inside}))
        for name, body in inside:
            if name == "icons":
                _add_to(branch, body, name)
            elif body:
                _add_to(branch.add(Text(name, "italic")), body, name)


def _line(icon: Icon, at: str, omitted: set[str]) -> Text:
    """One line, such as: icons[0] mbase_path floor=L3 x=10 y=4."""
    from robocorba.robot.programs.icons import kind

    text = Text.assemble((f"{at} ", "dim"), (kind(icon), "cyan"))
    for name in icon.__struct_fields__:
        value = getattr(icon, name)
        if value is not None and name not in omitted:
            text.append(f" {name}={_value(value)}")
    return text


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6f}".rstrip("0").rstrip(".")
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()


@contextlib.contextmanager
def _planner(building: str | None, naming: str | None, is_served: bool) -> Iterator[Planner | None]:
    """A planner for a map file, or for the served map; None for neither."""
    if building:
        from robocorba.map_editor.formats import read_map
        from robocorba.map_editor.samples import map_file
        from robocorba.planning.planner import PathPlanner

        yield PathPlanner(read_map(map_file(building)).building)
    elif is_served:
        from robocorba.planning.corba.remote_planner import RemotePlanner

        with connected("program check", naming) as orb:
            yield RemotePlanner(orb)
    else:
        yield None

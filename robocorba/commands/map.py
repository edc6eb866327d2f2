"""robocorba map: read, write, check and show map files.

What reads, writes and draws them is imported where it is used: it takes most of a second
to load, and every other subcommand would wait for it."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from robocorba.errors.base import RoboCorbaError

if TYPE_CHECKING:
    from robocorba.maps.checking import Finding
    from robocorba.maps.formats import Imported
    from robocorba.maps.model import Building

app = typer.Typer(help="Read, write, check and show map files.", no_args_is_help=True)

_FILE = typer.Argument(
    metavar="FILE",
    help="A native map, an Open-RMF building.yaml, a ROS map YAML or a list of them, or the name of a sample building.",
)


class Unknown(str, Enum):
    """What unknown cells of ROS maps become."""

    BLOCKED = "blocked"
    FREE = "free"


class Specks(str, Enum):
    """What happens to specks of ROS maps."""

    KEEP = "keep"
    WALLS = "walls"
    ALL = "all"


class Format(str, Enum):
    """What `export` writes."""

    NATIVE = "native"
    OPENRMF = "openrmf"
    ROS = "ros"
    NAV2 = "nav2"


@app.command("import")
def import_(
    file: Annotated[str, _FILE],
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="The native map file to write.")],
    topology: Annotated[
        bool, typer.Option("--topology", help="Draw roads on every floor without edges, by way of its nodes.")
    ] = False,
    radius: Annotated[float, typer.Option(metavar="M", help="Robot radius for --topology.")] = 0.40,
    unknown: Annotated[
        Unknown, typer.Option("--unknown", help="What unknown cells of ROS maps become.")
    ] = Unknown.BLOCKED,
    specks: Annotated[
        Specks,
        typer.Option(
            "--specks",
            help="Specks of ROS maps, 0.05 m or less: keep them, remove those beside walls, or all.",
        ),
    ] = Specks.WALLS,
) -> None:
    """Turn a foreign map into a native map file and list what was lost on the way."""
    from robocorba.maps import checking, native

    with _reporting_errors("map import"):
        imported = _read(file, unknown, specks)
        building = imported.building
        _print_losses(imported.losses)
        if topology:
            for name in building.floors:
                building = _with_roadmap(building, name, radius)
        _print_warnings(checking.blocked(building))
        native.save(building, output)
        typer.echo(f"wrote {output}: {_summary(building)}")


@app.command()
def export(
    file: Annotated[str, _FILE],
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="The file to write.")],
    format: Annotated[Format, typer.Option("--format", "-f", help="What to write.")],
    resolution: Annotated[float, typer.Option(metavar="M", help="Side of a cell, for ros.")] = 0.05,
    image: Annotated[str, typer.Option(metavar="KIND", help="pgm or png, for ros.")] = "pgm",
) -> None:
    """Write a map in another format and list what that format can't hold."""
    from robocorba.maps.formats import write_map

    with _reporting_errors("map export"):
        building = _read(file).building
        exported = write_map(building, output, format.value, resolution_m=resolution, image=image)
        _print_losses(exported.losses)
        for written in exported.files:
            typer.echo(f"wrote {written}")


@app.command()
def show(
    file: Annotated[str, _FILE],
    picture: Annotated[Path, typer.Option(metavar="FILE", help="The PNG to write.")] = Path("map.png"),
    floor: Annotated[str, typer.Option(metavar="NAME", help="Only this floor.")] = "",
    width: Annotated[int, typer.Option(metavar="PIXELS", min=100, max=8000)] = 1200,
) -> None:
    """Draw the floors of a map as a picture."""
    from robocorba.maps.drawing import draw_building, draw_floor

    with _reporting_errors("map show"):
        building = _read(file).building
        if floor and floor not in building.floors:
            raise typer.BadParameter(f"there is no floor {floor!r}; there are {', '.join(building.floors)}")
        drawn = draw_floor(building, floor, width_px=width) if floor else draw_building(building, width_px=width)
        drawn.save(picture)
        typer.echo(f"wrote {picture}: {_summary(building)}")


@app.command()
def check(
    file: Annotated[str, _FILE],
    radius: Annotated[
        float, typer.Option(metavar="M", min=0.0, max=1000.0, help="Radius of the robot that should get everywhere.")
    ] = 0.40,
) -> None:
    """Check a map: exit code 0 if it can be served as it is, 1 with the file, line and key that is wrong.

    Warnings say what is blocked, and what no robot of the radius reaches."""
    from robocorba.maps.checking import findings

    with _reporting_errors("map check"):
        imported = _read(file)
        _print_losses(imported.losses)
        building = imported.building
        for name, elevator in building.elevators.items():
            if len(elevator.floors()) < 2:
                typer.echo(f"note: elevator {name!r} serves only {', '.join(elevator.floors())}")
        for name, entry in building.floors.items():
            if not entry.topological.edges:
                missing = "edges" if entry.topological.nodes else "topological map"
                typer.echo(f"note: floor {name!r} has no {missing}; `robocorba map import --topology` draws roads")
        warnings = _print_warnings(findings(building, radius))
        verdict = f"can be served: {warnings} warning{'s' * (warnings > 1)}" if warnings else "is sound"
        typer.echo(f"{file} {verdict}: {_summary(building)}")


def _with_roadmap(building: Building, floor: str, radius_m: float) -> Building:
    """The building with roads on a floor that has none, by way of its nodes; says what was drawn."""
    from robocorba.maps.losses import listed
    from robocorba.maps.topology import topological_map

    entry = building.floors[floor]
    places, edges = entry.topological.nodes, entry.topological.edges
    if edges:
        typer.echo(f"{floor}: nothing drawn, it has {len(edges)} edges")
        return building
    drawn = topological_map(building, floor, radius_m, tuple(places.values()))
    joined = {name for edge in drawn.edges.values() for name in (edge.a, edge.b)}
    out_of_reach = [name for name in places if name not in joined]
    typer.echo(
        f"{floor}: drew {len(drawn.nodes) - len(places)} nodes and {len(drawn.edges)} edges"
        + (f", joined {len(places) - len(out_of_reach)} of {len(places)} nodes" if places else "")
        + (f"; not in reach of a robot of radius {radius_m:g} m: {listed(out_of_reach)}" if out_of_reach else "")
    )
    floors = {**building.floors, floor: msgspec.structs.replace(entry, topological=drawn)}
    return msgspec.structs.replace(building, floors=floors)


def _print_warnings(found: Iterable[Finding]) -> int:
    """Print findings, a line for each kind; returns the number of lines."""
    from robocorba.maps.checking import summaries

    lines = summaries(found)
    for line in lines:
        typer.echo(f"warning: {line}")
    return len(lines)


class _reporting_errors:
    """Turns our errors into one line on stderr and exit code 1."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if isinstance(error, RoboCorbaError | OSError):
            typer.echo(f"robocorba {self.command}: {error}", err=True)
            raise typer.Exit(1) from None


def _read(file: str, unknown: Unknown = Unknown.BLOCKED, specks: Specks = Specks.WALLS) -> Imported:
    from robocorba.maps.formats import read_map
    from robocorba.maps.samples import SAMPLES, sample_path

    path = sample_path(file) if file in SAMPLES else file
    return read_map(path, unknown=unknown.value, specks=specks.value)


def _print_losses(losses: tuple[str, ...]) -> None:
    for loss in losses:
        typer.echo(f"lost: {loss}")


def _summary(building: Building) -> str:
    floors = building.floors.values()
    walls = sum(len(entry.geometrical.walls) for entry in floors)
    nodes = sum(len(entry.topological.nodes) for entry in floors)
    edges = sum(len(entry.topological.edges) for entry in floors)
    return f"{len(floors)} floors, {walls} walls, {nodes} nodes, {edges} edges, {len(building.elevators)} elevators"

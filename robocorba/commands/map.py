"""robocorba map: read, write, check and show map files.

Readers, writers and drawing are imported where they are used: they take most of a second to
load, which would delay every other subcommand."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from robocorba.errors.base import RoboCorbaError
from robocorba.spatial.pose import SMARTPAL_RADIUS_M

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
    """Interpretation of unknown cells of ROS maps."""

    BLOCKED = "blocked"
    FREE = "free"


class Specks(str, Enum):
    """Which specks of ROS maps are kept or removed."""

    KEEP = "keep"
    WALLS = "walls"
    ALL = "all"


class Format(str, Enum):
    """Formats of `export`."""

    NATIVE = "native"
    OPENRMF = "openrmf"
    ROS = "ros"
    NAV2 = "nav2"


@app.command("import")
def import_(
    file: Annotated[str, _FILE],
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="The native map file to write.")],
    topology: Annotated[
        bool, typer.Option("--topology", help="Generate the roadmap of every floor without edges, using its nodes.")
    ] = False,
    radius: Annotated[float, typer.Option(metavar="M", help="Robot radius for --topology.")] = SMARTPAL_RADIUS_M,
    unknown: Annotated[
        Unknown, typer.Option("--unknown", help="Whether unknown cells of ROS maps count as blocked or free.")
    ] = Unknown.BLOCKED,
    specks: Annotated[
        Specks,
        typer.Option(
            "--specks",
            help="Specks of ROS maps, 0.05 m or less: keep them, remove those beside walls, or all.",
        ),
    ] = Specks.WALLS,
) -> None:
    """Convert a map of any readable format to a native map file and list the losses."""
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
    format: Annotated[Format, typer.Option("--format", "-f", help="Format to write.")],
    resolution: Annotated[float, typer.Option(metavar="M", help="Side of a cell, for ros.")] = 0.05,
    image: Annotated[str, typer.Option(metavar="KIND", help="pgm or png, for ros.")] = "pgm",
) -> None:
    """Write a map in another format and list the losses."""
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
        float, typer.Option(metavar="M", min=0.0, max=1000.0, help="Radius of the robot that should reach every node.")
    ] = SMARTPAL_RADIUS_M,
) -> None:
    """Check a map: exit code 0 if it can be served, else 1 and the file, line and key of the error.

    Warnings list what is blocked and what a robot of the radius can't reach."""
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
                typer.echo(
                    f"note: floor {name!r} has no {missing}; `robocorba map import --topology` generates a roadmap"
                )
        warnings = _print_warnings(findings(building, radius))
        verdict = f"can be served: {warnings} warning{'s' * (warnings > 1)}" if warnings else "is sound"
        typer.echo(f"{file} {verdict}: {_summary(building)}")


def _with_roadmap(building: Building, floor: str, radius_m: float) -> Building:
    """The building with a generated roadmap on a floor without edges, using its nodes. Prints the result."""
    from robocorba.maps.losses import listed
    from robocorba.maps.topology import topological_map

    entry = building.floors[floor]
    places, edges = entry.topological.nodes, entry.topological.edges
    if edges:
        typer.echo(f"{floor}: roadmap kept, it has {len(edges)} edges")
        return building
    drawn = topological_map(building, floor, radius_m, tuple(places.values()))
    joined = {name for edge in drawn.edges.values() for name in (edge.a, edge.b)}
    unreachable = [name for name in places if name not in joined]
    typer.echo(
        f"{floor}: added {len(drawn.nodes) - len(places)} nodes and {len(drawn.edges)} edges"
        + (f", connected {len(places) - len(unreachable)} of {len(places)} nodes" if places else "")
        + (f"; unreachable for a robot of radius {radius_m:g} m: {listed(unreachable)}" if unreachable else "")
    )
    floors = {**building.floors, floor: msgspec.structs.replace(entry, topological=drawn)}
    return msgspec.structs.replace(building, floors=floors)


def _print_warnings(found: Iterable[Finding]) -> int:
    """Print findings, one line for each kind. Returns the number of lines."""
    from robocorba.maps.checking import summaries

    lines = summaries(found)
    for line in lines:
        typer.echo(f"warning: {line}")
    return len(lines)


class _reporting_errors:
    """Reports errors of RoboCorba and OSError in one line on stderr, with exit code 1."""

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

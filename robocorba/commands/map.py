"""robocorba map: read, write, check and show map files.

What draws and checks is imported where it is used: it takes most of a second to load."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import typer

from robocorba.commands.options import Force, Json, only_for
from robocorba.commands.reporting import reporting
from robocorba.commands.samples import add_new
from robocorba.commands.tables import print_json
from robocorba.map_editor.formats import Imported, export_map, known_formats, read_map, written_formats
from robocorba.map_editor.samples import SAMPLES, map_file
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.system.extras import require_extra
from robocorba.system.logs import one_line
from robocorba.system.printing import echo, line

if TYPE_CHECKING:
    from robocorba.map_editor.model import Building

app = typer.Typer(no_args_is_help=True)
add_new(app, "one-room.yaml", "a map of two rooms with a door, a table, and a road between two places")

_FILE = typer.Argument(
    metavar="FILE",
    autocompletion=lambda: list(SAMPLES),
    help=f"Name of a sample building, or a file: {', '.join(each.mark for each in known_formats() if each.read)}.",
)
_WRITTEN = written_formats()
_WITH_CELLS = " or ".join(name for name, each in _WRITTEN.items() if each.has_cells)


#: What unknown cells of ROS maps count as.
UnknownCells = Literal["blocked", "free"]
#: Which specks of ROS maps are removed: none, those within 0.05 m of larger regions, or all. A speck is an occupied or
#: unknown region of at most 0.05 m side.
Specks = Literal["keep", "walls", "all"]


@app.command("import")
def import_(
    context: typer.Context,
    file: Annotated[str, _FILE],
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="Map file to write.")],
    topology: Annotated[
        bool, typer.Option("--topology", help="Generate a topological map for floors without edges.")
    ] = False,
    radius: Annotated[
        float, typer.Option(metavar="M", min=0.0, max=1000.0, help="Radius of robots that use the generated map [m].")
    ] = SMARTPAL_RADIUS_M,
    unknown: Annotated[
        UnknownCells, typer.Option("--unknown", help="How to read unknown cells of ROS maps: blocked or free.")
    ] = "blocked",
    specks: Annotated[
        Specks, typer.Option("--specks", help="Small spots in ROS maps to remove: none (keep), those at walls, or all.")
    ] = "walls",
    force: Force = False,
) -> None:
    """Convert a map of another format to a RoboCorba map, and list what the conversion changes."""
    from robocorba.map_editor import checking, native
    from robocorba.system.output_files import write_outputs

    only_for("--topology", topology, context, "radius")
    with reporting("map import", OSError):
        imported = _read(file, unknown, specks)
        of_cells = any(each.has_cells for each in known_formats() if each.name == imported.format)
        only_for("ROS maps", of_cells, context, "unknown", "specks")
        building = imported.building
        _print_each("import", imported.losses)
        if topology:
            for name in building.floors:
                building = _with_topological_map(building, name, radius)
        _print_each("warning", checking.summaries(checking.blocked(building)))
        write_outputs({output: native.dumps(building).encode()}, [map_file(file)], replace=force)
        echo(f"wrote {output}: {_summary(building)}")


@app.command()
def export(
    context: typer.Context,
    file: Annotated[str, _FILE],
    output: Annotated[Path, typer.Argument(metavar="OUTPUT", help="File to write.")],
    format_name: Annotated[
        str,
        typer.Option(
            "--format",
            "-f",
            metavar="|".join(_WRITTEN),
            help="; ".join(f"{name}: {each.title}" for name, each in _WRITTEN.items()) + ".",
        ),
    ],
    resolution: Annotated[float, typer.Option(metavar="M", help=f"Cell size [m], with --format {_WITH_CELLS}.")] = 0.05,
    image: Annotated[
        str, typer.Option(metavar="KIND", help=f"Format of pictures, pgm or png, for {_WITH_CELLS}.")
    ] = "pgm",
    force: Force = False,
) -> None:
    """Write a map in another format, and list what the conversion changes."""
    from robocorba.system.output_files import write_outputs

    format = _WRITTEN.get(format_name)
    if format is None:
        raise typer.BadParameter(f"{format_name!r} is not one of {', '.join(_WRITTEN)}", param_hint="'--format'")
    only_for(f"--format {_WITH_CELLS}", format.has_cells, context, "resolution", "image")
    with reporting("map export", OSError):
        building = _read(file).building
        exported = export_map(building, output, format.name, resolution_m=resolution, image=image)
        write_outputs(exported.files, [map_file(file)], replace=force)
        _print_each("export", exported.losses)
        for written in exported.files:
            echo(f"wrote {written}")


@app.command()
def show(
    file: Annotated[str, _FILE],
    picture: Annotated[Path, typer.Option(metavar="FILE", help="Picture to write, replacing it.")] = Path("map.png"),
    floor: Annotated[str, typer.Option(metavar="NAME", help="Only this floor.")] = "",
    width: Annotated[int, typer.Option(metavar="PIXELS", min=200, max=8000, help="Width of the picture.")] = 1200,
) -> None:
    """Draw the floors of a map as a picture."""
    with reporting("map show", OSError):
        require_extra("films", "pictures")
        from robocorba.map_editor.drawing import draw_building, draw_floor
        from robocorba.map_editor.pictures import save_picture

        building = _read(file).building
        if floor and floor not in building.floors:
            raise typer.BadParameter(f"there is no floor {floor!r}; there are {one_line(', '.join(building.floors))}")
        drawn = draw_floor(building, floor, width_px=width) if floor else draw_building(building, width_px=width)
        save_picture(drawn, picture, [map_file(file)])
        echo(f"wrote {picture}: {_summary(building)}")


@app.command()
def check(
    file: Annotated[str, _FILE],
    radius: Annotated[
        float,
        typer.Option(metavar="M", min=0.0, max=1000.0, help="Radius of the robot that should reach every node [m]."),
    ] = SMARTPAL_RADIUS_M,
    json: Json = False,
) -> None:
    """Check a map. Exit code 0 if it is valid, else 1 with the file, line and key of the error.

    Warnings list what is blocked and what a robot of --radius can't reach. A map with warnings is valid."""
    from robocorba.map_editor.checking import findings, summaries

    with reporting("map check", OSError):
        imported = _read(file)
        building, warnings = imported.building, summaries(findings(imported.building, radius))
        notes = [
            f"elevator {name!r} serves only {', '.join(elevator.floors())}"
            for name, elevator in building.elevators.items()
            if len(elevator.floors()) < 2
        ]
        for name, entry in building.floors.items():
            if not entry.topological.edges:
                missing = "edges" if entry.topological.nodes else "nodes and edges"
                notes.append(f"floor {name!r} has no {missing}; `robocorba map import --topology` generates them")
        if json:
            found = {"imported": imported.losses, "notes": notes, "warnings": warnings}
            print_json({"file": file, "is_valid": True, **_counts(building), **found})
            return
        _print_each("import", imported.losses)
        _print_each("note", notes)
        _print_each("warning", warnings)
        counted = f", {len(warnings)} warning{'s' * (len(warnings) > 1)}" if warnings else ""
        echo(f"{file} is valid{counted}: {_summary(building)}")


def _with_topological_map(building: Building, floor: str, radius_m: float) -> Building:
    """The building; a floor without edges gets a topological map, with its present nodes. Prints the result."""
    entry = building.floors[floor]
    nodes, edges = entry.topological.nodes, entry.topological.edges
    if edges:
        line(f"{floor}: topological map kept, it has {len(edges)} edges")
        return building
    require_extra("maps", "generated topological maps")
    from robocorba.map_editor.losses import listed
    from robocorba.map_editor.topology import topological_map

    generated = topological_map(building, floor, radius_m, tuple(nodes.values()))
    connected = {name for edge in generated.edges.values() for name in (edge.a, edge.b)}
    unreachable = [name for name in nodes if name not in connected]
    echo(
        f"{floor}: added {len(generated.nodes) - len(nodes)} nodes and {len(generated.edges)} edges"
        + (f", connected {len(nodes) - len(unreachable)} of {len(nodes)} nodes" if nodes else "")
        + (f"; unreachable for a robot of radius {radius_m:g} m: {listed(unreachable)}" if unreachable else "")
    )
    floors = {**building.floors, floor: msgspec.structs.replace(entry, topological=generated)}
    return msgspec.structs.replace(building, floors=floors)


def _read(file: str, unknown: UnknownCells = "blocked", specks: Specks = "walls") -> Imported:
    return read_map(map_file(file), unknown=unknown, specks=specks)


def _print_each(kind: str, sentences: Iterable[str]) -> None:
    for sentence in sentences:
        line(f"{kind}: {sentence}")


def _counts(building: Building) -> dict[str, int]:
    floors = building.floors.values()
    return {
        "floors": len(floors),
        "walls": sum(len(entry.geometrical.walls) for entry in floors),
        "nodes": sum(len(entry.topological.nodes) for entry in floors),
        "edges": sum(len(entry.topological.edges) for entry in floors),
        "elevators": len(building.elevators),
    }


def _summary(building: Building) -> str:
    return ", ".join(f"{count} {what}" for what, count in _counts(building).items())

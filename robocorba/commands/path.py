"""robocorba path: queries a running path planning agent, prints the path as a table, draws it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from enum import Enum
from pathlib import Path as File
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from robocorba.commands.options import Naming, connected, served_building
from robocorba.commands.reporting import reporting
from robocorba.errors.paths import InvalidRequest
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
from robocorba.planning.corba.remote_planner import RemotePlanner
from robocorba.planning.request import (
    MAX_ALTERNATIVES,
    SMARTPAL_SPEED_M_S,
    Criterion,
    Path,
    PathRequest,
    Place,
    RouteMode,
)
from robocorba.system.extras import require_extra
from robocorba.system.printing import Console, echo


class Mode(str, Enum):
    """Route mode."""

    SMOOTHED = "smoothed"
    TOPOLOGICAL = "topological"
    GEOMETRIC = "geometric"


def path(
    start: Annotated[str, typer.Argument(metavar="FLOOR:X,Y", help="Start; coordinates in metres.")],
    goal: Annotated[str, typer.Argument(metavar="FLOOR:X,Y", help="Goal; coordinates in metres.")],
    picture: Annotated[
        File | None,
        typer.Option(metavar="FILE", help="Draw the floors of the path into this PNG, in place of an earlier one."),
    ] = None,
    mode: Annotated[
        Mode, typer.Option(help="Along the topological map with corners cut, along it exactly, or through free space.")
    ] = (Mode.SMOOTHED),
    fastest: Annotated[bool, typer.Option("--time", help="Minimize the duration instead of the distance.")] = False,
    radius: Annotated[float, typer.Option(metavar="M", help="Radius of the robot in metres.")] = SMARTPAL_RADIUS_M,
    speed: Annotated[float, typer.Option(metavar="M/S", help="Speed of the robot in m/s.")] = SMARTPAL_SPEED_M_S,
    avoid: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="An elevator, or an area as FLOOR/NAME, to avoid; repeatable."),
    ] = None,
    graph: Annotated[
        str, typer.Option(metavar="NAME", help="Only edges of this navigation graph, and edges that name no graph.")
    ] = "",
    alternatives: Annotated[
        int, typer.Option(metavar="N", min=0, max=MAX_ALTERNATIVES, help="Number of alternative paths.")
    ] = 0,
    naming: Naming = None,
) -> None:
    """Plan a path with the running path planning agent."""
    with reporting("path"):
        wanted = PathRequest(
            parse_place(start, "start"),
            parse_place(goal, "goal"),
            radius=radius,
            speed=speed,
            mode=RouteMode[mode.name],
            best=Criterion.SHORTEST_TIME if fastest else Criterion.SHORTEST_DISTANCE,
            avoid_elevators=frozenset(name for name in avoid or () if "/" not in name),
            avoid_areas=tuple((name.partition("/")[0], name.partition("/")[2]) for name in avoid or () if "/" in name),
            graph=graph,
            alternatives=alternatives,
        )
    with connected("path", naming) as orb:
        found = RemotePlanner(orb, resolve_timeout_s=3.0, call_timeout_s=10.0).paths(wanted)
        for one in found:
            Console().print(as_table(one))
        if picture:
            draw(served_building(orb), found[0], picture)
            echo(f"drew {picture}")


def parse_place(text: str, which: str) -> Place:
    """The place FLOOR:X,Y. Raises InvalidRequest."""
    match = re.fullmatch(r"(.+):([^,:]+),([^,:]+)", text)
    try:
        if match:
            return Place(match[1], float(match[2]), float(match[3]))
    except ValueError:
        pass
    raise InvalidRequest(which, f"{text[:80]!r} is not of the form FLOOR:X,Y, such as L1:3,4")


def as_table(found: Path) -> Table:
    """A path for the terminal: metres, degrees, seconds."""
    summary = f"{found.distance:.2f} m, {found.duration:.1f} s, {len(found.rows)} points"
    table = Table(title=f"{summary} (map version {found.version})")
    for column in ("kind", "node", "floor", "x [m]", "y [m]", "heading [°]", "distance [m]", "time [s]"):
        table.add_column(escape(column), justify="right" if "[" in column else "left")
    for point in found.points:
        kind = point.kind.name.lower().replace("_", " ")
        table.add_row(
            escape(f"{kind} {point.elevator}".strip()),  # a name may be any text, such as [/]
            escape(point.node),
            escape(point.floor),
            f"{point.x:.2f}",
            f"{point.y:.2f}",
            f"{math.degrees(point.heading):.0f}",
            f"{point.distance:.2f}",
            f"{point.time:.1f}",
        )
    return table


def draw(building: Building, found: Path, file: File) -> None:
    """Draw every floor of a path into one PNG. Raises ServiceError without the extra films."""
    require_extra("films", "pictures")
    from robocorba.map_editor.drawing import draw_building
    from robocorba.map_editor.pictures import save_picture

    crossed = {point.floor for point in found.points}
    floors = {name: entry for name, entry in building.floors.items() if name in crossed}
    paths = {floor: marks(found, floor) for floor in floors}
    save_picture(draw_building(Building(building.name, floors, building.elevators), paths=paths), file)


def marks(found: Path, floor: str) -> Sequence:
    """The points of a path on one floor, for the drawing."""
    from robocorba.map_editor.drawing import PathMark

    return [
        PathMark(point.x, point.y, point.kind.name.lower(), point.elevator or point.node)
        for point in found.points
        if point.floor == floor
    ]

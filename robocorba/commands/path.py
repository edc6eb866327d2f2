"""robocorba path: queries a running path planning agent, prints the path as a table, draws it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from robocorba.commands.options import Json, Naming, connected, served_building
from robocorba.commands.reporting import reporting
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.errors.paths import InvalidRequest
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M
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
from robocorba.system.printing import echo

if TYPE_CHECKING:
    from robocorba.map_editor.model import Building


def path(
    start: Annotated[str, typer.Argument(metavar="FLOOR:X,Y", help="Start point [m].")],
    goal: Annotated[str, typer.Argument(metavar="FLOOR:X,Y", help="Goal point [m].")],
    picture: Annotated[
        File | None, typer.Option(metavar="FILE", help="Draw the path in this PNG file, replacing it.")
    ] = None,
    mode: Annotated[
        Literal["smoothed", "topological", "geometric"],
        typer.Option(help="How to drive: along roads with corners cut, exactly along roads, or in straight lines."),
    ] = "smoothed",
    fastest: Annotated[bool, typer.Option("--time", help="Minimize time instead of distance.")] = False,
    radius: Annotated[float, typer.Option(metavar="M", help="Radius of the robot [m].")] = SMARTPAL_RADIUS_M,
    speed: Annotated[float, typer.Option(metavar="M/S", help="Speed of the robot [m/s].")] = SMARTPAL_SPEED_M_S,
    avoid: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Elevator to avoid, or area as FLOOR/AREA. Repeatable.")
    ] = None,
    graph: Annotated[
        str, typer.Option(metavar="NAME", help="Use only edges of this navigation graph, and those of no graph.")
    ] = "",
    alternatives: Annotated[
        int, typer.Option(metavar="N", min=0, max=MAX_ALTERNATIVES, help="Number of further paths to offer.")
    ] = 0,
    json: Json = False,
    naming: Naming = None,
) -> None:
    """Plan a path with the running path planning agent."""
    with reporting("path"):
        wanted = PathRequest(
            parse_place(start, "start"),
            parse_place(goal, "goal"),
            radius=radius,
            speed=speed,
            mode=RouteMode[mode.upper()],
            best=Criterion.SHORTEST_TIME if fastest else Criterion.SHORTEST_DISTANCE,
            avoid_elevators=frozenset(name for name in avoid or () if "/" not in name),
            avoid_areas=tuple((name.partition("/")[0], name.partition("/")[2]) for name in avoid or () if "/" in name),
            graph=graph,
            alternatives=alternatives,
        )
    from robocorba.planning.corba.remote_planner import RemotePlanner

    with connected("path", naming) as orb:
        found = RemotePlanner(orb, resolve_timeout_s=3.0, call_timeout_s=10.0).paths(wanted)
        if picture:
            draw(served_building(orb), found[0], picture)
        if json:
            print_json([as_json(each) for each in found])
            return
        show(*map(sheet_of, found))
        if picture:
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


def sheet_of(found: Path) -> Sheet:
    """A path as text: metres, degrees, seconds."""
    titles = ("kind", "node", "floor", "x [m]", "y [m]", "heading [°]", "distance [m]", "time [s]")
    rows = [
        (
            f"{point.kind.name.lower().replace('_', ' ')} {point.elevator}".strip(),
            *(point.node, point.floor, f"{point.x:.2f}", f"{point.y:.2f}", f"{math.degrees(point.heading):.0f}"),
            *(f"{point.distance:.2f}", f"{point.time:.1f}"),
        )
        for point in found.points
    ]
    summary = f"{found.distance:.2f} m, {found.duration:.1f} s, {len(rows)} points (map version {found.version})"
    return Sheet(titles, rows, spare=("heading [°]", "time [s]"), title=summary)


def as_json(found: Path) -> dict[str, Any]:
    """A path in m, rad and s."""
    points = [{**each._asdict(), "kind": each.kind.name.lower()} for each in found.points]
    return {"distance": found.distance, "duration": found.duration, "map_version": found.version, "points": points}


def draw(building: Building, found: Path, file: File) -> None:
    """Draw every floor of a path into one PNG. Raises ServiceError without the extra films."""
    require_extra("films", "pictures")
    from robocorba.map_editor.drawing import draw_building
    from robocorba.map_editor.model import Building
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

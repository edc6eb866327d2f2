"""Pictures of floors: walls, doors, objects, areas, path edges, elevators and a path.

Several threads may draw simultaneously.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from matplotlib.collections import PolyCollection
from matplotlib.patches import Arc
from PIL import Image
from shapely import Polygon

from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor import geometry
from robocorba.map_editor.model import Building, Door, DoorKind, Elevator, FloorMap, PathEdge
from robocorba.map_editor.sheet import DPI, FOOT_PX, GROUND, HEAD_PX, INK, MAX_PIXELS, Frame, Sheet
from robocorba.map_editor.spatial.pose import XY

WALL, FIXED, MOVABLE = "#1f2430", "#b9b2a6", "#5b8fd6"
DOOR, LOCKED = "#2f9e5a", "#c0392b"
NODE, EDGE, ONE_WAY = "#6b5ca5", "#a99fd0", "#d07a1f"
CABIN, CLOSED_SHAFT = "#f2c14e", "#d9d9d9"
PATH = "#d6176e"
TINTS = ("#eaf2fb", "#eef7ea", "#fdf3e3", "#f7ecf5", "#e8f6f5", "#f6f3e6")
#: Colour and text of each legend entry; ~ marks those drawn as a thin line.
LEGEND = (
    (FIXED, "object"),
    (MOVABLE, "movable object"),
    (DOOR, "~door"),
    (LOCKED, "~locked"),
    (EDGE, "~road"),
    (ONE_WAY, "~one way"),
    (CABIN, "elevator"),
    (CLOSED_SHAFT, "not served"),
    (PATH, "~path"),
)


class PathMark(NamedTuple):
    """A point of a path on a drawn floor [m], its kind, and the label to write beside it.

    `kind` is start, node, waypoint, elevator_entry, elevator_exit or goal. No line is drawn
    from an elevator_entry to an elevator_exit: the robot leaves the floor there."""

    x: float
    y: float
    kind: str = "waypoint"
    label: str = ""


#: Marker, colour, size [pixels] and text by kind. Other kinds have neither. What has a text is always labelled.
_MARKS: dict[str, tuple[str, str, float, str]] = {
    "start": ("o", "#12805c", 13, "start"),
    "goal": ("*", PATH, 20, "goal"),
    "elevator_entry": ("^", "#b36b00", 13, "enters"),
    "elevator_exit": ("v", "#b36b00", 13, "leaves"),
    "node": ("o", PATH, 5, ""),
}


def draw_floor(
    building: Building, floor: str, *, path: Sequence[PathMark] | None = None, width_px: int = 1200
) -> Image.Image:
    """A floor as an RGB picture `width_px` wide, +y up; its height follows from the floor (at most MAX_PIXELS).

    `path` holds the marks of a path on this floor, in order. The title is the building's and the floor's name.
    Raises UnknownFloor, and ValueError for a width outside 200 to MAX_PIXELS."""
    if floor not in building.floors:
        raise UnknownFloor("picture", floor, list(building.floors))
    if not 200 <= width_px <= MAX_PIXELS:
        raise ValueError(f"width_px must be 200 to {MAX_PIXELS}, not {width_px}")
    path, entry = path or (), building.floors[floor]
    sheet = Sheet(Frame(building, floor, width_px, titled=True))
    # From bottom to top. Names come last and never overlap.
    draw_geometrical_map(sheet, building, floor)
    nodes = {name: node.at for name, node in entry.topological.nodes.items()}
    edges = entry.topological.edges.values()
    _draw_edges(sheet, nodes, [edge for edge in edges if {edge.a, edge.b} <= nodes.keys()])
    _draw_path(sheet, path)
    draw_title_and_legend(sheet, f"{building.name} · {floor}")
    for point in [*nodes.values(), *((mark.x, mark.y) for mark in path)]:
        sheet.keep_clear(point)
    write_labels(sheet, entry, building.elevators_through(floor), path)
    return sheet.image()


def draw_building(
    building: Building, *, paths: Mapping[str, Sequence[PathMark]] | None = None, width_px: int = 1200
) -> Image.Image:
    """All floors in one RGB picture, the highest first. `paths` holds marks by floor.

    Raises UnknownFloor for a path on an unknown floor, and ValueError as draw_floor does."""
    for floor in paths or {}:
        if floor not in building.floors:
            raise UnknownFloor("path", floor, list(building.floors))
    pictures = [
        draw_floor(building, floor, path=(paths or {}).get(floor), width_px=width_px)
        for floor in reversed(building.floors)
    ]
    sheet = Image.new("RGB", (width_px, max(1, sum(picture.height for picture in pictures))), GROUND)
    top = 0
    for picture in pictures:
        sheet.paste(picture, (0, top))
        top += picture.height
    return sheet


def draw_geometrical_map(sheet: Sheet, building: Building, floor: str) -> None:
    """Draw areas, walls, objects, doors and elevators without names."""
    plan = building.floors[floor].geometrical
    _draw_areas(sheet, [(area.polygon, area.subnet) for area in plan.areas.values()])
    _draw_obstacles(sheet, building, floor)
    for door in plan.doors.values():
        _draw_door(sheet, door)
    for elevator in building.elevators_through(floor):
        _draw_elevator(sheet, elevator, floor)


def write_labels(sheet: Sheet, entry: FloorMap, elevators: Iterable[Elevator], path: Sequence[PathMark]) -> None:
    """Write names, the most important first. Names without room are omitted."""
    plan = entry.geometrical
    for mark in path:
        word = _MARKS[mark.kind][3] if mark.kind in _MARKS else ""
        text = " ".join(filter(None, [word, mark.label]))
        sheet.label(text, (mark.x, mark.y), colour=PATH, bold=True, apart=10, must=bool(word))
    for elevator in elevators:
        sheet.label(elevator.name, elevator.at, bold=True, apart=9)
    for area in plan.areas.values():
        name = f"{area.name} ({area.subnet})" if area.subnet else area.name
        sheet.label(name, _label_position(area.polygon), bold=True, apart=0, scale=1.15, colour="#5c6675")
    for map_object in plan.objects.values():
        sheet.label(map_object.name, map_object.at, apart=0, within=geometry.object_geometry(map_object).bounds)
    for node in entry.topological.nodes.values():
        if node.name not in plan.areas and not node.elevator:
            sheet.label(node.name, node.at, colour=NODE, apart=5, scale=0.9)


def _draw_areas(sheet: Sheet, areas: list[tuple[Sequence[XY], str]]) -> None:
    subnets = list(dict.fromkeys(subnet for _, subnet in areas if subnet))
    tints = [TINTS[(subnets.index(subnet) if subnet else i) % len(TINTS)] for i, (_, subnet) in enumerate(areas)]
    sheet.axes.add_collection(PolyCollection([polygon for polygon, _ in areas], facecolors=tints, zorder=1))


def _draw_obstacles(sheet: Sheet, building: Building, floor: str) -> None:
    objects = building.floors[floor].geometrical.objects
    for item in geometry.obstacles(building, floor):
        if item.kind == "object":
            colour = MOVABLE if objects[item.name].movable else FIXED
            if isinstance(item.geometry, Polygon):
                sheet.fill(item.geometry.exterior.coords, colour, edge=INK, width_px=0.6, zorder=4)
            else:
                sheet.lines([item.geometry.coords], colour, 3, zorder=4)
        elif item.kind in ("wall", "floor"):
            lines = [part.coords for part in shapely.get_parts(shapely.node(item.geometry))]
            sheet.lines(lines, WALL, sheet.px(0.1, 2, 5) if item.kind == "wall" else 1.2, zorder=6)


def _draw_door(sheet: Sheet, door: Door) -> None:
    (ax, ay), (bx, by) = door.a, door.b
    width, turn = math.hypot(bx - ax, by - ay), math.degrees(math.atan2(by - ay, bx - ax))
    thick = sheet.px(0.09, 2, 4)
    if door.locked:
        sheet.lines([(door.a, door.b)], LOCKED, thick + 1, zorder=7)
    elif door.kind is DoorKind.OPENING:
        sheet.lines([(door.a, door.b)], DOOR, thick * 0.7, zorder=7, linestyle=(0, (1, 2)))
    elif door.kind in (DoorKind.HINGED, DoorKind.DOUBLE_HINGED):
        halves = 2 if door.kind is DoorKind.DOUBLE_HINGED else 1
        leaf, out = width / halves, math.radians(turn + 90)
        for (x, y), first in (((ax, ay), turn), ((bx, by), turn + 90))[:halves]:
            tip = (x + leaf * math.cos(out), y + leaf * math.sin(out))
            sheet.lines([((x, y), tip)], DOOR, thick * 0.6, zorder=7)
            sheet.axes.add_patch(
                Arc((x, y), 2 * leaf, 2 * leaf, angle=first, theta2=90, edgecolor=DOOR, linewidth=0.9, zorder=7)
            )
    else:
        sheet.lines([(door.a, door.b)], DOOR, thick, zorder=7)


def _draw_elevator(sheet: Sheet, elevator: Elevator, floor: str) -> None:
    corners = list(geometry.shaft_polygon(elevator).exterior.coords)
    served = floor in elevator.floors()
    sheet.fill(corners, CABIN if served else CLOSED_SHAFT, edge=WALL, width_px=sheet.px(0.1, 1.5, 4), zorder=6)
    if not served:
        sheet.lines([(corners[0], corners[2]), (corners[1], corners[3])], WALL, 0.8, zorder=6)
    for door in elevator.doors:
        if door.floor == floor:
            line = geometry.landing_line(elevator, door).coords
            sheet.lines([line], GROUND, sheet.px(0.2, 4, 8), zorder=6.5)
            sheet.lines([line], DOOR, sheet.px(0.09, 2, 4), zorder=7)


def _draw_edges(sheet: Sheet, nodes: Mapping[str, XY], edges: Sequence[PathEdge]) -> None:
    for one_way in (False, True):
        lines = [(nodes[edge.a], nodes[edge.b]) for edge in edges if edge.one_way is one_way]
        sheet.lines(lines, ONE_WAY if one_way else EDGE, sheet.px(0.05, 1.2, 2.2), zorder=8)
        if one_way:
            for a, b in lines:
                sheet.arrow(a, b, ONE_WAY, sheet.px(0.35, 8, 13), zorder=8)
    if nodes:
        x, y = np.array(list(nodes.values())).T
        size = sheet.px(0.22, 4, 7)
        sheet.axes.plot(x, y, "o", color=NODE, markersize=size * 72 / DPI, markeredgewidth=0, zorder=9)


def _draw_path(sheet: Sheet, path: Sequence[PathMark]) -> None:
    legs = [(a, b) for a, b in pairwise(path) if (a.kind, b.kind) != ("elevator_entry", "elevator_exit")]
    for a, b in legs:
        sheet.lines([((a.x, a.y), (b.x, b.y))], PATH, sheet.px(0.12, 3, 5), zorder=10)
    for a, b in legs:
        if math.dist((a.x, a.y), (b.x, b.y)) * sheet.frame.scale > 40:
            sheet.arrow((a.x, a.y), (b.x, b.y), PATH, sheet.px(0.6, 14, 22), zorder=10)
    for mark in path:
        if mark.kind in _MARKS:
            shape, colour, size, _ = _MARKS[mark.kind]
            marker: dict[str, Any] = {"markersize": size, "markeredgecolor": GROUND, "markeredgewidth": 1.2}
            sheet.axes.plot(mark.x, mark.y, shape, color=colour, zorder=11, **marker)


def draw_title_and_legend(sheet: Sheet, title: str, legend: Sequence[tuple[str, str]] = LEGEND) -> None:
    """Title, scale bar and legend."""
    frame, px = sheet.frame, 1 / sheet.frame.scale
    sheet.lines([((frame.x0, frame.y0 + FOOT_PX * px), (frame.x1, frame.y0 + FOOT_PX * px))], "#e3e3e3", 1, zorder=2)
    if title:
        sheet.text(title[:120], frame.x0 + 14 * px, frame.y1 - HEAD_PX / 2 * px, 13, ha="left", weight="bold")
    length = _round_length(frame.width / frame.scale / 6)
    x, y = frame.x0 + 14 * px, frame.y0 + 12 * px
    sheet.lines([((x, y), (x + length, y))], INK, 3, zorder=12)
    sheet.text(f"{length:g} m", x + length / 2, y + 11 * px, 8)
    x = frame.x0 + max(frame.width * 0.24, 150) * px
    for colour, text in legend:
        if x + 100 * px > frame.x1:
            break
        sheet.lines([((x, y + 5 * px), (x + 16 * px, y + 5 * px))], colour, 7 if text[0] != "~" else 2.5, zorder=12)
        sheet.text(text.lstrip("~"), x + 22 * px, y + 4.5 * px, 8, ha="left")
        x += (44 + 6.2 * len(text)) * px


def _label_position(polygon: Sequence[XY]) -> XY:
    """Where to write a polygon's name: above its middle, so that edges and objects stay readable."""
    area = Polygon(polygon)
    x0, y0, x1, y1 = area.bounds
    x, y = (x0 + x1) / 2, y0 + 0.62 * (y1 - y0)
    if not area.is_valid or area.contains(shapely.Point(x, y)):
        return x, y
    inside = area.representative_point()
    return inside.x, inside.y


def _round_length(about: float) -> float:
    """1, 2 or 5 times a power of ten, at most `about`."""
    power = 10.0 ** math.floor(math.log10(about))
    return power * max(step for step in (1, 2, 5) if step * power <= about * (1 + 1e-9))

"""The building, its elevators, objects and robots as entities of a Foxglove scene.

Frames: `map` is the building's; `NAME/base_link` a robot's, with a frame for each of its links, such as `NAME/trunk`;
`object/NAME` that of a movable object; `elevator/NAME` that of a cabin."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import shapely
from foxglove.messages import KeyValuePair, SceneEntity, TextPrimitive
from shapely import Polygon

from robocorba.bridges.foxglove.shapes import FOREVER, Primitives, colour, pose, timestamp
from robocorba.map_editor.geometry import obstacles, shaft_polygon
from robocorba.map_editor.model import Building, Elevator
from robocorba.map_editor.movable import movables
from robocorba.map_editor.spatial.floor_update import Body, BodyKind
from robocorba.robot.kinematics.appearance import Part, parts

MAP = "map"
_COLOURS = {
    "ground": colour((0.80, 0.81, 0.80)),
    "wall": colour((0.55, 0.60, 0.66), 0.7),
    "door": colour((0.75, 0.35, 0.30), 0.7),
    "object": colour((0.62, 0.55, 0.45)),
    "movable": colour((0.80, 0.62, 0.30)),
    "cabin": colour((0.35, 0.45, 0.60), 0.35),
    "open cabin": colour((0.35, 0.70, 0.45), 0.35),
    "ink": colour((0.10, 0.12, 0.15)),
}
#: Height of a cabin [m].
CABIN_HEIGHT_M = 2.2


def frame_of(body: Body) -> str:
    """The frame of a robot or a movable object."""
    return f"{body.name}/base_link" if body.kind is BodyKind.ROBOT else f"object/{body.name}"


def floor_entity(floor: str) -> str:
    """The id of a floor's entity."""
    return f"floor/{floor}"


def elevator_frame(elevator: str) -> str:
    """The frame of a cabin."""
    return f"elevator/{elevator}"


def link_frame(robot: str, link: str) -> str:
    """The frame of a link; of the base that of the robot."""
    return f"{robot}/base_link" if link == "base" else f"{robot}/{link}"


def building_entities(building: Building, time_s: float) -> Iterator[SceneEntity]:
    """An entity for each floor: its ground, walls, locked doors and fixed objects."""
    moving = {(floor, item.name) for item, floor in movables(building).values()}
    for name, entry in building.floors.items():
        shapes, bottom_m = Primitives(), entry.floor.elevation
        ground = Polygon(entry.floor.outline) if entry.floor.outline else None
        if ground is not None:
            for elevator in building.elevators_through(name):
                ground = ground.difference(shaft_polygon(elevator))
            shapes.add_plate(ground, bottom_m, _COLOURS["ground"])
        for obstacle in obstacles(building, name):
            plan = entry.geometrical
            if obstacle.kind == "object":
                if (name, obstacle.name) not in moving:
                    height_m = plan.objects[obstacle.name].height
                    if obstacle.geometry.area:
                        shapes.add_block(obstacle.geometry, bottom_m, height_m, _COLOURS["object"])
                    else:
                        shapes.add_walls(obstacle.geometry, bottom_m, height_m, _COLOURS["object"])
            elif obstacle.kind == "wall":
                shapes.add_walls(obstacle.geometry, bottom_m, plan.walls[obstacle.name].height, _COLOURS["wall"])
            elif obstacle.kind == "door":
                shapes.add_walls(obstacle.geometry, bottom_m, entry.floor.height * 0.8, _COLOURS["door"])
            else:  # without a height on the map, such as the bounds of a floor
                shapes.add_walls(obstacle.geometry, bottom_m, 0.1, _COLOURS["wall"])
        yield _entity(floor_entity(name), MAP, shapes, time_s, metadata={"floor": name})


def elevator_entity(elevator: Elevator, is_open: bool, time_s: float) -> SceneEntity:
    """The cabin of an elevator, in its frame; its colour says whether the doors are open."""
    shapes = Primitives()
    width, depth = elevator.size
    box = shapely.box(-width / 2, -depth / 2, width / 2, depth / 2)
    shapes.add_block(box, 0.0, CABIN_HEIGHT_M, _COLOURS["open cabin" if is_open else "cabin"])
    name = elevator_frame(elevator.name)
    return _entity(name, name, shapes, time_s, title=elevator.name, above_m=CABIN_HEIGHT_M)


def body_entities(body: Body, height_m: float, time_s: float) -> list[SceneEntity]:
    """A robot, as an entity for each of its links, or a movable object of this height [m], in their frames."""
    if body.kind is BodyKind.OBJECT:
        shapes = Primitives()
        shapes.add_block(Polygon(body.outline), 0.0, height_m, _COLOURS["movable"])
        frame = frame_of(body)
        return [_entity(frame, frame, shapes, time_s, title=body.name, above_m=height_m)]
    found = []
    for link, members in _parts_by_link().items():
        shapes = Primitives()
        for part in members:
            shapes.add_part(part)
        frame = link_frame(body.name, link)
        title = body.name if link == "base" else ""
        found.append(_entity(frame, frame, shapes, time_s, title=title, above_m=1.35))  # a robot's height
    return found


def entity_ids(body: Body) -> list[str]:
    """The ids of `body_entities`."""
    if body.kind is BodyKind.OBJECT:
        return [frame_of(body)]
    return [link_frame(body.name, link) for link in _parts_by_link()]


@cache
def _parts_by_link() -> dict[str, list[Part]]:
    found: dict[str, list[Part]] = {}
    for part in parts():
        found.setdefault(part.link, []).append(part)
    return found


def _entity(
    name: str,
    frame: str,
    shapes: Primitives,
    time_s: float,
    title: str = "",
    above_m: float = 0.0,
    metadata: dict[str, str] | None = None,
) -> SceneEntity:
    """An entity that moves with its frame. title: text above it."""
    texts = []
    if title:
        at = pose(0.0, 0.0, above_m + 0.25)
        texts = [TextPrimitive(pose=at, billboard=True, font_size=0.2, text=title, color=_COLOURS["ink"])]
    return SceneEntity(
        timestamp=timestamp(time_s),
        frame_id=frame,
        id=name,
        lifetime=FOREVER,
        frame_locked=True,
        metadata=[KeyValuePair(key=key, value=value) for key, value in (metadata or {}).items()],
        cubes=shapes.cubes,
        cylinders=shapes.cylinders,
        spheres=shapes.spheres,
        triangles=shapes.triangles,
        texts=texts,
    )

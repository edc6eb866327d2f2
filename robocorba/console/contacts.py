"""Who has touched whom, from moments of the floors: collisions are counted by the simulation, but not named."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.console.history import History, Moment
from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor import geometry
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.floor_update import BodyKind

#: Gap up to which two bodies, or a body and a wall, are regarded as touching [m].
TOUCH_M = 0.03
#: What robots touch that has no name of its own.
_WORDS = {"wall": "a wall", "floor": "the wall of the building"}


class Contact(NamedTuple):
    """A robot that touches another robot, an object or a part of the building, in words."""

    floor: str
    robot: str
    other: str


def contacts_since(history: History, building: Building, since_s: float, now_s: float) -> list[Contact]:
    """Contacts that began in a span of POSIX times [s], each once.

    building: the map; floors that it lacks have no walls. The history has a moment each 0.2 s or less
    often: a shorter contact may be missing."""
    found: dict[Contact, None] = {}
    for floor in history.floors:
        fixed = _fixed(building, floor)
        try:
            before, *moments = history.between(floor, since_s, now_s)
        except UnknownFloor:
            continue  # all its moments are old and have been forgotten
        known = set(_contacts(floor, before, fixed)) if moments else set()
        for moment in moments:
            touching = set(_contacts(floor, moment, fixed))
            found.update(dict.fromkeys(sorted(touching - known)))
            known = touching
    return list(found)


def _fixed(building: Building, floor: str) -> list[tuple[str, BaseGeometry]]:
    """Words and geometry of all that does not move on a floor."""
    if floor not in building.floors:
        return []
    objects = building.floors[floor].geometrical.objects
    return [
        (_WORDS.get(kind) or (name if kind == "object" else f"{kind} {name}"), shape)
        for kind, name, shape in geometry.obstacles(building, floor)
        if not (kind == "object" and objects[name].movable)
    ]


def _contacts(floor: str, moment: Moment, fixed: list[tuple[str, BaseGeometry]]) -> Iterator[Contact]:
    bodies = _shapes(moment)
    tree = STRtree([*bodies, *(shape for _, shape in fixed)])
    robots = [index for index, body in enumerate(moment.bodies) if body.kind is BodyKind.ROBOT]
    by, which = tree.query(bodies[robots], predicate="dwithin", distance=TOUCH_M)
    for robot, other in zip((robots[index] for index in by), which.tolist(), strict=True):
        if other >= len(bodies):
            yield Contact(floor, moment.bodies[robot].name, fixed[other - len(bodies)][0])
        elif other > robot or (other < robot and moment.bodies[other].kind is BodyKind.OBJECT):
            yield Contact(floor, moment.bodies[robot].name, moment.bodies[other].name)


def _shapes(moment: Moment) -> NDArray[np.object_]:
    """The bodies of a moment as polygons in the floor's frame."""
    shapes = np.empty(len(moment.bodies), object)
    for index, (body, row) in enumerate(zip(moment.bodies, moment.rows, strict=True)):
        x, y, heading = float(row["x"]), float(row["y"]), float(row["heading"])
        if body.outline:
            cos, sin = np.cos(heading), np.sin(heading)
            corners = np.asarray(body.outline) @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
            shapes[index] = shapely.Polygon(corners)
        else:
            shapes[index] = shapely.Point(x, y).buffer(body.radius_m)
    return shapes

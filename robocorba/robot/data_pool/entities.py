"""Robots and objects as readers of the data pool get them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from robocorba.map_editor.model import MapObject
from robocorba.map_editor.movable import object_outline
from robocorba.map_editor.spatial.floor_update import Body, BodyKind
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import XY


class FloorEntity(NamedTuple):
    """A robot or an object: x, y [m] and heading [rad] on its floor, velocity along the floor's axes [m/s] and turn
    [rad/s].

    radius_m: of a robot, or of the circle around an object. outline: of an object in its own frame, the corners of a
    polygon or the two ends of a line. mass_kg: 0 for an object that can't be moved, whose mass maps don't contain."""

    name: str
    kind: BodyKind
    x: float
    y: float
    heading: float
    vx: float
    vy: float
    turn: float
    radius_m: float
    outline: tuple[XY, ...]
    mass_kg: float
    is_movable: bool
    #: Of the body in the simulation, its identity while names change; 0 for an object that can't be moved.
    number: int = 0

    @property
    def corners(self) -> tuple[XY, ...]:
        """The outline in the floor's frame [m]."""
        return tuple(out_of(x, y, (self.x, self.y, self.heading)) for x, y in self.outline)


def entity_of_body(body: Body, motion: np.void) -> FloorEntity:
    """An entity from a body and its row of MOTION."""
    _, vx, vy, turn, x, y, heading = motion.tolist()
    shape = body.radius_m, body.outline, body.mass_kg
    return FloorEntity(body.name, body.kind, x, y, heading, vx, vy, turn, *shape, is_movable=True, number=body.number)


def entity_of_map_object(item: MapObject) -> FloorEntity:
    """An object that can't be moved, at its pose on the map."""
    corners = shapely.get_coordinates(object_outline(item)).tolist()
    if corners[0] == corners[-1]:  # a ring
        corners.pop()
    radius_m = max(math.hypot(x, y) for x, y in corners)
    pose, shape = (*item.at, item.heading), tuple((x, y) for x, y in corners)
    return FloorEntity(item.name, BodyKind.OBJECT, *pose, 0.0, 0.0, 0.0, radius_m, shape, 0.0, is_movable=False)

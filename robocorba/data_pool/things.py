"""Robots and objects as the data pool tells of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from robocorba.maps.model import MapObject
from robocorba.maps.movable import outline
from robocorba.spatial.floor_update import Body, BodyKind
from robocorba.spatial.frames import out_of
from robocorba.spatial.pose import XY


class Thing(NamedTuple):
    """A robot or an object as it is: x, y (m) and heading (rad) on its floor, velocity along the floor's axes (m/s) and
    turn (rad/s).

    `radius_m` is a robot's, or that of the circle around an object. `outline` is an object's in its own frame: corners
    of a polygon, or the two ends of a line. What can't be moved has the mass 0, for maps don't tell it."""

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

    @property
    def corners(self) -> tuple[XY, ...]:
        """The outline in the floor's frame, m."""
        return tuple(out_of(x, y, (self.x, self.y, self.heading)) for x, y in self.outline)


def moving(body: Body, motion: np.void) -> Thing:
    """A body with its row of MOTION."""
    _, vx, vy, turn, x, y, heading = motion.tolist()
    return Thing(
        body.name, body.kind, x, y, heading, vx, vy, turn, body.radius_m, body.outline, body.mass_kg, is_movable=True
    )


def fixed(thing: MapObject) -> Thing:
    """An object that stands where the map says."""
    corners = shapely.get_coordinates(outline(thing)).tolist()
    if corners[0] == corners[-1]:  # a ring
        corners.pop()
    radius_m = max(math.hypot(x, y) for x, y in corners)
    at, shape = (*thing.at, thing.heading), tuple((x, y) for x, y in corners)
    return Thing(thing.name, BodyKind.OBJECT, *at, 0.0, 0.0, 0.0, radius_m, shape, 0.0, is_movable=False)

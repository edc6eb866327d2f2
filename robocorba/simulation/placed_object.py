"""A movable object in the simulated building."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robocorba.map_editor.model import MapObject
from robocorba.map_editor.movable import full_name, object_outline
from robocorba.map_editor.spatial.floor_update import Body, BodyKind
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.body_names import object_body


@dataclass(eq=False)
class PlacedObject:
    """A movable object of the map, which is not necessarily at its pose on the map.

    number: its identity while names change. name: unique, as in `movables`. map_object, map_floor: the object on the
    map, and its floor there. floor: where it is."""

    number: int
    name: str
    map_object: MapObject
    map_floor: str
    floor: str

    @property
    def body(self) -> str:
        return object_body(self.number)

    @property
    def full_name(self) -> str:
        """FLOOR/NAME by its floor on the map."""
        return full_name(self.map_floor, self.map_object.name)

    @property
    def map_pose(self) -> Pose:
        return Pose(self.map_floor, *self.map_object.at, self.map_object.heading)

    @property
    def mass_kg(self) -> float:
        """That of the map, else 9 kg/m^2: then three robots lift up to 1.33 m^2."""
        return self.map_object.mass or float(9.0 * object_outline(self.map_object).area)

    def published(self) -> Body:
        """As clients see it."""
        corners = list(object_outline(self.map_object).exterior.coords[:-1])
        radius_m = max(math.hypot(x, y) for x, y in corners)
        return Body(self.number, BodyKind.OBJECT, self.name, radius_m, tuple(corners), self.mass_kg)

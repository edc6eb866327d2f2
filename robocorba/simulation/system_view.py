"""Where all robots of a running or recorded system are, across floors and in elevators."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from robocorba.errors.simulation import UpdateMismatch
from robocorba.maps.model import Building
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.floor_update import BodyKind, FloorUpdate, FloorView
from robocorba.spatial.frames import turned


class RobotPlace(NamedTuple):
    """A robot: x, y, z [m] of its base, heading [rad], velocity ahead and to the left [m/s], turn [rad/s]. z: above the
    zero of the map; of a robot in a cabin that travels, the cabin's."""

    name: str
    floor: str
    x: float
    y: float
    z: float
    heading: float
    velocity: tuple[float, float, float]


class SystemView:
    """Follows updates of floors. Not thread-safe. building: as it is served; may be replaced."""

    def __init__(self, building: Building) -> None:
        self.building = building
        #: Simulated time of the last update [s].
        self.time_s = 0.0
        self._views: dict[str, FloorView] = {}
        self._elevators: dict[str, ElevatorState] = {}
        #: The floor on which each robot was seen last.
        self._floor_of: dict[str, str] = {}

    def apply(self, updates: Iterable[FloorUpdate]) -> None:
        """Raises UpdateMismatch if an update does not continue the last one of its floor."""
        for update in updates:
            view = self._views.setdefault(update.floor, FloorView(update.floor))
            try:
                view.apply(update)
            except UpdateMismatch:
                del self._views[update.floor]
                raise
            self._elevators.update(update.elevators)
            self._floor_of.update((body.name, update.floor) for body in update.came if body.kind is BodyKind.ROBOT)
            self.time_s = update.time

    def robots(self) -> Iterator[RobotPlace]:
        """All robots, each once."""
        cabins = {
            rider: state.height for state in self._elevators.values() if not state.floor for rider in state.riders
        }
        for view in self._views.values():
            entry = self.building.floors.get(view.floor)
            for body, row in zip(view.bodies.values(), view.motions, strict=True):
                if body.kind is not BodyKind.ROBOT or self._floor_of.get(body.name) != view.floor:
                    continue
                heading = float(row["heading"])
                ahead, left = turned(float(row["vx"]), float(row["vy"]), -heading)
                yield RobotPlace(
                    body.name,
                    view.floor,
                    float(row["x"]),
                    float(row["y"]),
                    cabins.get(body.name, entry.floor.elevation if entry else 0.0),
                    heading,
                    (ahead, left, float(row["turn"])),
                )

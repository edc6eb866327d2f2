"""Where all robots of a running or recorded system are, across floors and in elevators."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import WHOLE, BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.frames import turned

#: Time by which a server that was killed may begin again earlier [s, simulated]; less is a floor that lags behind.
BACKWARD_S = 1.0


class RobotPlace(NamedTuple):
    """A robot: x, y, z [m] of its base, heading [rad], velocity ahead and to the left [m/s], turn [rad/s]. z: above the
    zero of the map; of a robot in a cabin, the cabin's. time_s: simulated time of all that [s], which is that of the
    last update of its floor."""

    name: str
    floor: str
    x: float
    y: float
    z: float
    heading: float
    velocity: tuple[float, float, float]
    time_s: float = 0.0


class SystemView:
    """Follows updates of floors. Not thread-safe. building: as it is served; may be replaced."""

    def __init__(self, building: Building) -> None:
        self.building = building
        self._views: dict[str, FloorView] = {}
        #: States of elevators, and the simulated times of the updates that had them [s].
        self._elevators: dict[str, tuple[float, ElevatorState]] = {}
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
            for name, state in update.elevators.items():
                if update.since == WHOLE or update.time >= self._elevators.get(name, (0.0,))[0]:
                    self._elevators[name] = update.time, state
            if update.since == WHOLE:  # an elevator may be gone, or have another name
                present = {name for view in self._views.values() for name in view.elevators}
                self._elevators = {name: each for name, each in self._elevators.items() if name in present}
            self._floor_of.update((body.name, update.floor) for body in update.came if body.kind is BodyKind.ROBOT)

    @property
    def time_s(self) -> float:
        """Simulated time of the latest update of a floor [s]."""
        return max((view.time for view in self._views.values()), default=0.0)

    def robots(self) -> Iterator[RobotPlace]:
        """All robots, each once."""
        # Also in a cabin that has arrived: the update in which its riders come to the new floor may be the next one.
        cabins = {rider: state.height for _, state in self._elevators.values() for rider in state.riders}
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
                    view.time,
                )

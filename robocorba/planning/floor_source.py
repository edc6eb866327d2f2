"""The elements of a building that determine the free space of a floor, and which of them an edit touched."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from robocorba.maps.geometry import DOOR_REACH_M
from robocorba.maps.model import Building
from robocorba.maps.vicinity import line_box, walls_intersecting

#: Greatest number of changed elements for an incremental update; rebuilding the whole floor is cheaper beyond it.
MAX_TOUCHED = 1_000

T = TypeVar("T")


class Touched(NamedTuple):
    """Names of the walls, objects and doors that were added, changed or removed, and of walls with changed openings."""

    walls: set[str]
    objects: set[str]
    doors: set[str]


class FloorSource:
    """The elements that determine where robots can drive on a floor. They are compared by identity: buildings share
    what an edit does not touch."""

    def __init__(self, building: Building, floor: str) -> None:
        entry = building.floors[floor]
        self.floor, self.plan = entry.floor, entry.geometrical
        self.elevators = tuple(building.elevators.values())

    def same_as(self, other: FloorSource) -> bool:
        """Whether all elements are the same."""
        return (
            self._same_frame(other)
            and self.plan.walls is other.plan.walls
            and self.plan.objects is other.plan.objects
            and self.plan.doors is other.plan.doors
        )

    def _same_frame(self, other: FloorSource) -> bool:
        return (
            self.floor is other.floor
            and len(self.elevators) == len(other.elevators)
            and all(a is b for a, b in zip(self.elevators, other.elevators, strict=True))
        )

    def touched_since(self, before: FloorSource, building: Building) -> Touched | None:
        """The differences to `before`; None if the whole floor must be rebuilt: its entry or an elevator changed, or
        more than MAX_TOUCHED elements did."""
        if not self._same_frame(before):
            return None
        walls = _differing(self.plan.walls, before.plan.walls)
        objects = _differing(self.plan.objects, before.plan.objects)
        doors = _differing(self.plan.doors, before.plan.doors)
        if doors:
            both = (self.plan.doors, before.plan.doors)
            boxes = [line_box(side[name], 2 * DOOR_REACH_M) for name in doors for side in both if name in side]
            walls |= set(walls_intersecting(building, self.floor.name, boxes))
        if len(walls) + len(objects) + len(doors) > MAX_TOUCHED:
            return None
        return Touched(walls, objects, doors)


def _differing(now: dict[str, T], before: dict[str, T]) -> set[str]:
    """Names whose objects differ between the two."""
    if now is before:
        return set()
    changed = {name for name, value in now.items() if before.get(name) is not value}
    return changed | (before.keys() - now.keys())

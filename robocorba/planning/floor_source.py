"""What the free space of a floor is made from, and what of it an edit touched."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from robocorba.maps.geometry import DOOR_REACH_M
from robocorba.maps.model import Building
from robocorba.maps.vicinity import line_box, walls_cut_by

#: With more elements touched than this the floor is made anew as a whole: that is cheaper then.
MOST_TOUCHED = 1_000

T = TypeVar("T")


class Touched(NamedTuple):
    """Names of the walls, objects and doors that are new, changed or gone, or, walls, whose openings changed."""

    walls: set[str]
    objects: set[str]
    doors: set[str]


class FloorSource:
    """The parts of a building that decide where robots can drive on a floor. Compared by identity: what an edit does
    not touch is shared between buildings."""

    def __init__(self, building: Building, floor: str) -> None:
        entry = building.floors[floor]
        self.floor, self.plan = entry.floor, entry.geometrical
        self.elevators = tuple(building.elevators.values())

    def same_as(self, other: FloorSource) -> bool:
        """Whether nothing differs."""
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
        """What differs; None where it is so much, or such, that everything is made anew."""
        if not self._same_frame(before):
            return None
        walls = _differing(self.plan.walls, before.plan.walls)
        objects = _differing(self.plan.objects, before.plan.objects)
        doors = _differing(self.plan.doors, before.plan.doors)
        if doors:
            both = (self.plan.doors, before.plan.doors)
            boxes = [line_box(side[name], 2 * DOOR_REACH_M) for name in doors for side in both if name in side]
            walls |= set(walls_cut_by(building, self.floor.name, boxes))
        if len(walls) + len(objects) + len(doors) > MOST_TOUCHED:
            return None
        return Touched(walls, objects, doors)


def _differing(now: dict[str, T], before: dict[str, T]) -> set[str]:
    """Names under which the two hold different objects."""
    if now is before:
        return set()
    changed = {name for name, value in now.items() if before.get(name) is not value}
    return changed | (before.keys() - now.keys())

"""The elements of a building that determine the free space of a floor, and which of them an edit touched."""

from __future__ import annotations

from typing import Any

from robocorba.map_editor.geometry import DOOR_REACH_M
from robocorba.map_editor.model import Building
from robocorba.map_editor.vicinity import line_box, walls_intersecting

#: Maximum number of changed elements for an incremental update; rebuilding the whole floor is cheaper beyond it.
MAX_TOUCHED = 1_000


class FloorSource:
    """The elements that determine where robots can drive on a floor. They are compared by identity: buildings share
    what an edit does not touch."""

    def __init__(self, building: Building, floor: str) -> None:
        entry = building.floors[floor]
        self.floor, self.plan = entry.floor, entry.geometrical
        self.elevators = building.elevators_through(floor)

    def same_as(self, other: FloorSource) -> bool:
        """Whether all elements are the same."""
        return (
            self._same_frame(other)
            and self.plan.walls is other.plan.walls
            and self.plan.objects is other.plan.objects
            and self.plan.doors is other.plan.doors
        )

    def _same_frame(self, other: FloorSource) -> bool:
        return self.floor is other.floor and list(map(id, self.elevators)) == list(map(id, other.elevators))

    def touched_since(self, before: FloorSource, building: Building) -> set[tuple[str, str]] | None:
        """The walls, objects and doors, as (kind, name), that differ from `before`, and walls with other openings.

        None if the whole floor must be rebuilt: its entry or an elevator changed, or more than MAX_TOUCHED elements
        did."""
        if not self._same_frame(before):
            return None
        doors = _changed(self.plan.doors, before.plan.doors)
        walls = _changed(self.plan.walls, before.plan.walls)
        if doors:
            both = (self.plan.doors, before.plan.doors)
            boxes = [line_box(side[name], 2 * DOOR_REACH_M) for name in doors for side in both if name in side]
            walls |= set(walls_intersecting(building, self.floor.name, boxes))
        objects = _changed(self.plan.objects, before.plan.objects)
        touched = {("wall", name) for name in walls} | {("object", name) for name in objects}
        touched |= {("door", name) for name in doors}
        return touched if len(touched) <= MAX_TOUCHED else None


def _changed(now: dict[str, Any], before: dict[str, Any]) -> set[str]:
    """Names of elements that were added, changed or removed."""
    if now is before:
        return set()
    return {name for name, value in now.items() if before.get(name) is not value} | (before.keys() - now.keys())

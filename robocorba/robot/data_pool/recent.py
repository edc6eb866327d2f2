"""The last updates of a floor, for readers that have an earlier version."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, FloorUpdate

#: Updates that a pool remembers: some 4 s. A reader with an older version gets the whole floor.
MAX_UPDATES = 128
Updates = tuple[FloorUpdate, ...]


def continued(recent: Updates, update: FloorUpdate) -> Updates:
    """The updates with one more that continues the last one; none after a whole floor, which readers get instead.
    Without changes, as before."""
    if update.since == WHOLE:
        return ()
    if update.version == update.since:
        return recent
    return (*recent[1 - MAX_UPDATES :], update)


def since(recent: Sequence[FloorUpdate], version: int) -> Sequence[FloorUpdate] | None:
    """The updates that lead from a version to the last one; None if it is not remembered."""
    for index, update in enumerate(recent):
        if update.since == version:
            return recent[index:]
    return None


def merged(updates: Sequence[FloorUpdate], last: FloorUpdate) -> FloorUpdate:
    """One update with the effect of all `updates`, in their order; time and map are those of `last`."""
    came: dict[int, Body] = {}
    went: dict[int, None] = {}
    rows: dict[int, np.void] = {}
    elevators: dict[str, ElevatorState] = {}
    for update in updates:
        for number in update.went:
            came.pop(number, None)
            rows.pop(number, None)
            went[number] = None
        came.update((body.number, body) for body in update.came)
        rows.update(zip(update.motions["number"].tolist(), update.motions, strict=True))
        elevators.update(update.elevators)
    first = updates[0].since if updates else last.version
    motions = np.array(list(rows.values()), MOTION) if rows else np.empty(0, MOTION)
    return FloorUpdate(
        *(last.floor, first, last.version, last.time, last.map_version),
        *(list(came.values()), list(went), motions, elevators),
    )

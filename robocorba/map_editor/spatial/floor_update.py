"""Versioned floor updates of the Omni database, and the local copy that a client keeps from them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.pose import XY

#: A moved body: its number, velocity along the floor's axes [m/s], turn [rad/s], x, y [m], heading [rad].
MOTION = np.dtype(
    [("number", "<u4"), ("vx", "<f4"), ("vy", "<f4"), ("turn", "<f4"), ("x", "<f8"), ("y", "<f8"), ("heading", "<f8")]
)
Motions = NDArray[np.void]
#: `since` of an update that holds the whole floor.
WHOLE = 0


class BodyKind(Enum):
    """Kind of a moving body."""

    ROBOT = 0
    OBJECT = 1


class Body(NamedTuple):
    """A robot or a movable object. outline: corners of an object in its own frame [m], empty for a robot."""

    number: int
    kind: BodyKind
    name: str
    radius_m: float
    outline: tuple[XY, ...]
    mass_kg: float


class FloorUpdate(NamedTuple):
    """Changes of a floor from version `since` to `version`; the whole floor if `since` is WHOLE.

    time: simulated [s]. came: bodies that were added, or have another name or outline. went: numbers of removed bodies.
    motions: rows of MOTION of moved bodies. elevators: changed elevators that serve the floor, by name."""

    floor: str
    since: int
    version: int
    time: float
    map_version: int
    came: list[Body]
    went: list[int]
    motions: Motions
    elevators: dict[str, ElevatorState]


def memory_of(bodies: Iterable[Body], elevators: Mapping[str, ElevatorState]) -> int:
    """About how much memory bodies and elevators take [bytes]; measured with tracemalloc."""
    of_bodies = sum(250 + len(body.name) + 130 * len(body.outline) for body in bodies)
    texts = itertools.chain.from_iterable((name, *state.riders, *state.queue) for name, state in elevators.items())
    return of_bodies + 250 * len(elevators) + sum(60 + len(text) for text in texts)


class FloorView:
    """Local copy of a floor, kept up to date by applying its updates."""

    def __init__(self, floor: str) -> None:
        self.floor = floor
        self.version = WHOLE
        self.time, self.map_version = 0.0, 0
        self.bodies: dict[int, Body] = {}
        #: Rows of MOTION in the order of `bodies`.
        self.motions = np.empty(0, MOTION)
        self.elevators: dict[str, ElevatorState] = {}
        #: Rows that the last update changed.
        self.moved: NDArray[np.int64] = np.empty(0, np.int64)
        self._rebuild_rows()

    def apply(self, update: FloorUpdate) -> bool:
        """Apply an update; return whether bodies were added or removed.

        Raises UpdateMismatch if it does not continue `version`."""
        if update.since not in (WHOLE, self.version):
            raise UpdateMismatch(update.floor, self.version, update.since)
        is_whole = update.since == WHOLE
        if is_whole:
            self.bodies, self.elevators = {}, {}
        for number in update.went:
            self.bodies.pop(number, None)
        self.bodies.update((body.number, body) for body in update.came)
        has_changed = bool(is_whole or update.went or update.came)
        if has_changed:
            self._rebuild_rows()
        self.moved = self._rows(update)
        self.motions[self.moved] = update.motions
        self.elevators.update(update.elevators)
        self.version, self.time, self.map_version = update.version, update.time, update.map_version
        return has_changed

    def _rows(self, update: FloorUpdate) -> NDArray[np.int64]:
        """Rows of the bodies that an update moves. Raises UpdateMismatch."""
        numbers = update.motions["number"]
        indices = self._numbers.searchsorted(numbers)
        if not (self._numbers_and_end[indices] == numbers).all():
            raise UpdateMismatch(update.floor, self.version, update.since)  # a moved body is unknown
        return self._row_of[indices]

    def motion(self, number: int) -> np.void:
        """The row of MOTION of a body. Raises KeyError."""
        if number not in self.bodies:
            raise KeyError(number)
        row: np.void = self.motions[self._row_of[np.searchsorted(self._numbers, number)]]
        return row

    def _rebuild_rows(self) -> None:
        """Rebuild the rows after bodies were added or removed."""
        motion_before = dict(zip(self.motions["number"].tolist(), self.motions, strict=True))
        self.motions = np.zeros(len(self.bodies), MOTION)
        numbers = np.fromiter(self.bodies, np.int64, len(self.bodies))
        self.motions["number"] = numbers
        for row, number in enumerate(self.bodies):
            if number in motion_before:
                self.motions[row] = motion_before[number]
        self._row_of = np.argsort(numbers)
        #: Numbers of the bodies in ascending order, in the type of MOTION; `_row_of` has their rows.
        self._numbers = numbers[self._row_of].astype(MOTION["number"])
        #: With a sentinel, so that a search for a number above all others stays in range.
        self._numbers_and_end = np.append(self._numbers, self._numbers.dtype.type(0))

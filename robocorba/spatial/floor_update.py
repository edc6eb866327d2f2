"""What the Omni database tells of a floor, and the copy that whoever follows it keeps."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.errors.simulation import OutOfStep
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.pose import XY

#: A body that moved: its number, velocity along the floor's axes (m/s), turn (rad/s), x, y (m), heading (rad).
MOTION = np.dtype(
    [("number", "<u4"), ("vx", "<f4"), ("vy", "<f4"), ("turn", "<f4"), ("x", "<f8"), ("y", "<f8"), ("heading", "<f8")]
)
Motions = NDArray[np.void]
WHOLE = 0


class BodyKind(Enum):
    """What moves."""

    ROBOT = 0
    OBJECT = 1


class Body(NamedTuple):
    """A robot or a movable object; `outline` is an object's, in its own frame, m."""

    number: int
    kind: BodyKind
    name: str
    radius_m: float
    outline: tuple[XY, ...]
    mass_kg: float


class FloorUpdate(NamedTuple):
    """From version `since` of a floor to `version`; the whole floor where `since` is WHOLE.

    `time` is the simulation's, s; `elevators` has those that serve the floor and have changed, by name."""

    floor: str
    since: int
    version: int
    time: float
    map_version: int
    came: list[Body]
    went: list[int]
    motions: Motions
    elevators: dict[str, ElevatorState]


class FloorView:
    """A floor as its updates tell it."""

    def __init__(self, floor: str) -> None:
        self.floor = floor
        self.version = WHOLE
        self.time, self.map_version = 0.0, 0
        self.bodies: dict[int, Body] = {}
        #: Rows of MOTION, in the order of `bodies`.
        self.motions = np.empty(0, MOTION)
        self.elevators: dict[str, ElevatorState] = {}
        #: Rows that the last update has changed.
        self.moved: NDArray[np.int64] = np.empty(0, np.int64)
        self._sort()

    def apply(self, update: FloorUpdate) -> bool:
        """Follow; whether bodies came or went. Raises OutOfStep for what does not belong here."""
        if update.since not in (WHOLE, self.version):
            raise OutOfStep(update.floor, self.version, update.since)
        is_whole = update.since == WHOLE
        if is_whole:
            self.bodies, self.elevators = {}, {}
        for number in update.went:
            self.bodies.pop(number, None)
        self.bodies.update((body.number, body) for body in update.came)
        has_changed = bool(is_whole or update.went or update.came)
        if has_changed:
            self._sort()
        self.moved = self._rows(update)
        self.motions[self.moved] = update.motions
        self.elevators.update(update.elevators)
        self.version, self.time, self.map_version = update.version, update.time, update.map_version
        return has_changed

    def _rows(self, update: FloorUpdate) -> NDArray[np.int64]:
        numbers = update.motions["number"]
        places = self._numbers.searchsorted(numbers)
        if not (self._numbers_or_none[places] == numbers).all():
            raise OutOfStep(update.floor, self.version, update.since)  # somebody moves who never came
        return self._row_of[places]

    def motion(self, number: int) -> np.void:
        """A body's row of MOTION. Raises KeyError."""
        if number not in self.bodies:
            raise KeyError(number)
        row: np.void = self.motions[self._row_of[np.searchsorted(self._numbers, number)]]
        return row

    def _sort(self) -> None:
        """Bodies came or went."""
        before = dict(zip(self.motions["number"].tolist(), self.motions, strict=True))
        self.motions = np.zeros(len(self.bodies), MOTION)
        numbers = np.fromiter(self.bodies, np.int64, len(self.bodies))
        self.motions["number"] = numbers
        for row, number in enumerate(self.bodies):
            if number in before:
                self.motions[row] = before[number]
        self._row_of = np.argsort(numbers)
        #: Numbers of the bodies in rising order, of the type that updates tell them in; `_row_of` has their rows.
        self._numbers = numbers[self._row_of].astype(MOTION["number"])
        #: With one that is nobody's, for a number that is greater than all.
        self._numbers_or_none = np.append(self._numbers, self._numbers.dtype.type(0))

"""What a monitor shows of an elevator: where its cabin is, its doors, who rides and who waits."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Doors(Enum):
    """Of the floor where the cabin is; while it travels all are closed."""

    CLOSED = 0
    OPENING = 1
    OPEN = 2
    CLOSING = 3


class ElevatorState(NamedTuple):
    """What the 2D simulator shows: height of the cabin's floor in m, the floor where it stands, empty on the way."""

    height: float
    floor: str
    doors: Doors
    #: Share of the way that the doors are open.
    opening: float
    riders: tuple[str, ...]
    queue: tuple[str, ...]

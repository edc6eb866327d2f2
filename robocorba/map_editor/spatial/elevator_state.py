"""The state of an elevator as the Omni database publishes it."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Doors(Enum):
    """Phase of the landing doors at the cabin's floor; all doors are closed while the cabin travels."""

    CLOSED = 0
    OPENING = 1
    OPEN = 2
    CLOSING = 3


class ElevatorState(NamedTuple):
    """An elevator at one time. riders: robots inside. queue: waiting robots, first call first."""

    #: Height of the cabin's ground [m].
    height: float
    #: Floor at which the cabin is stopped; empty while it travels.
    floor: str
    doors: Doors
    #: How far the doors are open: 0 closed, 1 open.
    opening: float
    riders: tuple[str, ...]
    queue: tuple[str, ...]

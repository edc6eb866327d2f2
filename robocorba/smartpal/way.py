"""Ways of the base: where it shall be when a share of them is done."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: x, y in m, heading in rad.
Place = tuple[float, float, float]


@dataclass(frozen=True)
class Straight:
    """From a place to x, y, turning evenly by `turn` rad."""

    start: Place
    end: tuple[float, float]
    turn: float

    @property
    def length_m(self) -> float:
        return math.dist(self.start[:2], self.end)

    def at(self, share: float) -> Place:
        (x, y, heading), (to_x, to_y) = self.start, self.end
        return x + share * (to_x - x), y + share * (to_y - y), heading + share * self.turn


@dataclass(frozen=True)
class Arc:
    """From a place around a centre by `turn` rad, and turning as much."""

    start: Place
    centre: tuple[float, float]
    turn: float

    @property
    def length_m(self) -> float:
        return math.dist(self.start[:2], self.centre) * abs(self.turn)

    def at(self, share: float) -> Place:
        (x, y, heading), (centre_x, centre_y) = self.start, self.centre
        out_x, out_y = turned(x - centre_x, y - centre_y, share * self.turn)
        return centre_x + out_x, centre_y + out_y, heading + share * self.turn


Way = Straight | Arc


def turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """A vector, turned by an angle, rad."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return x * cosine - y * sine, x * sine + y * cosine


def seen_from(frame: Place, place: Place) -> Place:
    """A place in the frame of another one."""
    x, y = turned(place[0] - frame[0], place[1] - frame[1], -frame[2])
    return x, y, place[2] - frame[2]


def placed(frame: Place, place: Place) -> Place:
    """The other way round: a place in a frame, where the frame is."""
    x, y = turned(place[0], place[1], frame[2])
    return frame[0] + x, frame[1] + y, frame[2] + place[2]

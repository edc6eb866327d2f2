"""Segments that the base drives: its pose as a function of the fraction completed."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: x, y [m], heading [rad].
BasePose = tuple[float, float, float]


@dataclass(frozen=True)
class Line:
    """A straight line from `start` to `end` (x, y in m), turning evenly by `turn` rad."""

    start: BasePose
    end: tuple[float, float]
    turn: float

    @property
    def length_m(self) -> float:
        return math.dist(self.start[:2], self.end)

    def at(self, fraction: float) -> BasePose:
        (x, y, heading), (to_x, to_y) = self.start, self.end
        return x + fraction * (to_x - x), y + fraction * (to_y - y), heading + fraction * self.turn


@dataclass(frozen=True)
class Arc:
    """An arc of `turn` rad around `centre` (x, y in m); the heading turns by the same angle."""

    start: BasePose
    centre: tuple[float, float]
    turn: float

    @property
    def length_m(self) -> float:
        return math.dist(self.start[:2], self.centre) * abs(self.turn)

    def at(self, fraction: float) -> BasePose:
        (x, y, heading), (centre_x, centre_y) = self.start, self.centre
        out_x, out_y = rotated(x - centre_x, y - centre_y, fraction * self.turn)
        return centre_x + out_x, centre_y + out_y, heading + fraction * self.turn


Segment = Line | Arc


def rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    """The vector (x, y) rotated by `angle` rad."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return x * cosine - y * sine, x * sine + y * cosine


def to_frame(frame: BasePose, pose: BasePose) -> BasePose:
    """`pose` expressed in `frame`, both given in the same frame."""
    x, y = rotated(pose[0] - frame[0], pose[1] - frame[1], -frame[2])
    return x, y, pose[2] - frame[2]


def from_frame(frame: BasePose, pose: BasePose) -> BasePose:
    """The inverse of `to_frame`: `pose`, given in `frame`, in the frame in which `frame` is given."""
    x, y = rotated(pose[0], pose[1], frame[2])
    return frame[0] + x, frame[1] + y, frame[2] + pose[2]

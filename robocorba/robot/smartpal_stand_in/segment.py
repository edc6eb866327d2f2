"""Segments that the base drives: its pose (x, y [m], heading [rad]) as a function of the fraction completed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robocorba.map_editor.spatial.frames import Frame, into, out_of, turned


@dataclass(frozen=True)
class Line:
    """A straight line from `start` to `end` (x, y in m), turning evenly by `turn` rad."""

    start: Frame
    end: tuple[float, float]
    turn: float

    @property
    def length_m(self) -> float:
        return math.dist(self.start[:2], self.end)

    def at(self, fraction: float) -> Frame:
        (x, y, heading), (to_x, to_y) = self.start, self.end
        return x + fraction * (to_x - x), y + fraction * (to_y - y), heading + fraction * self.turn


@dataclass(frozen=True)
class Arc:
    """An arc of `turn` rad around `centre` (x, y in m); the heading turns by the same angle."""

    start: Frame
    centre: tuple[float, float]
    turn: float

    @property
    def length_m(self) -> float:
        return math.dist(self.start[:2], self.centre) * abs(self.turn)

    def at(self, fraction: float) -> Frame:
        (x, y, heading), (centre_x, centre_y) = self.start, self.centre
        out_x, out_y = turned(x - centre_x, y - centre_y, fraction * self.turn)
        return centre_x + out_x, centre_y + out_y, heading + fraction * self.turn


Segment = Line | Arc


def to_frame(frame: Frame, pose: Frame) -> Frame:
    """`pose` expressed in `frame`, both given in the same frame."""
    return *into(pose[0], pose[1], frame), pose[2] - frame[2]


def from_frame(frame: Frame, pose: Frame) -> Frame:
    """The inverse of `to_frame`: `pose`, given in `frame`, in the frame in which `frame` is given."""
    return *out_of(pose[0], pose[1], frame), frame[2] + pose[2]

"""Segments that the base drives: its pose (x, y [m], heading [rad]) as a function of the fraction completed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from robocorba.map_editor.spatial.frames import Frame, into, out_of, turned


@dataclass(frozen=True)
class Segment:
    """A segment of a length [m], which turns the base by `turn` [rad]. at: its pose at a fraction of the segment."""

    length_m: float
    turn: float
    at: Callable[[float], Frame]

    def derivative(self, fraction: float) -> Frame:
        """Derivative of the pose with respect to the fraction completed."""
        step = 1e-6
        first, last = self.at(fraction - step), self.at(fraction + step)
        x, y, heading = ((after - before) / (2 * step) for before, after in zip(first, last, strict=True))
        return x, y, heading


def line(start: Frame, end: tuple[float, float], turn: float) -> Segment:
    """A straight line from `start` to `end` (x, y in m), turning evenly by `turn` rad."""

    def at(fraction: float) -> Frame:
        (x, y, heading), (to_x, to_y) = start, end
        return x + fraction * (to_x - x), y + fraction * (to_y - y), heading + fraction * turn

    return Segment(math.dist(start[:2], end), turn, at)


def arc(start: Frame, centre: tuple[float, float], turn: float) -> Segment:
    """An arc of `turn` rad around `centre` (x, y in m); the heading turns by the same angle."""

    def at(fraction: float) -> Frame:
        (x, y, heading), (centre_x, centre_y) = start, centre
        out_x, out_y = turned(x - centre_x, y - centre_y, fraction * turn)
        return centre_x + out_x, centre_y + out_y, heading + fraction * turn

    return Segment(math.dist(start[:2], centre) * abs(turn), turn, at)


def to_frame(frame: Frame, pose: Frame) -> Frame:
    """`pose` expressed in `frame`, both given in the same frame."""
    return *into(pose[0], pose[1], frame), pose[2] - frame[2]


def from_frame(frame: Frame, pose: Frame) -> Frame:
    """The inverse of `to_frame`: `pose`, given in `frame`, in the frame in which `frame` is given."""
    return *out_of(pose[0], pose[1], frame), frame[2] + pose[2]

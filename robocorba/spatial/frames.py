"""Points and velocities in the frame of something that stands on a floor: a robot, an object, a cabin."""

from __future__ import annotations

import math

from robocorba.spatial.pose import XY

#: x and y in m, heading in rad.
Frame = tuple[float, float, float]


def turned(x: float, y: float, angle: float) -> XY:
    """A vector, turned by an angle, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


def into(x: float, y: float, frame: Frame) -> XY:
    """Where a point of the floor is in a frame, m."""
    return turned(x - frame[0], y - frame[1], -frame[2])


def out_of(x: float, y: float, frame: Frame) -> XY:
    """Where a point of a frame is on the floor, m."""
    dx, dy = turned(x, y, frame[2])
    return frame[0] + dx, frame[1] + dy

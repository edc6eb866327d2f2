"""Transforms of points and vectors between a floor and the frame of a robot, an object or a cabin."""

from __future__ import annotations

import math

from robocorba.map_editor.spatial.pose import XY

#: x and y [m], heading [rad].
Frame = tuple[float, float, float]


def turned(x: float, y: float, angle: float) -> XY:
    """Rotate a vector by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


def into(x: float, y: float, frame: Frame) -> XY:
    """Transform a point from the floor into a frame [m]."""
    return turned(x - frame[0], y - frame[1], -frame[2])


def out_of(x: float, y: float, frame: Frame) -> XY:
    """Transform a point from a frame to the floor [m]."""
    dx, dy = turned(x, y, frame[2])
    return frame[0] + dx, frame[1] + dy

"""Goals in frames of ROS, as poses in the building."""

from __future__ import annotations

import math
from collections.abc import Mapping

from robocorba.bridges.ros2.frames import BASE, MAP, ODOM, Frames
from robocorba.errors.robots import RobotError
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.system_view import RobotPlace


def goal_in_building(
    frame: str,
    x: float,
    y: float,
    heading: float,
    place: RobotPlace,
    frames: Frames,
    robot: str,
    floors: Mapping[str, str],
) -> Pose:
    """A goal (x, y) [m], heading [rad] in a frame.

    In `map` and in the robot's own frames it is on the robot's floor, in the frame of a floor on that one. place: where
    the robot is. robot: its name in ROS. floors: by their frames. Raises RobotError for
    a goal that is in no known frame, or not finite."""
    if not all(map(math.isfinite, (x, y, heading))):
        raise RobotError(f"the goal ({x}, {y}), heading {heading}, is not finite")
    name = frame.removeprefix("/")
    if name == frames.of(robot, BASE):
        at = out_of(x, y, (place.x, place.y, place.heading))
        return Pose(place.floor, *at, math.remainder(place.heading + heading, math.tau))
    if name in (MAP, frames.of(robot, ODOM)):
        return Pose(place.floor, x, y, heading)
    if name in floors:
        return Pose(floors[name], x, y, heading)
    known = ", ".join((MAP, frames.of(robot, ODOM), frames.of(robot, BASE), *sorted(floors)))
    raise RobotError(f"the goal's frame is {frame!r}; known are {known}")

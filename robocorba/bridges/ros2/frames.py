"""The frames of REP 105 for many robots: map, and each robot's odom, base_link, sensors and links.

| frame | what it is |
|---|---|
| `map` | the building's, z is the height above the zero of its map |
| `floor/FLOOR` | the same on a floor's ground |
| `ROBOT/odom` | the same on the ground under the robot: of its floor, or of the cabin in which it rides |
| `ROBOT/base_link` | the robot, x ahead, y to the left |
| `ROBOT/laser`, `ROBOT/laser_2`, ... | its sensors |
| `ROBOT/waist`, ... | its links, as in its URDF |

With `is_namespaced`, frames have no `ROBOT/`, and each robot has topics `/ROBOT/tf` and `/ROBOT/tf_static`, as
navigation stacks that run in a robot's namespace expect."""

from __future__ import annotations

MAP, ODOM, BASE, LASER = "map", "odom", "base_link", "laser"


class Frames:
    """Names of frames. is_namespaced: see the module."""

    def __init__(self, is_namespaced: bool = False) -> None:
        self._is_namespaced = is_namespaced

    def of(self, robot: str, frame: str) -> str:
        """A robot's frame. robot: its name in ROS."""
        return frame if self._is_namespaced else f"{robot}/{frame}"

    def topic(self, robot: str, is_static: bool = False) -> str:
        """The topic of a robot's frames."""
        name = "tf_static" if is_static else "tf"
        return f"/{robot}/{name}" if self._is_namespaced else f"/{name}"


def floor_frame(floor: str) -> str:
    """The frame of a floor. floor: its name in ROS."""
    return f"floor/{floor}"

"""Robots, maps and recordings for ROS 2, and robots that speak it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robocorba.errors.services import ServiceError

if TYPE_CHECKING:
    from robocorba.bridges.ros2.node import RosNode


def ros_node(domain: int | None, name: str = "robocorba") -> RosNode:
    """A node of ROS 2. domain: None for the environment's. Raises ServiceError, also where ROS 2 is not installed."""
    try:
        from robocorba.bridges.ros2.node import RosNode
    except ImportError as error:
        raise ServiceError(
            f"ROS 2 is not installed in this Python ({error}): source its setup file, such as"
            " /opt/ros/jazzy/setup.bash, and use its Python; see docs/ros2.md"
        ) from None
    return RosNode(domain, name)

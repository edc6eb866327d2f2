"""Names of the physical bodies of robots and movable objects: those that nobody moves have none."""

from __future__ import annotations

#: Prefix of the names of robots' bodies.
_ROBOT = "robot/"


def robot_body(robot: str) -> str:
    """Name of a robot's body."""
    return f"{_ROBOT}{robot}"


def object_body(name: str) -> str:
    """Name of an object's body."""
    return f"object/{name}"


def is_robot(body: str) -> bool:
    """Whether a body is a robot's."""
    return body.startswith(_ROBOT)


def owner(body: str) -> str:
    """Name of the robot or object of a body."""
    return body.partition("/")[2]

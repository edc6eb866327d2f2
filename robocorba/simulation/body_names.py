"""Keys of bodies in the physics, which stay while they are there: those that nobody moves have none."""

from __future__ import annotations

#: Prefix of the keys of robots' bodies.
_ROBOT = "robot/"


def robot_body(robot: str) -> str:
    """Key of a robot's body: robots keep their names."""
    return f"{_ROBOT}{robot}"


def object_body(number: int) -> str:
    """Key of an object's body, by its number: edits of the map change names."""
    return f"object/{number}"


def is_robot(body: str) -> bool:
    """Whether a body is a robot's."""
    return body.startswith(_ROBOT)


def owner(body: str) -> str:
    """Name of the robot of a robot's body."""
    return body.partition("/")[2]

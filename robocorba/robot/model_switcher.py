"""The model switcher: lists the installed robot adaptors and creates one by its name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

from robocorba.errors.robots import UnknownAdaptor
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.session import BuildingSession
from robocorba.simulation.registry import Pose


class AdaptorContext(NamedTuple):
    """What the factory of an adaptor gets: the robot's name, its session in the building, and the process's ORB.
    last_pose: where a former process of the agent has left the robot, by which its odometry goes on; None if the
    session's pose is the robot's."""

    name: str
    session: BuildingSession
    orb: Any
    last_pose: Pose | None = None


def installed() -> list[str]:
    """Names of the installed adaptors, sorted."""
    return sorted(_found())


def make(name: str, context: AdaptorContext) -> RobotAdaptor:
    """Create an adaptor with the entry point of this name in the group `robocorba.adaptors`. Raises UnknownAdaptor."""
    found = _found()
    if name not in found:
        raise UnknownAdaptor(name, sorted(found))
    factory: Callable[[AdaptorContext], RobotAdaptor] = found[name].load()
    return factory(context)


def _found() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group="robocorba.adaptors")}


def argv_again(argv: Sequence[str]) -> list[str]:
    """Arguments for a later start: without `--pose`, where the robot was at the first one."""
    after = zip(argv, ["", *argv], strict=False)
    return [word for word, before in after if before != "--pose" and not f"{word}=".startswith("--pose=")]

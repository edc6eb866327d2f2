"""The robot adaptor: the control agent's interface to a virtual or an actual robot.

Its four methods are the paper's. A new kind of robot takes one subclass: see docs/adaptors.md."""

from __future__ import annotations

import argparse
import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NoReturn

from robocorba.errors.robots import AdaptorFailed
from robocorba.map_editor.spatial.frames import Frame
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.senses import Senses

#: `waits_for` of a robot that is its body in the simulated building.
SIMULATION_SERVER = "the simulation server"


class ArgumentParser(argparse.ArgumentParser):
    """Of an adaptor's arguments; raises AdaptorFailed for those that are wrong."""

    def __init__(self) -> None:
        super().__init__(add_help=False, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        raise AdaptorFailed(f"the adaptor's arguments: {message}")


def frame_argument(text: str) -> Frame:
    """The type of an argument X,Y,HEADING [m, rad]."""
    with contextlib.suppress(ValueError):
        x, y, heading = map(float, text.split(","))
        if all(map(math.isfinite, (x, y, heading))):
            return x, y, heading
    raise argparse.ArgumentTypeError(f"{text[:60]!r} is not three numbers with commas between them")


def was_reset(pose: Frame, before: Frame) -> bool:
    """Whether odometry began again, as after a switch of the robot: it differs by more than a robot moves that is
    disconnected."""
    return math.dist(pose[:2], before[:2]) > 0.5 or abs(math.remainder(pose[2] - before[2], math.tau)) > 0.5


class RobotAdaptor(ABC):
    """Each method returns True if it did what was requested. False means that the call is invalid now, such as `write`
    before `start`, and had no effect. Faults of the robot raise AdaptorFailed with the cause.

    `stop` may be called by any thread at any time, all other methods by one thread. No call except `start` takes longer
    than a second."""

    #: Whether the robot is its body in the simulated building; otherwise the control agent makes that body follow it.
    is_in_building = False
    #: Whose answers `read` and `write` wait for, in messages to users.
    waits_for = "the robot's adaptor"
    #: What the robot senses; None for a robot without sensors. Known once the adaptor has started.
    senses: Senses | None = None

    @abstractmethod
    def start(self, argv: Sequence[str]) -> bool:
        """Connect to the robot, switch it on, and read its position. False if it is started already."""

    @abstractmethod
    def stop(self) -> bool:
        """Stop the robot as soon as possible, even while another method hangs, and disconnect. False if it is not
        started."""

    @abstractmethod
    def read(self, state: RobotState) -> bool:
        """Fill in the robot's state."""

    @abstractmethod
    def write(self, command: ActorCommand) -> bool:
        """Send a command to the robot."""

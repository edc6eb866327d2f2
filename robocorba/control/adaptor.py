"""The robot adaptor: what the control agent asks of a robot, virtual or actual.

Its four methods are the paper's. A new kind of robot is one class of its own: see docs/adaptors.md."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from robocorba.motion.robot_state import ActorCommand, RobotState


class RobotAdaptor(ABC):
    """Each method answers whether it did what was asked: False where the order makes no sense now, such as to write
    before the start, and nothing was done. What goes wrong with the robot raises AdaptorFailed, which names the cause.

    `stop` may be called by any thread, at any time; everything else by one thread. No call takes longer than a second,
    but `start`."""

    #: Whether the robot is its body in the simulated building; else the control agent leads that body after it.
    is_in_building = False

    @abstractmethod
    def start(self, argv: Sequence[str]) -> bool:
        """Take the robot over: find it, switch it on, learn where it is. False if it was started already."""

    @abstractmethod
    def stop(self) -> bool:
        """Let the robot stand as soon as it can, also while another method hangs, and let go of it. False if it was not
        started."""

    @abstractmethod
    def read(self, state: RobotState) -> bool:
        """Fill in how the robot is."""

    @abstractmethod
    def write(self, command: ActorCommand) -> bool:
        """Tell the robot what to do now."""

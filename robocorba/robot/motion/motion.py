"""The interface of motions, which the high controller calls in each control cycle."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, RobotState, Velocity


class MotionCommand(NamedTuple):
    """What a motion commands in one control cycle.

    velocity: of the base, ahead and to the left [m/s], turn [rad/s]. joints (n,) [rad] and joint_velocities (n,)
    [rad/s]; None keeps the joints' last targets. awaited: what the motion waits for; empty if it gets on."""

    velocity: Velocity = ZERO_VELOCITY
    joints: Floats | None = None
    joint_velocities: Floats | None = None
    awaited: str = ""


class Motion(Protocol):
    """One movement of the robot, used once."""

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        """The command for this cycle; None once the motion has ended. Raises MotionFailed.

        elapsed_s: since its start, without pauses."""

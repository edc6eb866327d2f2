"""What a motion is: asked with every tick what the robot shall do next, from where it is."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from robocorba.motion.robot_state import STANDING, RobotState, Velocity
from robocorba.spatial.grids import Floats


class Wish(NamedTuple):
    """velocity: of the base, m/s ahead and to the left, rad/s. joints (n,), rad, and their velocities, rad/s: None
    leaves them where they were told to be."""

    velocity: Velocity = STANDING
    joints: Floats | None = None
    joint_velocities: Floats | None = None


class Motion(Protocol):
    """One movement of the robot, used once."""

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        """What to do now; None: it has ended. elapsed_s: since it began, without pauses. Raises MotionFailed."""

"""What an adaptor reads from a robot, and what it is told to write: the paper's robot_state and actor_command."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from robocorba.spatial.grids import Floats

Velocity = tuple[float, float, float]
STANDING: Velocity = (0.0, 0.0, 0.0)


def _none() -> Floats:
    return np.zeros(0)


@dataclass
class RobotState:
    """How a robot is; `RobotAdaptor.read` fills it in.

    time: when it was so, s, of the robot's own clock. x, y (m) and heading (rad): of the base in the building's frame.
    velocity: of the base in its own frame, m/s ahead and to the left, rad/s.
    joints, joint_velocities: rad and rad/s, in the order of the robot's model; empty for a robot without any."""

    time: float = 0.0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    velocity: Velocity = STANDING
    joints: Floats = field(default_factory=_none)
    joint_velocities: Floats = field(default_factory=_none)


@dataclass(frozen=True)
class ActorCommand:
    """What a robot shall do until the next command, at most for `valid_s`; after that it stops by itself.

    velocity: of the base, as in RobotState. joints: where they shall be now, rad, moving on at `joint_velocities`,
    rad/s; empty arrays leave them as they are."""

    velocity: Velocity = STANDING
    joints: Floats = field(default_factory=_none)
    joint_velocities: Floats = field(default_factory=_none)
    valid_s: float = 0.1

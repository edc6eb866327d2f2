"""The state that an adaptor reads and the command that it writes: the paper's robot_state and actor_command."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats

Velocity = tuple[float, float, float]
ZERO_VELOCITY: Velocity = (0.0, 0.0, 0.0)


@dataclass
class RobotState:
    """State of a robot; `RobotAdaptor.read` fills it in.

    time: of the observation, by the robot's own clock [s]. x, y [m] and heading [rad]: of the base in the building's
    frame. velocity: of the base in its own frame, ahead and to the left [m/s], turn [rad/s].
    joints, joint_velocities: [rad] and [rad/s], in the order of the robot's model; empty for a robot without joints."""

    time: float = 0.0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    velocity: Velocity = ZERO_VELOCITY
    joints: Floats = field(default_factory=lambda: np.zeros(0))
    joint_velocities: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class ActorCommand:
    """Command of one control cycle, valid until the next one, at most for `valid_s`; then the robot stops.

    velocity: of the base, as in RobotState. joints: present targets [rad], which advance at `joint_velocities` [rad/s];
    empty arrays leave the joints as they are."""

    velocity: Velocity = ZERO_VELOCITY
    joints: Floats = field(default_factory=lambda: np.zeros(0))
    joint_velocities: Floats = field(default_factory=lambda: np.zeros(0))
    valid_s: float = 0.1

"""Movements of a robot's arms, lumbar and grippers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import out_of
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.smartpal import GRIP, JOINT_ACCELERATION, JOINT_SPEED, JOINTS, Side
from robocorba.robot.motion.joint_motion import GripMotion, JointMotion
from robocorba.robot.movements import Movements


class ArmMovements(Movements):
    """Mixin of Robot, which sets the attributes."""

    kinematics: InverseKinematics
    #: Names of the objects that the hands hold in the building.
    _held: dict[Side, str]

    @property
    def joints(self) -> Floats:
        """The joints' targets (18,) [rad]. Raises MotionFailed for a robot without SmartPal's joints."""
        joints = self.controller.targets
        if len(joints) != len(JOINTS):
            raise MotionFailed(f"this robot has {len(joints)} joints, not SmartPal's {len(JOINTS)}")
        return joints

    def move_joints_along(self, postures: Sequence[Floats], seconds: float = 0.0) -> None:
        """Move all joints along postures, (18,) each [rad]. seconds: least duration."""
        waypoints = np.array([self.joints, *postures])
        self.move(JointMotion(waypoints, JOINTS, JOINT_SPEED, JOINT_ACCELERATION, seconds))

    def grip(self, sides: Sequence[Side], angle: float, force_n: float | None = None, object_name: str = "") -> None:
        """Move grippers to an angle [rad], with at most `force_n` [N]. object_name: an object to hold at the hand's
        position, or empty. Also raises CannotGrip."""
        wanted = self.joints.copy()
        wanted[[GRIP[side] for side in sides]] = angle
        fingers = [GRIP[side] for side in sides]
        self.move(GripMotion(self.joints, wanted, fingers, JOINTS, JOINT_SPEED, JOINT_ACCELERATION, force_n))
        if object_name:
            state = self.controller.state
            hand = self.kinematics.body.hand(sides[0], state.joints)
            self.hold(object_name, *out_of(hand.x, hand.y, (state.x, state.y, state.heading)))
            self._held.update(dict.fromkeys(sides, object_name))

    def hold(self, object_name: str, x: float, y: float) -> None:
        """Hold an object at a point (x, y) [m] of the floor. Raises CannotGrip."""
        self.session.grip(object_name, x, y)
        self.session.state()  # the latest state now has the object

    def release(self, sides: Sequence[Side], angle: float) -> None:
        """Open grippers to an angle [rad], and release the objects of these hands."""
        held = [self._held.pop(side, "") for side in sides]
        if any(held) and not self._held:
            self.session.release()
        self.grip(sides, angle)

    def holds(self, side: Side) -> bool:
        """Whether a hand holds an object in the building."""
        return bool(self._held.get(side)) and bool(self.session.latest.holding)

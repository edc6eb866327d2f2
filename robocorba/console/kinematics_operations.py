"""Operations of the arm poser: where the hands are, and joints that bring a hand to a pose."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robocorba.console.arguments import is_number
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import JOINTS, Side

if TYPE_CHECKING:
    from robocorba.robot.kinematics.inverse import InverseKinematics

Pose = dict[str, float]


class InvalidPosture(RoboCorbaError):
    """Joints, a side or a pose that are not what the operation needs."""


class KinematicsOperations:
    """Operations of the arm poser. Poses are in the robot's frame [m, rad] with the keys x, y, z, roll, pitch, yaw;
    joints are 18 angles [rad] in the order of the model."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inverse: InverseKinematics | None = None

    def solve_hand(
        self,
        joints: Sequence[float],
        side: str,
        pose: Mapping[str, float],
        with_attitude: bool = True,
        use_lumbar: bool = False,
    ) -> dict[str, object]:
        """`joints` that bring a hand to a pose, as near to the given ones as possible, and both `hands` there.

        side: left, right, or both: the pose is the left hand's, the right hand mirrors it. Raises Unreachable."""
        seed, target = _joints(joints), _pose(pose)
        targets = {Side.LEFT: target, Side.RIGHT: target.mirrored()} if side == "both" else {_side(side): target}
        with self._lock:
            inverse = self._solver()
            options = {"with_attitude": bool(with_attitude), "use_lumbar": bool(use_lumbar)}
            try:
                found = inverse.solve(targets, seed, allow_restarts=False, **options)
            except Unreachable:
                found = inverse.solve(targets, seed, **options)
            return {"joints": found.tolist(), "hands": _hands(inverse, found)}

    def hand_poses(self, joints: Sequence[float]) -> dict[str, Pose]:
        """Poses of the `left` and the `right` hand."""
        checked = _joints(joints)
        with self._lock:
            return _hands(self._solver(), checked)

    def arm_postures(self) -> dict[str, list[float]]:
        """The named postures: 7 angles of an arm each [rad]."""
        from robocorba.robot.kinematics.tasks import POSTURES

        return {name: posture.tolist() for name, posture in POSTURES.items()}

    def _solver(self) -> InverseKinematics:
        if self._inverse is None:
            from robocorba.robot.kinematics.inverse import InverseKinematics  # here, since it loads the physics engine

            self._inverse = InverseKinematics()
        return self._inverse


def _hands(inverse: InverseKinematics, joints: Floats) -> dict[str, Pose]:
    return {side.value: inverse.body.hand(side, joints)._asdict() for side in Side}


def _joints(values: object) -> Floats:
    if not isinstance(values, Sequence) or len(values) != len(JOINTS) or not all(map(is_number, values)):
        raise InvalidPosture(f"joints: {len(JOINTS)} angles are needed")
    return np.array(values, float)


def _pose(values: object) -> HandPose:
    if not isinstance(values, Mapping) or not {"x", "y", "z"} <= values.keys() <= set(HandPose._fields):
        raise InvalidPosture("pose: x, y and z are needed, and roll, pitch, yaw are possible")
    for name, value in values.items():
        if not is_number(value):
            raise InvalidPosture(f"pose: {name} is not a number")
    return HandPose(**values)


def _side(name: object) -> Side:
    try:
        return Side(name)
    except ValueError:
        raise InvalidPosture(f"side: {str(name)[:80]!r} is not left, right or both") from None

"""Checks of the arms in a program: hands reach their poses, and no links collide during a motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robocorba.errors.robots import InvalidProgram, Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import JOINTS, LUMBAR
from robocorba.robot.programs.hands import TARGET_PARAMETERS, HandIcon, home, joint_path, joints_of
from robocorba.robot.programs.icons import CooperativeIcon, Gripper, Icon, MhandOffset, MhandPose
from robocorba.robot.programs.report import CheckReport

if TYPE_CHECKING:
    from robocorba.robot.kinematics.body import SmartPalBody
    from robocorba.robot.kinematics.inverse import InverseKinematics


class KnownArms(NamedTuple):
    """What a check knows of the joints (18,) between two icons: their angles [rad], and whether each is known. Unknown
    joints have the angles of the home posture."""

    joints: tuple[float, ...]
    is_known: tuple[bool, ...] = (True,) * len(JOINTS)

    def with_unknown(self, joints: Iterable[int]) -> KnownArms:
        """The same, with some joints unknown."""
        values, known, at_home = list(self.joints), list(self.is_known), home().tolist()
        for joint in joints:
            values[joint], known[joint] = at_home[joint], False
        return KnownArms(tuple(values), tuple(known))

    def merged_with(self, other: KnownArms) -> KnownArms:
        """What is known if either state is possible: the joints that are equal in both."""
        one, two = (list(zip(arms.joints, arms.is_known, strict=True)) for arms in (self, other))
        return self.with_unknown(joint for joint in range(len(JOINTS)) if one[joint] != two[joint])

    @property
    def is_body_known(self) -> bool:
        """Whether arms and lumbar are known, the joints that determine collisions."""
        return all(self.is_known[: LUMBAR.stop])


class ArmChecks:
    """Tracks the arms through a program, and reports impossible motions. Without kinematics it only tracks.

    joints: the robot's angles at the start [rad]; None for the home posture."""

    def __init__(self, report: CheckReport, kinematics: InverseKinematics | None, joints: Floats | None = None) -> None:
        self._report, self._kinematics = report, kinematics
        #: Why this robot can't move arms, or empty.
        self._reason = "" if joints is None else _reason_against(joints)
        start = home() if joints is None or self._reason else joints
        self.start = KnownArms(tuple(start.tolist()))

    def after(self, path: str, icon: Icon, arms: KnownArms) -> KnownArms:
        """The arms after an icon that contains no others."""
        if not isinstance(icon, HandIcon | CooperativeIcon):
            return arms
        needs_arms = icon.needs_arms if isinstance(icon, CooperativeIcon) else True
        if self._reason and needs_arms:
            self._report.add_finding(path, "icon", self._reason)
            return arms
        if isinstance(icon, CooperativeIcon):
            return arms.with_unknown(range(len(JOINTS)))
        unknown = arms.with_unknown(joints_of(icon))
        if not self._kinematics:
            return unknown
        if isinstance(icon, MhandOffset) and not arms.is_body_known:
            self._report.add_note(path, "the start of the hand is unknown: this motion is not checked")
            return unknown
        try:
            postures = joint_path(icon, np.array(arms.joints), self._kinematics)
        except Unreachable as error:
            self._report.add_finding(path, TARGET_PARAMETERS[type(icon)], str(error))
            return unknown
        except InvalidProgram as error:
            self._report.add_finding(path, error.parameter, error.reason)
            return unknown
        known = list(arms.is_known)
        for joint in joints_of(icon):
            # Many postures have the same hand pose; which one results depends on the start.
            known[joint] = arms.is_body_known or not isinstance(icon, MhandPose)
        end = KnownArms(tuple(postures[-1].tolist()), tuple(known))
        if isinstance(icon, Gripper) or self._is_clear(path, icon, arms, postures, end, self._kinematics.body):
            return end
        return unknown

    def _is_clear(
        self,
        path: str,
        icon: HandIcon,
        start: KnownArms,
        postures: Sequence[Floats],
        end: KnownArms,
        body: SmartPalBody,
    ) -> bool:
        """Whether no links collide that did not collide at the start, as far as the joints are known; reports a
        collision."""
        checked: Iterable[Floats] = postures[-1:] if end.is_body_known else ()
        colliding_before: set[tuple[str, str]] = set()
        if start.is_body_known:
            joints = np.array(start.joints)
            checked, colliding_before = _interpolated(joints, postures), set(body.collisions(joints))
        else:
            self._report.add_note(path, "the start of the arms is unknown: collisions on the way are not checked")
        for posture in checked:
            if colliding := set(body.collisions(posture)) - colliding_before:
                one, other = min(colliding)
                where = "at the end" if posture is postures[-1] else "during the motion"
                self._report.add_finding(path, TARGET_PARAMETERS[type(icon)], f"{where} {one} collides with {other}")
                return False
        return True


def _reason_against(joints: Floats) -> str:
    """Why a robot with these joints [rad] can't move SmartPal's arms; empty if it can."""
    if len(joints) != len(JOINTS):
        return f"this robot has {len(joints)} joints, not SmartPal's {len(JOINTS)}"
    return "" if np.isfinite(joints).all() else "the robot reports joint angles that are not finite numbers"


def _interpolated(start: Floats, postures: Sequence[Floats]) -> Iterator[Floats]:
    """Postures on the path from `start` through `postures`, these included, at most 2 degrees of a joint apart."""
    for goal in postures:
        count = math.ceil(float(np.abs(goal - start).max()) / math.radians(2))
        for number in range(1, count):
            yield start + number / count * (goal - start)
        yield goal
        start = goal

"""Checks of the arms in a program: hands reach their poses, and no link collides with the body on the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from robocorba.errors.robots import InvalidProgram, Unreachable
from robocorba.kinematics.smartpal import JOINTS, LUMBAR
from robocorba.programs.hands import BodyModel, HandIcon, Kinematics, home, joints_of, way
from robocorba.programs.icons import (
    Gripper,
    HandOver,
    Icon,
    Lumbar,
    MhandJoints,
    MhandOffset,
    MhandPose,
    MhandPosture,
    MoveTable,
)
from robocorba.programs.report import CheckReport
from robocorba.spatial.grids import Floats

#: Greatest change of a joint between two tested postures [rad].
_STEP_RAD = math.radians(2)
#: Parameters of each icon that determine the target joints.
_GOAL: dict[type, str] = {
    MhandPose: "x, y, z",
    MhandOffset: "dx, dy, dz",
    MhandJoints: "joints",
    MhandPosture: "posture",
    Lumbar: "lower, upper",
}


class ArmsAt(NamedTuple):
    """Joints (18,) after a part of a program, and which of them are known; unknown joints have the angles of the
    home posture."""

    joints: tuple[float, ...]
    is_known: tuple[bool, ...] = (True,) * len(JOINTS)

    def with_unknown(self, joints: Iterable[int], home: Floats) -> ArmsAt:
        """The same with some joints unknown."""
        values, known = list(self.joints), list(self.is_known)
        for joint in joints:
            values[joint], known[joint] = float(home[joint]), False
        return ArmsAt(tuple(values), tuple(known))

    def or_at(self, other: ArmsAt, home: Floats) -> ArmsAt:
        """Joints that are equal in both stay known; the others become unknown."""
        here, there = (list(zip(at.joints, at.is_known, strict=True)) for at in (self, other))
        return self.with_unknown((joint for joint in range(len(JOINTS)) if here[joint] != there[joint]), home)

    @property
    def is_body_known(self) -> bool:
        """Whether arms and lumbar, the joints that decide about collisions, are known."""
        return all(self.is_known[: LUMBAR.stop])


class ArmChecks:
    """Follows the arms through a program and reports what is impossible. Without kinematics it checks nothing."""

    def __init__(self, report: CheckReport, kinematics: Kinematics | None, postures: Mapping[str, Floats]) -> None:
        self._report, self._kinematics, self._postures = report, kinematics, postures
        self.home = home(postures)

    def after(self, path: str, icon: Icon, at: ArmsAt) -> ArmsAt:
        """Where the arms are after an icon that contains no others."""
        if isinstance(icon, MoveTable | HandOver):
            return at.with_unknown(range(len(JOINTS)), self.home)
        if not isinstance(icon, HandIcon):
            return at
        lost = at.with_unknown(joints_of(icon), self.home)
        if not self._kinematics:
            return lost
        if isinstance(icon, MhandOffset) and not at.is_body_known:
            self._report.note(path, "the start of the hand is unknown: not proved that it can move like this")
            return lost
        try:
            steps = way(icon, np.array(at.joints), self._kinematics, self._postures)
        except Unreachable as error:
            self._report.find(path, _GOAL[type(icon)], str(error))
            return lost
        except InvalidProgram as error:
            self._report.find(path, error.parameter, error.reason)
            return lost
        known = list(at.is_known)
        for joint in joints_of(icon):
            # Many postures hold a hand in a pose; the start decides which one results.
            known[joint] = at.is_body_known or not isinstance(icon, MhandPose)
        end = ArmsAt(tuple(steps[-1].tolist()), tuple(known))
        if isinstance(icon, Gripper) or self._is_clear(path, icon, at, steps, end, self._kinematics.body):
            return end
        return lost

    def _is_clear(
        self, path: str, icon: HandIcon, at: ArmsAt, steps: Sequence[Floats], end: ArmsAt, body: BodyModel
    ) -> bool:
        """Whether no links collide that did not collide before, as far as the joints are known; reports a collision."""
        postures: Iterable[Floats] = steps[-1:] if end.is_body_known else ()
        before: set[tuple[str, str]] = set()
        if at.is_body_known:
            start = np.array(at.joints)
            postures, before = _between(start, steps), set(body.collisions(start))
        else:
            self._report.note(path, "the start of the arms is unknown: not proved that their path is clear")
        for posture in postures:
            if touching := set(body.collisions(posture)) - before:
                one, other = min(touching)
                where = "at the end" if posture is steps[-1] else "on the way"
                self._report.find(path, _GOAL[type(icon)], f"{where} {one} runs into {other}")
                return False
        return True


def _between(start: Floats, steps: Sequence[Floats]) -> Iterator[Floats]:
    """Postures along the path through the steps, the steps included."""
    for goal in steps:
        count = math.ceil(float(np.abs(goal - start).max()) / _STEP_RAD)
        for number in range(1, count):
            yield start + number / count * (goal - start)
        yield goal
        start = goal

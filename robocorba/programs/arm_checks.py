"""What can be proved of the arms: that hands get where they shall, and nothing runs into the own body on the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from robocorba.errors.robots import InvalidProgram, Unreachable
from robocorba.kinematics.smartpal import JOINTS, LUMBAR
from robocorba.programs.hands import Body, HandIcon, Kinematics, home, joints_of, way
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
from robocorba.programs.report import Report
from robocorba.spatial.grids import Floats

#: Between two postures that are looked at, no joint moves more than this.
_STEP_RAD = math.radians(2)
#: Which parameters tell where joints go.
_GOAL: dict[type, str] = {
    MhandPose: "x, y, z",
    MhandOffset: "dx, dy, dz",
    MhandJoints: "joints",
    MhandPosture: "posture",
    Lumbar: "lower, upper",
}


class ArmsAt(NamedTuple):
    """Joints that the program has brought the arms to, and which of them are known; the others are taken for those of
    the home posture. Both (18,)."""

    joints: tuple[float, ...]
    is_known: tuple[bool, ...] = (True,) * len(JOINTS)

    def with_unknown(self, joints: Iterable[int], home: Floats) -> ArmsAt:
        """Some of them have gone, nobody knows where."""
        values, known = list(self.joints), list(self.is_known)
        for joint in joints:
            values[joint], known[joint] = float(home[joint]), False
        return ArmsAt(tuple(values), tuple(known))

    def or_at(self, other: ArmsAt, home: Floats) -> ArmsAt:
        """Either here or there."""
        here, there = (list(zip(at.joints, at.is_known, strict=True)) for at in (self, other))
        return self.with_unknown((joint for joint in range(len(JOINTS)) if here[joint] != there[joint]), home)

    @property
    def is_body_known(self) -> bool:
        """Arms and lumbar: what may run into each other."""
        return all(self.is_known[: LUMBAR.stop])


class ArmChecks:
    """Follows the arms through a program, and tells a report what can't be. Without kinematics it proves nothing."""

    def __init__(self, report: Report, kinematics: Kinematics | None, postures: Mapping[str, Floats]) -> None:
        self._report, self._kinematics, self._postures = report, kinematics, postures
        self.home = home(postures)

    def after(self, path: str, icon: Icon, at: ArmsAt) -> ArmsAt:
        """Where the arms are after an icon that holds no others."""
        if isinstance(icon, MoveTable | HandOver):
            return at.with_unknown(range(len(JOINTS)), self.home)
        if not isinstance(icon, HandIcon):
            return at
        lost = at.with_unknown(joints_of(icon), self.home)
        if not self._kinematics:
            return lost
        if isinstance(icon, MhandOffset) and not at.is_body_known:
            self._report.note(path, "nobody knows where the hand begins: not proved that it can move like this")
            return lost
        try:
            steps = way(icon, np.array(at.joints), self._kinematics, self._postures)
        except Unreachable as wrong:
            self._report.find(path, _GOAL[type(icon)], str(wrong))
            return lost
        except InvalidProgram as wrong:
            self._report.find(path, wrong.parameter, wrong.reason)
            return lost
        known = list(at.is_known)
        for joint in joints_of(icon):
            # Of all the ways to hold a hand in a pose, which one it will be depends on where it comes from.
            known[joint] = at.is_body_known or not isinstance(icon, MhandPose)
        end = ArmsAt(tuple(steps[-1].tolist()), tuple(known))
        if isinstance(icon, Gripper) or self._is_clear(path, icon, at, steps, end, self._kinematics.body):
            return end
        return lost

    def _is_clear(
        self, path: str, icon: HandIcon, at: ArmsAt, steps: Sequence[Floats], end: ArmsAt, body: Body
    ) -> bool:
        """Whether nothing runs into anything, as far as anybody knows; tells what does, unless it did before."""
        postures: Iterable[Floats] = steps[-1:] if end.is_body_known else ()
        before: set[tuple[str, str]] = set()
        if at.is_body_known:
            start = np.array(at.joints)
            postures, before = _between(start, steps), set(body.collisions(start))
        else:
            self._report.note(path, "nobody knows where the arms begin: not proved that their way is clear")
        for posture in postures:
            if touching := set(body.collisions(posture)) - before:
                one, other = min(touching)
                where = "at its end" if posture is steps[-1] else "on its way"
                self._report.find(path, _GOAL[type(icon)], f"{where} {one} runs into {other}")
                return False
        return True


def _between(start: Floats, steps: Sequence[Floats]) -> Iterator[Floats]:
    """Postures on the way through some, these among them."""
    for goal in steps:
        count = math.ceil(float(np.abs(goal - start).max()) / _STEP_RAD)
        for number in range(1, count):
            yield start + number / count * (goal - start)
        yield goal
        start = goal

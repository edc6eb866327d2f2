"""Proves before a run what can be proved of a program, and says what could not be.

It goes through the icons as a run would, and keeps in mind where each of them leaves the base and the arms. Where
several ways lead on, only what all of them agree on is known after it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from robocorba.kinematics.smartpal import BASE
from robocorba.kinematics.tasks import POSTURES
from robocorba.planning.request import Place
from robocorba.programs.arm_checks import ArmChecks, ArmsAt
from robocorba.programs.base_checks import BaseAt, BaseChecks, Planner
from robocorba.programs.hands import Kinematics
from robocorba.programs.icons import (
    Branch,
    CloserThan,
    FartherThan,
    Gripper,
    Icon,
    MbaseVelocity,
    MhandPose,
    Repeat,
    Result,
    StopIfCloser,
    WaitUntil,
    range_m,
)
from robocorba.programs.program import Program, walk
from robocorba.programs.report import Report
from robocorba.spatial.grids import Floats

#: How often a check looks at icons, those in repeats more than once.
MOST_LOOKS = 4000
#: Whoever has more to mend begins with these.
MOST_FINDINGS = 100


class Start(NamedTuple):
    """Where the robot is when the program begins, as far as anybody knows: joints (18,), None for upright with both
    arms in the posture `home`."""

    place: Place | None = None
    heading: float | None = None
    joints: Floats | None = None


NOWHERE = Start()


def check(
    program: Program,
    kinematics: Kinematics | None = None,
    planner: Planner | None = None,
    start: Start = NOWHERE,
    postures: Mapping[str, Floats] = POSTURES,
) -> Report:
    """What is wrong with a program that `loads` let through, and what could not be proved.

    kinematics: an InverseKinematics; without it nothing is proved of hands. planner: a PathPlanner; without it nothing
    of the base. Raises only what a planner raises that can't be reached."""
    report = Report()
    if kinematics is None:
        report.note("", "there is no kinematics: nothing is proved of the arms")
    elif start.joints is None:
        report.note("", "the robot is taken to stand upright with its arms in the posture home when it begins")
    if planner is None:
        report.note("", "there is no map: nothing is proved of the base")
    for path, icon in walk(program):
        _check_alone(path, icon, report)
    _Walk(report, kinematics, planner, postures).through(program, start)
    return report


def require(
    program: Program,
    kinematics: Kinematics | None = None,
    planner: Planner | None = None,
    start: Start = NOWHERE,
    postures: Mapping[str, Floats] = POSTURES,
) -> Report:
    """The same; raises InvalidProgram for the first thing that is wrong."""
    report = check(program, kinematics, planner, start, postures)
    for finding in report.findings:
        raise finding.error()
    return report


# ---- icons by themselves ----


def _check_alone(path: str, icon: Icon, report: Report) -> None:
    """Parameters that don't go together."""
    if isinstance(icon, MbaseVelocity) and math.hypot(icon.ahead, icon.left) > BASE.speed:
        report.find(path, "ahead, left", f"together they are faster than {BASE.speed:g} m/s")
    if isinstance(icon, MhandPose):
        angles = {"roll": icon.roll, "pitch": icon.pitch, "yaw": icon.yaw}
        missing = [name for name, angle in angles.items() if angle is None]
        if 0 < len(missing) < len(angles):
            report.find(path, missing[0], "is missing: roll, pitch and yaw are given together, or none of them")
    if isinstance(icon, Gripper) and icon.action == "open":
        for name, value in (("force", icon.force), ("object", icon.object)):
            if value is not None:
                report.find(path, name, "is for closing")
    if isinstance(icon, StopIfCloser):
        _check_distance(path, "distance", icon.sensor, icon.distance, report)
    if isinstance(icon, WaitUntil | Branch) and isinstance(icon.condition, CloserThan | FartherThan):
        _check_distance(path, "condition.distance", icon.condition.sensor, icon.condition.distance, report)


def _check_distance(path: str, parameter: str, sensor: str, distance: float, report: Report) -> None:
    if distance > range_m(sensor):
        report.find(path, parameter, f"{sensor} sees no farther than {range_m(sensor):g} m")


# ---- icons one after the other ----


class _Situation(NamedTuple):
    """if_done: what is known if the icon before ended with the result `done`, where that is more."""

    arms: ArmsAt
    base: BaseAt
    if_done: _Situation | None = None


class _Walk:
    def __init__(
        self, report: Report, kinematics: Kinematics | None, planner: Planner | None, postures: Mapping[str, Floats]
    ) -> None:
        self._report = report
        self._arms = ArmChecks(report, kinematics, postures)
        self._base = BaseChecks(report, planner)
        self._looks = 0
        self._ended = ""

    def through(self, program: Program, start: Start) -> None:
        joints = self._arms.home if start.joints is None else start.joints
        base = BaseAt(start.place, start.heading, start.place is not None)
        self._icons("icons", program.icons, _Situation(ArmsAt(tuple(joints.tolist())), base))

    def _icons(self, at: str, icons: tuple[Icon, ...], now: _Situation) -> _Situation:
        for number, icon in enumerate(icons):
            now = self._icon(f"{at}[{number}]", icon, now)
        return now

    def _icon(self, path: str, icon: Icon, now: _Situation) -> _Situation:
        if self._is_over(path):
            return now
        if isinstance(icon, Repeat):
            return self._repeat(path, icon, now)._replace(if_done=None)
        if isinstance(icon, Branch):
            yes = no = now
            if now.if_done and icon.condition == Result("done"):
                yes = now.if_done
            elif now.if_done and icon.condition == Result("stopped"):
                no = now.if_done
            then = self._icons(f"{path}.then", icon.then, yes)
            return self._either(then, self._icons(f"{path}.otherwise", icon.otherwise, no))
        if isinstance(icon, StopIfCloser):
            # It may have been stopped anywhere; what it does not move is as before.
            done = self._icons(f"{path}.icons", icon.icons, now)
            return self._either(now, done)._replace(if_done=done._replace(if_done=None))
        return _Situation(self._arms.after(path, icon, now.arms), self._base.after(path, icon, now.base))

    def _is_over(self, path: str) -> bool:
        if not self._ended:
            self._looks += 1
            if self._looks > MOST_LOOKS:
                self._ended = f"{MOST_LOOKS} icons of repeats have been followed"
            elif len(self._report.findings) >= MOST_FINDINGS:
                self._ended = "so much is wrong"
            if self._ended:
                self._report.note(path, f"{self._ended}: nothing is proved from here on")
        return bool(self._ended)

    def _repeat(self, path: str, icon: Repeat, now: _Situation) -> _Situation:
        """Twice is enough where the second time leaves all as the first one did."""
        first = self._icons(f"{path}.icons", icon.icons, now)
        if icon.times == 1 or first == now:
            return first
        second = self._icons(f"{path}.icons", icon.icons, first)
        if icon.times == 2 or second == first:
            return second
        self._report.note(path, "each time leaves the robot elsewhere: proved for the first two times")
        return self._either(first, second)

    def _either(self, one: _Situation, other: _Situation) -> _Situation:
        return _Situation(one.arms.or_at(other.arms, self._arms.home), one.base.or_at(other.base))

"""Checks before a run what can be proved of a program, and notes what cannot.

The check follows the icons as a run would, and tracks where each of them leaves the base and the arms. After
alternatives only what is equal in all of them is known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from robocorba.kinematics.smartpal import BASE_LIMITS
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
from robocorba.programs.report import CheckReport
from robocorba.spatial.grids import Floats

#: Maximum number of icons that a check follows. Those in a repeat count as often as they are followed: twice at most.
MAX_ICONS_CHECKED = 4000
#: Number of findings after which a check ends.
MAX_FINDINGS = 100


class Start(NamedTuple):
    """What is known of the robot at the start: joints (18,), None for upright with both arms in the posture `home`."""

    place: Place | None = None
    heading: float | None = None
    joints: Floats | None = None


UNKNOWN_START = Start()


def check(
    program: Program,
    kinematics: Kinematics | None = None,
    planner: Planner | None = None,
    start: Start = UNKNOWN_START,
    postures: Mapping[str, Floats] = POSTURES,
) -> CheckReport:
    """What is wrong with a program that `loads` accepts, and what could not be proved.

    kinematics: an InverseKinematics; without it the hands are not checked. planner: a PathPlanner; without it the
    base is not checked. Raises only NotReachable, from a remote planner."""
    report = CheckReport()
    if kinematics is None:
        report.note("", "there is no kinematics: nothing is proved of the arms")
    elif start.joints is None:
        report.note("", "the robot is assumed upright with its arms in the posture home at the start")
    if planner is None:
        report.note("", "there is no map: nothing is proved of the base")
    for path, icon in walk(program):
        _check_alone(path, icon, report)
    _ProgramWalk(report, kinematics, planner, postures).through(program, start)
    return report


def require(
    program: Program,
    kinematics: Kinematics | None = None,
    planner: Planner | None = None,
    start: Start = UNKNOWN_START,
    postures: Mapping[str, Floats] = POSTURES,
) -> CheckReport:
    """Like `check`, but raises InvalidProgram for the first finding."""
    report = check(program, kinematics, planner, start, postures)
    for finding in report.findings:
        raise finding.error()
    return report


# ---- single icons ----


def _check_alone(path: str, icon: Icon, report: CheckReport) -> None:
    """Report parameters of one icon that contradict each other."""
    if isinstance(icon, MbaseVelocity) and math.hypot(icon.ahead, icon.left) > BASE_LIMITS.speed:
        report.find(path, "ahead, left", f"together they are faster than {BASE_LIMITS.speed:g} m/s")
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


def _check_distance(path: str, parameter: str, sensor: str, distance: float, report: CheckReport) -> None:
    if distance > range_m(sensor):
        report.find(path, parameter, f"{sensor} sees no farther than {range_m(sensor):g} m")


# ---- sequences of icons ----


class _RobotState(NamedTuple):
    """if_done: what is known in addition if the previous icon ended with the result `done`."""

    arms: ArmsAt
    base: BaseAt
    if_done: _RobotState | None = None


class _ProgramWalk:
    def __init__(
        self,
        report: CheckReport,
        kinematics: Kinematics | None,
        planner: Planner | None,
        postures: Mapping[str, Floats],
    ) -> None:
        self._report = report
        self._arms = ArmChecks(report, kinematics, postures)
        self._base = BaseChecks(report, planner)
        self._icons_checked = 0
        self._end_reason = ""

    def through(self, program: Program, start: Start) -> None:
        joints = self._arms.home if start.joints is None else start.joints
        base = BaseAt(start.place, start.heading, start.place is not None)
        self._icons("icons", program.icons, _RobotState(ArmsAt(tuple(joints.tolist())), base))

    def _icons(self, at: str, icons: tuple[Icon, ...], state: _RobotState) -> _RobotState:
        for number, icon in enumerate(icons):
            state = self._icon(f"{at}[{number}]", icon, state)
        return state

    def _icon(self, path: str, icon: Icon, state: _RobotState) -> _RobotState:
        if self._is_at_limit(path):
            return state
        if isinstance(icon, Repeat):
            return self._repeat(path, icon, state)._replace(if_done=None)
        if isinstance(icon, Branch):
            if_true = if_false = state
            if state.if_done and icon.condition == Result("done"):
                if_true = state.if_done
            elif state.if_done and icon.condition == Result("stopped"):
                if_false = state.if_done
            then = self._icons(f"{path}.then", icon.then, if_true)
            return self._either(then, self._icons(f"{path}.otherwise", icon.otherwise, if_false))
        if isinstance(icon, StopIfCloser):
            # It may stop anywhere; the joints and the base that it does not move are unchanged.
            done = self._icons(f"{path}.icons", icon.icons, state)
            return self._either(state, done)._replace(if_done=done._replace(if_done=None))
        return _RobotState(self._arms.after(path, icon, state.arms), self._base.after(path, icon, state.base))

    def _is_at_limit(self, path: str) -> bool:
        if not self._end_reason:
            self._icons_checked += 1
            if self._icons_checked > MAX_ICONS_CHECKED:
                self._end_reason = f"the check has followed {MAX_ICONS_CHECKED} icons"
            elif len(self._report.findings) >= MAX_FINDINGS:
                self._end_reason = f"the check has {MAX_FINDINGS} findings"
            if self._end_reason:
                self._report.note(path, f"{self._end_reason}: nothing is proved from here on")
        return bool(self._end_reason)

    def _repeat(self, path: str, icon: Repeat, state: _RobotState) -> _RobotState:
        """The state after a repeat, which is known if a repetition leaves the state unchanged."""
        first = self._icons(f"{path}.icons", icon.icons, state)
        if icon.times == 1 or first == state:
            return first
        second = self._icons(f"{path}.icons", icon.icons, first)
        if icon.times == 2 or second == first:
            return second
        self._report.note(path, "each repetition leaves the robot elsewhere: proved for the first two")
        return self._either(first, second)

    def _either(self, first_state: _RobotState, second_state: _RobotState) -> _RobotState:
        return _RobotState(
            first_state.arms.or_at(second_state.arms, self._arms.home), first_state.base.or_at(second_state.base)
        )

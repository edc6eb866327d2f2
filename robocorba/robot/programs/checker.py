"""Checks a program before it runs, and notes what it can't check.

The check follows the icons as a run would, and tracks the state of the base and the arms after each icon (an abstract
interpretation). After a branch only what is equal in both alternatives is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, get_args

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.planning.request import Place
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.kinematics.smartpal import BASE_LIMITS
from robocorba.robot.programs.arm_checks import ArmChecks, KnownArms
from robocorba.robot.programs.base_checks import BaseChecks, BaseIcon, KnownBase, Planner
from robocorba.robot.programs.hands import HandIcon
from robocorba.robot.programs.icons import (
    Branch,
    CloserThan,
    Confirm,
    CooperativeIcon,
    FartherThan,
    Gripper,
    Icon,
    MbaseVelocity,
    MhandPose,
    Repeat,
    Result,
    Say,
    Sensor,
    StopIfCloser,
    Wait,
    WaitUntil,
    kind,
    range_m,
)
from robocorba.robot.programs.program import Program, icons_with_paths
from robocorba.robot.programs.report import CheckReport

if TYPE_CHECKING:
    from robocorba.robot.kinematics.inverse import InverseKinematics

#: Maximum number of icons that a check follows. Icons in a repeat count each time they are followed, at most twice.
MAX_ICONS_CHECKED = 4000
#: The icons whose effect on base and arms the check knows, beside those that contain others.
FOLLOWED = BaseIcon | HandIcon | CooperativeIcon | Wait | WaitUntil | Confirm | Say


class Start(NamedTuple):
    """What is known of the robot at the start. heading: [rad]. joints (18,): [rad]; None if it is upright
    with both arms in the posture `home`. obstacles: the movable objects where they stand now, as far as they are known;
    the others are where the map has them. robots: other robots that stand still; a target there is noted. adaptor:
    behind which the robot is. ranges_m: what it senses, as `senses.program_ranges_m`."""

    place: Place | None = None
    heading: float | None = None
    joints: Floats | None = None
    obstacles: TemporaryObstacles = NO_OBSTACLES
    robots: TemporaryObstacles = NO_OBSTACLES
    adaptor: str = ""
    ranges_m: Mapping[str, float] = dict(zip(get_args(Sensor), map(range_m, get_args(Sensor)), strict=True))


UNKNOWN_START = Start()


def check(
    program: Program,
    kinematics: InverseKinematics | None = None,
    planner: Planner | None = None,
    start: Start = UNKNOWN_START,
) -> CheckReport:
    """Check a program that `loads` accepts.

    kinematics: an InverseKinematics; without it the arms are not checked. planner: a PathPlanner; without it the base
    is not checked. Raises only NotReachable, from a remote planner."""
    report = CheckReport()
    if kinematics is None:
        report.add_note("", "no robot model: the arms are not checked")
    elif start.joints is None:
        report.add_note("", "assumed at the start: the robot is upright, its arms are in the posture home")
    if planner is None:
        report.add_note("", "no map: the base is not checked")
    for path, icon in icons_with_paths(program):
        _check_alone(path, icon, report)
    check_sensors(program, report, start.adaptor, start.ranges_m)
    _Interpreter(report, kinematics, planner, start).run(program, start)
    return report


# ---- single icons ----


def _check_alone(path: str, icon: Icon, report: CheckReport) -> None:
    """Report parameters of one icon that contradict each other."""
    if isinstance(icon, MbaseVelocity) and (speed := math.hypot(icon.ahead, icon.left)) > BASE_LIMITS.speed:
        report.add_finding(
            path, "ahead, left", f"together {speed:.2f} m/s, above the limit of {BASE_LIMITS.speed:g} m/s"
        )
    if isinstance(icon, MhandPose):
        angles = {"roll": icon.roll, "pitch": icon.pitch, "yaw": icon.yaw}
        missing = [name for name, angle in angles.items() if angle is None]
        if 0 < len(missing) < len(angles):
            report.add_finding(path, missing[0], "is missing: roll, pitch and yaw are given together, or none of them")
    if isinstance(icon, Gripper) and icon.action == "open":
        for name, value in (("force", icon.force), ("object", icon.object)):
            if value is not None:
                report.add_finding(path, name, "only valid with the action close")


def check_sensors(program: Program, report: CheckReport, adaptor: str, ranges_m: Mapping[str, float]) -> None:
    """Report what a program senses and the robot does not. adaptor, ranges_m: as of a `Start`."""
    for path, icon in icons_with_paths(program):
        where = "condition." if isinstance(icon, WaitUntil | Branch) else ""
        sensing = icon.condition if isinstance(icon, WaitUntil | Branch) else icon
        if not isinstance(sensing, StopIfCloser | CloserThan | FartherThan):
            continue
        sensor, distance = sensing.sensor, sensing.distance
        if sensor not in ranges_m:
            has = ", ".join(ranges_m) or "no sensors"
            report.add_finding(path, f"{where}sensor", f"the adaptor {adaptor} has no sensor {sensor}; it has {has}")
        elif distance > ranges_m[sensor]:
            reason = f"{distance:g} m is beyond the range of {sensor}, {ranges_m[sensor]:g} m"
            report.add_finding(path, f"{where}distance", reason)


# ---- sequences of icons ----


class _KnownState(NamedTuple):
    """What is known of the robot between two icons. if_done: the state to use instead if the previous icon's result is
    `done`."""

    arms: KnownArms
    base: KnownBase
    if_done: _KnownState | None = None


class _Interpreter:
    """Follows a program, and adds findings and notes to the report."""

    def __init__(
        self, report: CheckReport, kinematics: InverseKinematics | None, planner: Planner | None, start: Start
    ) -> None:
        self._report = report
        self._arms = ArmChecks(report, kinematics, start.joints)
        self._base = BaseChecks(report, planner, start.obstacles, start.robots)
        self._icons_checked = 0
        self._end_reason = ""

    def run(self, program: Program, start: Start) -> None:
        base = KnownBase(start.place, start.heading, start.place is not None)
        self._icons("icons", program.icons, _KnownState(self._arms.start, base))

    def _icons(self, parent: str, icons: tuple[Icon, ...], state: _KnownState) -> _KnownState:
        for number, icon in enumerate(icons):
            state = self._icon(f"{parent}[{number}]", icon, state)
        return state

    def _icon(self, path: str, icon: Icon, state: _KnownState) -> _KnownState:
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
            return self._merged(then, self._icons(f"{path}.otherwise", icon.otherwise, if_false))
        if isinstance(icon, StopIfCloser):
            # It may stop anywhere; what its icons do not move is unchanged.
            done = self._icons(f"{path}.icons", icon.icons, state)
            return self._merged(state, done)._replace(if_done=done._replace(if_done=None))
        if not isinstance(icon, FOLLOWED):
            self._report.add_finding(path, "icon", f"unsupported icon type {kind(icon)}")
        return _KnownState(self._arms.after(path, icon, state.arms), self._base.after(path, icon, state.base))

    def _is_at_limit(self, path: str) -> bool:
        if not self._end_reason:
            self._icons_checked += 1
            if self._icons_checked > MAX_ICONS_CHECKED:
                self._end_reason = f"the check has followed {MAX_ICONS_CHECKED} icons, its limit"
            elif len(self._report.findings) >= 100:
                self._end_reason = "the check has 100 findings, its limit"
            if self._end_reason:
                self._report.add_note(path, f"{self._end_reason}: motions are not checked from here on")
        return bool(self._end_reason)

    def _repeat(self, path: str, icon: Repeat, state: _KnownState) -> _KnownState:
        """The state after a repeat, which is known if a repetition leaves the state unchanged."""
        first = self._icons(f"{path}.icons", icon.icons, state)
        if icon.times == 1 or first == state:
            return first
        second = self._icons(f"{path}.icons", icon.icons, first)
        if icon.times == 2 or second == first:
            return second
        self._report.add_note(path, "each repetition ends in another state: only the first two are checked")
        return self._merged(first, second)

    @staticmethod
    def _merged(one: _KnownState, other: _KnownState) -> _KnownState:
        """What is known if either state is possible."""
        return _KnownState(one.arms.merged_with(other.arms), one.base.merged_with(other.base))

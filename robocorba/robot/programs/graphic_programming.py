"""The graphic programming agent: specifies a robot's task as a list of icons, in Python, one method for each icon.

    fetch = ProgramBuilder("fetch")
    fetch.mhand_posture("both", "home")
    with fetch.stop_if_closer("laser", 0.4):
        fetch.mbase_path("L3", 10, 4)
    fetch.write("fetch.json")

Icons that contain others are context managers; all other methods return the builder, so that calls can be chained.
The classes in `icons` document the parameters; `program` checks them. The console's program page edits the same
programs in a browser."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import msgspec

from robocorba.robot.programs import icons
from robocorba.robot.programs.base_checks import Planner
from robocorba.robot.programs.checker import UNKNOWN_START, Start, check
from robocorba.robot.programs.hands import Kinematics
from robocorba.robot.programs.icons import Branch, Condition, Destination, Hand, Icon, Joints, Sensor
from robocorba.robot.programs.program import Program, checked, dumps
from robocorba.robot.programs.report import CheckReport


class ProgramBuilder:
    """A program under construction."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._icons: list[Icon] = []

    def program(self) -> Program:
        """The finished program. Raises InvalidProgram, which names icon and parameter."""
        return checked(Program(name=self._name, icons=tuple(self._icons)))

    def check(
        self, kinematics: Kinematics | None, planner: Planner | None, start: Start = UNKNOWN_START
    ) -> CheckReport:
        """Whether a robot at `start` can run the finished program. Raises InvalidProgram, and as `checker.check`."""
        return check(self.program(), kinematics, planner, start)

    def write(self, file: str | Path) -> None:
        """Write the finished program's file. Raises InvalidProgram, OSError."""
        Path(file).write_text(dumps(self.program()))

    # ---- the mobile base ----

    def mbase_path(
        self, floor: str, x: float, y: float, heading: float | None = None, speed: float | None = None
    ) -> ProgramBuilder:
        return self._add(icons.MbasePath(floor, x, y, heading, speed))

    def mbase_to(self, x: float, y: float, heading: float | None = None, speed: float | None = None) -> ProgramBuilder:
        return self._add(icons.MbaseTo(x, y, heading, speed))

    def mbase_by(
        self, ahead: float = 0.0, left: float = 0.0, turn: float = 0.0, speed: float | None = None
    ) -> ProgramBuilder:
        return self._add(icons.MbaseBy(ahead, left, turn, speed))

    def mbase_velocity(self, ahead: float, left: float, turn: float, seconds: float) -> ProgramBuilder:
        return self._add(icons.MbaseVelocity(ahead, left, turn, seconds))

    # ---- hands and body ----

    def mhand_joints(self, hand: Hand, joints: Sequence[float], seconds: float | None = None) -> ProgramBuilder:
        return self._add(icons.MhandJoints(hand, cast(Joints, tuple(joints)), seconds))

    def mhand_pose(
        self,
        hand: Hand,
        x: float,
        y: float,
        z: float,
        roll: float | None = None,
        pitch: float | None = None,
        yaw: float | None = None,
        seconds: float | None = None,
    ) -> ProgramBuilder:
        return self._add(icons.MhandPose(hand, x, y, z, roll, pitch, yaw, seconds))

    def mhand_offset(
        self, hand: Hand, dx: float = 0.0, dy: float = 0.0, dz: float = 0.0, seconds: float | None = None
    ) -> ProgramBuilder:
        return self._add(icons.MhandOffset(hand, dx, dy, dz, seconds))

    def mhand_posture(self, hand: Hand, posture: str, seconds: float | None = None) -> ProgramBuilder:
        return self._add(icons.MhandPosture(hand, posture, seconds))

    def lumbar(self, lower: float, upper: float, seconds: float | None = None) -> ProgramBuilder:
        return self._add(icons.Lumbar(lower, upper, seconds))

    def gripper(
        self,
        hand: Hand,
        action: icons.GripperAction,
        opening: float | None = None,
        force: float | None = None,
        object: str | None = None,
    ) -> ProgramBuilder:
        return self._add(icons.Gripper(hand, action, opening, force, object))

    # ---- control flow ----

    def wait_until(self, condition: Condition, seconds: float) -> ProgramBuilder:
        return self._add(icons.WaitUntil(condition, seconds))

    def stop_if_closer(self, sensor: Sensor, distance: float) -> contextlib.AbstractContextManager[None]:
        return self._containing(lambda body: icons.StopIfCloser(sensor, distance, body))

    def wait(self, seconds: float) -> ProgramBuilder:
        return self._add(icons.Wait(seconds))

    def repeat(self, times: int) -> contextlib.AbstractContextManager[None]:
        return self._containing(lambda body: icons.Repeat(times, body))

    def branch(self, condition: Condition) -> contextlib.AbstractContextManager[None]:
        return self._containing(lambda body: icons.Branch(condition, body))

    def otherwise(self) -> contextlib.AbstractContextManager[None]:
        """The icons that the preceding branch runs otherwise. Raises ValueError if there is none."""
        if not self._icons or not isinstance(self._icons[-1], Branch) or self._icons[-1].otherwise:
            raise ValueError("otherwise() comes after the end of a branch()")
        branch = self._icons.pop()
        return self._containing(lambda body: msgspec.structs.replace(branch, otherwise=body))

    # ---- events and missions ----

    def say(self, type: str, payload: Any = None) -> ProgramBuilder:
        return self._add(icons.Say(type, payload))

    def move_table(self, table: str, to: Destination, recovery_timeout: float | None = None) -> ProgramBuilder:
        return self._add(icons.MoveTable(table, to, recovery_timeout))

    def hand_over(
        self, object: str, taker: str, giver: str | None = None, recovery_timeout: float | None = None
    ) -> ProgramBuilder:
        return self._add(icons.HandOver(object, taker, giver, recovery_timeout))

    def _add(self, icon: Icon) -> ProgramBuilder:
        self._icons.append(icon)
        return self

    @contextlib.contextmanager
    def _containing(self, icon: Callable[[tuple[Icon, ...]], Icon]) -> Iterator[None]:
        outside, self._icons = self._icons, []
        try:
            yield
        finally:
            inside, self._icons = self._icons, outside
        self._icons.append(icon(tuple(inside)))

"""Runs a program: one icon after the other, each as movements of the robot, and tells how it ended."""

from __future__ import annotations

import contextlib
import fnmatch
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from functools import singledispatchmethod
from typing import Any, NamedTuple, Protocol

from robocorba.control.execution_control import LOOK_S, Aborted, SensorStop
from robocorba.control.robot import Robot
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MotionFailed
from robocorba.programs import hands, icons
from robocorba.programs.icons import Condition, Icon, Outcome, kind, sides
from robocorba.programs.program import Program, walk

#: Events that no condition has used up yet; the oldest go first.
MAX_EVENTS = 1000
#: Icons that began, and can still be asked for.
MAX_ICONS_BEGUN = 1000
#: Sensors that don't answer for so long end what they watch over, s.
BLIND_LIMIT_S = 1.0


class Result(Enum):
    """How a program ended."""

    NO_RESULT = 0
    DONE = 1
    ABORTED = 2
    FAILED = 3


class Report(NamedTuple):
    """Of a program that runs or has ended. icon: where it is, a path such as icons[2].then[0]; kind: of that icon.
    reason: why it did not end done. seconds: that it has taken."""

    name: str = ""
    result: Result = Result.NO_RESULT
    icon: str = ""
    kind: str = ""
    reason: str = ""
    icons_done: int = 0
    seconds: float = 0.0


class Begun(NamedTuple):
    """An icon that began, so many seconds after its program; numbers count from 0."""

    number: int
    icon: str
    kind: str
    seconds: float


class Heard(NamedTuple):
    """An event from the robot's channel."""

    type: str
    source: str
    payload: Any


class OtherRobots(Protocol):
    """The other robots: what the program tells them, and what it does together with them."""

    def listen(self, patterns: Sequence[tuple[str, str]], hear: Callable[[Heard], None]) -> None:
        """Call `hear` with events of these types and sources, and with no others. Raises EventError, NotReachable."""

    def say(self, type: str, payload: Any) -> None:
        """Tell them. Raises EventError, NotReachable."""

    def cooperate(self, icon: Icon) -> None:
        """Do a cooperative icon. Raises RobotError."""


class Runner:
    """One run of a program on a robot, by one thread; how it gets on may be asked by any."""

    def __init__(self, program: Program, robot: Robot, others: OtherRobots) -> None:
        self._program, self._robot, self._others = program, robot, others
        self._began = time.monotonic()
        self._report_so_far = Report(program.name)
        self._begun: deque[Begun] = deque(maxlen=MAX_ICONS_BEGUN)
        self._last: Outcome = "done"
        self._heard: deque[Heard] = deque(maxlen=MAX_EVENTS)

    @property
    def report(self) -> Report:
        """Now."""
        report = self._report_so_far
        if report.result is Result.NO_RESULT:
            return report._replace(seconds=time.monotonic() - self._began)
        return report

    def run(self) -> Report:
        """To the end; what goes wrong is in the report."""
        try:
            self._others.listen(_awaited(self._program), self._heard.append)
            self._body("icons", self._program.icons)
            self._report(result=Result.DONE, icon="", kind="")
        except Aborted as wrong:
            self._report(result=Result.ABORTED, reason=str(wrong))
        except RoboCorbaError as wrong:
            self._report(result=Result.FAILED, reason=str(wrong))
        except Exception as wrong:
            self._report(result=Result.FAILED, reason=f"{type(wrong).__name__}: {wrong}")
            raise
        return self.report

    def begun(self, first: int) -> list[Begun]:
        """Icons that have begun, from a number on. Safe from any thread."""
        return [each for each in list(self._begun) if each.number >= first]

    # ---- icons ----

    def _body(self, at: str, body: Sequence[Icon]) -> None:
        for number, icon in enumerate(body):
            path = f"{at}[{number}]"
            self._report(icon=path, kind=kind(icon))
            self._robot.course.at_icon()
            number = self._begun[-1].number + 1 if self._begun else 0
            self._begun.append(Begun(number, path, kind(icon), self.report.seconds))
            self._last = self._do(icon, path) or "done"
            self._report(icons_done=self.report.icons_done + 1)

    @singledispatchmethod
    def _do(self, icon: Any, path: str) -> Outcome | None:
        """Do an icon; its result where that is not `done`."""
        raise MotionFailed(f"nobody knows how to do {kind(icon)}")

    @_do.register
    def _(self, icon: icons.MbasePath, path: str) -> None:
        self._robot.drive_path(icon.floor, icon.x, icon.y, icon.heading, icon.speed or 0.0)

    @_do.register
    def _(self, icon: icons.MbaseTo, path: str) -> None:
        self._robot.drive_to(icon.x, icon.y, icon.heading, icon.speed or 0.0)

    @_do.register
    def _(self, icon: icons.MbaseBy, path: str) -> None:
        self._robot.drive_by(icon.ahead, icon.left, icon.turn, icon.speed or 0.0)

    @_do.register
    def _(self, icon: icons.MbaseVelocity, path: str) -> None:
        self._robot.drive_at((icon.ahead, icon.left, icon.turn), icon.seconds)

    @_do.register(icons.MhandJoints)
    @_do.register(icons.MhandPosture)
    @_do.register(icons.MhandPose)
    @_do.register(icons.MhandOffset)
    @_do.register(icons.Lumbar)
    def _(self, icon: Any, path: str) -> None:
        way = hands.way(icon, self._robot.joints, self._robot.kinematics)
        self._robot.joints_along(way, icon.seconds or 0.0)

    @_do.register
    def _(self, icon: icons.Gripper, path: str) -> None:
        if icon.action == "open":
            self._robot.release(sides(icon.hand), icon.angle_rad)
        else:
            self._robot.grip(sides(icon.hand), icon.angle_rad, icon.force, icon.object or "")

    @_do.register
    def _(self, icon: icons.WaitUntil, path: str) -> Outcome:
        return "done" if self._robot.wait(icon.seconds, lambda: self._is(icon.condition)) else "timed_out"

    @_do.register
    def _(self, icon: icons.Wait, path: str) -> None:
        self._robot.wait(icon.seconds)

    @_do.register
    def _(self, icon: icons.StopIfCloser, path: str) -> Outcome:
        is_stopped = False
        with self._watching(icon):
            try:
                self._body(f"{path}.icons", icon.icons)
            except SensorStop as stop:
                if stop.stop is not icon:
                    raise
                is_stopped = True
        if is_stopped:
            self._robot.stand()
        return "stopped" if is_stopped else "done"

    @_do.register
    def _(self, icon: icons.Repeat, path: str) -> None:
        for _ in range(icon.times):
            self._body(f"{path}.icons", icon.icons)

    @_do.register
    def _(self, icon: icons.Branch, path: str) -> Outcome:
        way = "then" if self._is(icon.condition) else "otherwise"
        self._body(f"{path}.{way}", getattr(icon, way))
        return self._last

    @_do.register
    def _(self, icon: icons.Say, path: str) -> None:
        self._others.say(icon.type, icon.payload)

    @_do.register(icons.MoveTable)
    @_do.register(icons.HandOver)
    def _(self, icon: Icon, path: str) -> None:
        self._others.cooperate(icon)

    # ---- conditions ----

    def _is(self, condition: Condition) -> bool:
        if isinstance(condition, icons.CloserThan):
            return self._robot.sensors.nearest_m(condition.sensor) < condition.distance
        if isinstance(condition, icons.FartherThan):
            return self._robot.sensors.nearest_m(condition.sensor) >= condition.distance
        if isinstance(condition, icons.Holding):
            return all(self._robot.holds(side) for side in sides(condition.hand))
        if isinstance(condition, icons.Result):
            return self._last == condition.result
        return self._use_up(condition)

    def _use_up(self, condition: icons.Event) -> bool:
        """Whether such an event has come; it counts once."""
        for event in list(self._heard):
            if _fits(event.type, condition.type) and _fits(event.source, condition.source):
                self._heard.remove(event)
                return True
        return False

    @contextlib.contextmanager
    def _watching(self, icon: icons.StopIfCloser) -> Iterator[None]:
        """A thread that looks at the sensor, and interrupts the course once it sees something too close."""
        ended = threading.Event()

        def watch() -> None:
            blind_since: float | None = None
            while not ended.wait(LOOK_S):
                try:
                    nearest = self._robot.sensors.nearest_m(icon.sensor)
                    blind_since = None
                except RoboCorbaError as wrong:
                    blind_since = blind_since or time.monotonic()
                    if time.monotonic() - blind_since > BLIND_LIMIT_S:
                        self._robot.course.interrupt(MotionFailed(f"the {icon.sensor} does not see: {wrong}"))
                        return
                    continue
                if nearest < icon.distance and not ended.is_set():
                    reason = f"the {icon.sensor} sees something at {nearest:.2f} m"
                    self._robot.course.interrupt(SensorStop(icon, reason))
                    return

        watcher = threading.Thread(target=watch, name="sensor stop", daemon=True)
        watcher.start()
        try:
            yield
        finally:
            ended.set()
            watcher.join()
            self._robot.course.settle(lambda why: isinstance(why, SensorStop) and why.stop is icon)

    def _report(self, **changes: Any) -> None:
        self._report_so_far = self.report._replace(seconds=time.monotonic() - self._began, **changes)


def _awaited(program: Program) -> list[tuple[str, str]]:
    """Types and sources of the events that a program waits for."""
    conditions = [icon.condition for _, icon in walk(program) if isinstance(icon, icons.WaitUntil | icons.Branch)]
    return sorted({(each.type, each.source) for each in conditions if isinstance(each, icons.Event)})


def _fits(text: str, pattern: str) -> bool:
    return re.fullmatch(fnmatch.translate(pattern.replace("[", "[[]")), text) is not None

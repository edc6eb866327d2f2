"""A robot's part in a mission: its SubPlan, each step at the leader's word, and what the leader is told of it."""

from __future__ import annotations

import threading
import time

from robocorba.control.execution_control import Aborted
from robocorba.control.robot import Robot
from robocorba.control.runner import Begun, Report, Result
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MissionFailed
from robocorba.missions.clock import LeaderClock
from robocorba.missions.execution import Performer, Places
from robocorba.missions.messages import Order, Proposal, Record, State
from robocorba.missions.rhythm import Rhythm

#: A leader that was not heard for so long is gone, s.
SILENT_S = 4.0
#: The leader has so long to end a mission in which we failed, s.
WORD_LIMIT_S = 5.0
_LOOK_S = 0.005


class Member:
    """One robot in one mission. `run` does the steps, in one thread; everything else is safe from any other.

    A task of a control agent: it has a report, and icons that began, which are the steps here."""

    def __init__(self, proposal: Proposal, robot: Robot, where: Places) -> None:
        self.mission, self.leader = proposal.mission, proposal.leader
        self._subplan, self._phases = proposal.subplan, proposal.phases
        self._robot = robot
        self.clock, self._rhythm = LeaderClock(), Rhythm()
        self._performer = Performer(robot, self._rhythm, self.clock, where)
        self._changed = threading.Condition()
        self._order = Order(mission=proposal.mission, leader=proposal.leader)
        self._heard_at = self._began = time.monotonic()
        self._step, self._is_done, self._began_at = -1, False, 0.0
        self._failed, self._ended = "", False
        self._late_at = float("inf")
        self._begun: list[Begun] = []
        self.report = Report(f"mission {self.mission}")

    @property
    def has_ended(self) -> bool:
        return self._ended

    # ---- what others say ----

    def follow(self, order: Order, came: float) -> None:
        """An order of the leader, which came then by our clock."""
        if order.leader != self.leader or order.mission != self.mission:
            return
        self._heard_at = time.monotonic()
        if self._subplan.robot in order.heard:
            sent, heard = order.heard[self._subplan.robot]
            self.clock.measure(sent, heard, order.sent, came)
        if order.step > self._order.step:
            self._rhythm.reset()  # here, not when the step begins: its first orders come before that
        self._rhythm.follow(order.since, order.along_s, order.rate, order.sent)
        with self._changed:
            is_end = bool(order.end and not self._order.end)
            if order.sent >= self._order.sent:
                self._order = order
            self._changed.notify_all()
        if is_end and order.end != "done":
            self._robot.course.abort(order.reason)

    def look(self) -> None:
        """Now and then: is the leader still there, and are we in time."""
        now = time.monotonic()
        if self._ended or self._order.end:
            return
        if now - self._heard_at > SILENT_S:
            self._break_off(f"the leader {self.leader} is silent")
        elif now > self._late_at:
            self._late_at = float("inf")
            limit_s = self._subplan.steps[self._step].limit_s
            self._robot.course.interrupt(MissionFailed(f"{self._phase()} took longer than {limit_s:g} s"))

    def state(self) -> State:
        """For the leader."""
        session = self._robot.session.latest
        return State(
            mission=self.mission,
            robot=self._subplan.robot,
            leader=self.leader,
            step=self._step,
            is_done=self._is_done,
            error_m=self._performer.error_m,
            began_at=self._began_at,
            failed=self._failed,
            ended=self._ended,
            floor=session.at.floor,
            x=session.at.x,
            y=session.at.y,
            record=self._record() if self._ended else None,
        )

    def begun(self, first: int) -> list[Begun]:
        """Steps that have begun, from a number on."""
        return self._begun[first:]

    # ---- what we do ----

    def run(self) -> None:
        """All steps, or a safe end."""
        try:
            for number in range(len(self._subplan.steps)):
                self._wait_for(number)
                self._perform(number)
            self._wait_for_end()
            self._tell(Result.DONE)
        except RoboCorbaError as wrong:
            self._fail(wrong)
        except Exception as wrong:
            self._fail(MissionFailed(f"{type(wrong).__name__}: {wrong}"))
            raise
        finally:
            self._performer.give_back()
            self._ended = True

    def _wait_for(self, number: int) -> None:
        """Until the leader's time for a step has come. Raises what ends the mission."""
        while True:
            self._robot.course.check()
            with self._changed:
                order = self._order
                if order.end:
                    raise Aborted(order.reason or "it ended before its time")
                if order.step < number:
                    self._changed.wait(0.1)
                    continue
            early_s = order.at - self.clock.now()
            if early_s <= 0.0:
                return
            time.sleep(min(early_s, 0.05) if early_s > _LOOK_S else early_s)

    def _perform(self, number: int) -> None:
        step = self._subplan.steps[number]
        self._step, self._is_done, self._began_at = number, False, self.clock.now()
        self._late_at = time.monotonic() + step.limit_s
        self._begun.append(Begun(number, f"steps[{number}]", self._phase(), time.monotonic() - self._began))
        self._tell()
        self._performer.do(step)
        self._late_at = float("inf")
        self._is_done = True

    def _wait_for_end(self) -> None:
        while True:
            self._robot.course.check()
            with self._changed:
                if self._order.end == "done":
                    return
                if self._order.end:
                    raise Aborted(self._order.reason)
                self._changed.wait(0.1)

    def _fail(self, wrong: RoboCorbaError) -> None:
        """Stand where we are until the leader says the end to all, then end safely."""
        self._late_at = float("inf")
        was_told_to = isinstance(wrong, Aborted) and bool(self._order.end)
        self._failed = "" if was_told_to else str(wrong)
        if not was_told_to:
            deadline = time.monotonic() + WORD_LIMIT_S
            with self._changed:
                self._changed.wait_for(lambda: bool(self._order.end), max(0.0, deadline - time.monotonic()))
        self._robot.course.settle(lambda why: True)
        self._performer.end_safely()
        reason = self._order.reason if was_told_to else str(wrong)
        self._tell(Result.ABORTED if was_told_to else Result.FAILED, reason)

    def _break_off(self, reason: str) -> None:
        with self._changed:
            self._order = Order(
                mission=self.mission, leader=self.leader, end="aborted", reason=reason, sent=time.time()
            )
            self._changed.notify_all()
        self._robot.course.abort(reason)

    def _phase(self) -> str:
        return self._phases[self._step] if 0 <= self._step < len(self._phases) else ""

    def _tell(self, result: Result = Result.NO_RESULT, reason: str = "") -> None:
        self.report = Report(
            self.report.name,
            result,
            f"steps[{self._step}]" if self._step >= 0 else "",
            self._phase(),
            reason,
            self._step + (1 if self._is_done else 0),
            time.monotonic() - self._began,
        )

    def _record(self) -> Record:
        carry = self._performer.carry
        return Record(
            self.clock.offset_s,
            self.clock.delay_s,
            list(carry.ticks)[-2000:] if carry else [],
            carry.farthest_m if carry else 0.0,
        )

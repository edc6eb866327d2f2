"""A robot's part in a mission: it does its SubPlan, a step at a time on the leader's orders, and reports its state."""

from __future__ import annotations

import threading
import time

from robocorba.control.execution_control import Aborted
from robocorba.control.robot import Robot
from robocorba.control.runner import IconBegun, ProgramReport, ProgramResult
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MissionFailed
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.execution import ObjectLocator, StepExecutor
from robocorba.missions.messages import Order, Proposal, Record, State

#: The member ends the mission after this time without orders from its leader [s].
LEADER_TIMEOUT_S = 4.0
#: A member that failed waits this long for the leader to end the mission [s].
END_ORDER_TIMEOUT_S = 5.0
#: Remaining times up to this are slept in one piece before a step [s].
_FINE_WAIT_S = 0.005


class Member:
    """One robot in one mission. `run` does the steps in its own thread; all other methods are thread-safe.

    It is a task of a control agent: it has a report, and its steps appear as the icons that have begun."""

    def __init__(self, proposal: Proposal, robot: Robot, locate: ObjectLocator) -> None:
        self.mission, self.leader = proposal.mission, proposal.leader
        self._subplan, self._phases = proposal.subplan, proposal.phases
        self._robot = robot
        self.clock, self._progress = LeaderClock(), CarryProgress()
        self._executor = StepExecutor(robot, self._progress, self.clock, locate)
        self._changed = threading.Condition()
        self._order = Order(mission=proposal.mission, leader=proposal.leader)
        self._order_received_at = self._began = time.monotonic()
        self._step, self._is_done, self._began_at = -1, False, 0.0
        self._failed, self._ended = "", False
        self._late_at = float("inf")
        self._begun: list[IconBegun] = []
        self.report = ProgramReport(f"mission {self.mission}")

    @property
    def has_ended(self) -> bool:
        return self._ended

    # ---- called by the mission agent ----

    def follow(self, order: Order, received_at: float) -> None:
        """Take over an order of the leader. received_at: by the local clock."""
        if order.leader != self.leader or order.mission != self.mission:
            return
        self._order_received_at = time.monotonic()
        if self._subplan.robot in order.heard:
            sent, leader_received_at = order.heard[self._subplan.robot]
            self.clock.measure(sent, leader_received_at, order.sent, received_at)
        if order.step > self._order.step:
            self._progress.reset()  # not when the step begins: its first orders arrive earlier
        self._progress.follow(order.since, order.along_s, order.rate, order.sent)
        with self._changed:
            is_end = bool(order.end and not self._order.end)
            if order.sent >= self._order.sent:
                self._order = order
            self._changed.notify_all()
        if is_end and order.end != "done":
            self._robot.execution.abort(order.reason)

    def check_timeouts(self) -> None:
        """To be called periodically: check the leader's timeout and the step's time limit."""
        now = time.monotonic()
        if self._ended or self._order.end:
            return
        if now - self._order_received_at > LEADER_TIMEOUT_S:
            self._abort(f"the leader {self.leader} is silent")
        elif now > self._late_at:
            self._late_at = float("inf")
            limit_s = self._subplan.steps[self._step].limit_s
            self._robot.execution.interrupt(MissionFailed(f"{self._phase()} took longer than {limit_s:g} s"))

    def state(self) -> State:
        """The status message for the leader."""
        session = self._robot.session.latest
        return State(
            mission=self.mission,
            robot=self._subplan.robot,
            leader=self.leader,
            step=self._step,
            is_done=self._is_done,
            error_m=self._executor.error_m,
            began_at=self._began_at,
            failed=self._failed,
            ended=self._ended,
            floor=session.at.floor,
            x=session.at.x,
            y=session.at.y,
            record=self._record() if self._ended else None,
        )

    def begun(self, first: int) -> list[IconBegun]:
        """Steps that have begun, from number `first` on."""
        return self._begun[first:]

    # ---- the task ----

    def run(self) -> None:
        """Do all steps; after a failure or an abort, end safely."""
        try:
            for number in range(len(self._subplan.steps)):
                self._wait_for(number)
                self._do_step(number)
            self._wait_for_end()
            self._update_report(ProgramResult.DONE)
        except RoboCorbaError as error:
            self._fail(error)
        except Exception as error:
            self._fail(MissionFailed(f"{type(error).__name__}: {error}"))
            raise
        finally:
            self._executor.release_reservations()
            self._ended = True

    def _wait_for(self, number: int) -> None:
        """Wait until the leader's start time of a step. Raises Aborted, or the robot's interruption."""
        while True:
            self._robot.execution.check()
            with self._changed:
                order = self._order
                if order.end:
                    raise Aborted(order.reason or "the mission ended early")
                if order.step < number:
                    self._changed.wait(0.1)
                    continue
            early_s = order.at - self.clock.now()
            if early_s <= 0.0:
                return
            time.sleep(min(early_s, 0.05) if early_s > _FINE_WAIT_S else early_s)

    def _do_step(self, number: int) -> None:
        step = self._subplan.steps[number]
        self._step, self._is_done, self._began_at = number, False, self.clock.now()
        self._late_at = time.monotonic() + step.limit_s
        self._begun.append(IconBegun(number, f"steps[{number}]", self._phase(), time.monotonic() - self._began))
        self._update_report()
        self._executor.execute(step)
        self._late_at = float("inf")
        self._is_done = True

    def _wait_for_end(self) -> None:
        while True:
            self._robot.execution.check()
            with self._changed:
                if self._order.end == "done":
                    return
                if self._order.end:
                    raise Aborted(self._order.reason)
                self._changed.wait(0.1)

    def _fail(self, wrong: RoboCorbaError) -> None:
        """Stay stopped until the leader ends the mission for all robots, then end safely."""
        self._late_at = float("inf")
        was_ordered = isinstance(wrong, Aborted) and bool(self._order.end)
        self._failed = "" if was_ordered else str(wrong)
        if not was_ordered:
            deadline = time.monotonic() + END_ORDER_TIMEOUT_S
            with self._changed:
                self._changed.wait_for(lambda: bool(self._order.end), max(0.0, deadline - time.monotonic()))
        self._robot.execution.settle(lambda why: True)
        self._executor.end_safely()
        reason = self._order.reason if was_ordered else str(wrong)
        self._update_report(ProgramResult.ABORTED if was_ordered else ProgramResult.FAILED, reason)

    def _abort(self, reason: str) -> None:
        with self._changed:
            self._order = Order(
                mission=self.mission, leader=self.leader, end="aborted", reason=reason, sent=time.time()
            )
            self._changed.notify_all()
        self._robot.execution.abort(reason)

    def _phase(self) -> str:
        return self._phases[self._step] if 0 <= self._step < len(self._phases) else ""

    def _update_report(self, result: ProgramResult = ProgramResult.NO_RESULT, reason: str = "") -> None:
        self.report = ProgramReport(
            self.report.name,
            result,
            f"steps[{self._step}]" if self._step >= 0 else "",
            self._phase(),
            reason,
            self._step + (1 if self._is_done else 0),
            time.monotonic() - self._began,
        )

    def _record(self) -> Record:
        carry = self._executor.carry
        return Record(
            self.clock.offset_s,
            self.clock.delay_s,
            list(carry.ticks)[-2000:] if carry else [],
            carry.farthest_m if carry else 0.0,
        )

"""A robot's part in a mission: it does its SubPlan, a step at a time on the leader's orders, and reports its state."""

from __future__ import annotations

import logging
import math
import threading
import time
from dataclasses import dataclass

from msgspec.structs import replace

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MissionFailed
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import OWN_CLOCK, LeaderClock
from robocorba.missions.execution import ObjectLocator, StepExecutor
from robocorba.missions.messages import Assignment, MemberMeasurements, MemberState, Order
from robocorba.missions.subplan import Carry, Reserve, Ride
from robocorba.robot.agent_state import IconBegun, ProgramReport, ProgramResult
from robocorba.robot.execution_control import Aborted
from robocorba.robot.robot import Robot

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MemberPolicy:
    """Intervals and timeouts of a member."""

    #: A robot that has offered its help, and for this time [s] receives orders but no assignment, reads the plan in the
    #: leader's data pool.
    plan_timeout_s: float = 1.0
    #: The member brakes after this time without orders from its leader [s], twice the interval between them, and drives
    #: on with the next order. Carries have a limit of their own.
    pause_timeout_s: float = 0.2
    #: The member ends the mission after this time without orders [s].
    leader_timeout_s: float = 4.0
    #: One that holds an object waits longer for orders [s], for example of another leader, which is looked for once the
    #: leader has been silent for a shorter time [s].
    holding_timeout_s: float = 20.0
    succession_timeout_s: float = 2.0
    #: In the order of succession each member waits this much longer than the one before it [s].
    turn_s: float = 3.0
    #: Interval between its looks at the record of a mission without a leader [s], and time after which it gives up [s].
    record_interval_s: float = 0.5
    succession_limit_s: float = 60.0
    #: A member that failed waits this long for the leader to end the mission [s].
    end_order_timeout_s: float = 5.0
    #: Interval between status messages to the leader [s]; changes are published immediately.
    state_interval_s: float = 0.1
    #: A member repeats its final status message for this time [s], in case one is lost.
    final_state_s: float = 3.0
    #: Posture of the arms while the robot drives without the object, of kinematics.tasks.POSTURES.
    driving_posture: str = "tuck"


DEFAULT_POLICY = MemberPolicy()


class Member:
    """One robot in one mission. `run` does the steps in its own thread; all other methods are thread-safe.

    It is a task of a control agent: it has a report, and its steps appear as the icons that have begun."""

    def __init__(self, assignment: Assignment, robot: Robot, locate: ObjectLocator, policy: MemberPolicy) -> None:
        self.mission, self.leader, self.term = assignment.mission, assignment.leader, assignment.term
        self.of = assignment.of
        self._subplan, self._phases = assignment.subplan, assignment.phases
        self._robot, self._policy = robot, policy
        self._clock, self._progress = LeaderClock(), CarryProgress()
        self._executor = StepExecutor(robot, self._progress, self._clock, locate, policy.driving_posture)
        self._changed = threading.Condition()
        self._order = Order(mission=self.mission, leader=self.leader, term=self.term)
        self._order_received_at = self._began = time.monotonic()
        #: Robots without which it goes on.
        self._without: list[str] = []
        self._step, self._is_done, self._began_at = -1, False, 0.0
        self._failure, self._is_aborted, self.has_ended = "", False, False
        #: Whether its leader is silent, so that it needs another one or ends.
        self.is_orphaned = False
        self._is_waiting_for_leader = False
        #: When the current step exceeds its time limit [s, monotonic].
        self._late_at = float("inf")
        self._begun: list[IconBegun] = []
        self.report = ProgramReport(f"mission {self.mission}")

    # ---- called by the mission agent ----

    def follow(self, order: Order, received_at: float) -> None:
        """Take over an order of the leader, or of one that has taken the mission over. received_at: by the local
        clock."""
        if order.mission != self.mission or order.term < self.term or self._order.end:
            return
        if order.term > self.term:
            self._change_leader(order)
        elif order.leader != self.leader:
            return
        if self._subplan.robot in order.without:
            self.abort(f"{order.leader} continues without {self._subplan.robot}, which was silent")
            return
        if order.step >= 0 and order.without != self._without:  # they are gone
            self._without = order.without
            self._executor.measure_place()
        self.is_orphaned = False
        now = time.monotonic()
        if now - self._order_received_at > self._policy.pause_timeout_s:  # it has waited, not worked on its step
            self._late_at += now - self._order_received_at
        self._order_received_at = now
        if self._subplan.robot in order.received_states:
            sent, leader_received_at = order.received_states[self._subplan.robot]
            self._clock.measure(sent, leader_received_at, order.sent, received_at)
        if order.step > max(self._order.step, self._step):
            self._progress.hold()  # not when the step begins: its first orders arrive earlier
        self._progress.follow(order.since, order.trajectory_s, order.rate, order.sent)
        with self._changed:
            is_end = bool(order.end and not self._order.end)
            if order.sent >= self._order.sent and not self._order.end:  # what has ended stays so
                self._order = order
            if is_end and order.end != "done":
                self._robot.execution.end_part(order.reason)
            self._changed.notify_all()

    def _change_leader(self, order: Order) -> None:
        """Stand where the last orders have ended until the new leader's next ones."""
        _log.info("mission %s: %s leads it now, instead of %s", self.mission, order.leader, self.leader)
        trajectory_s, _ = self._progress.at(self._clock.now())
        self._clock.reset()
        self._progress.hold(trajectory_s)
        with self._changed:
            self.leader, self.term = order.leader, order.term
            self._order = Order(mission=self.mission, leader=self.leader, term=self.term)

    def check_timeouts(self) -> None:
        """To be called periodically: check the leader's timeouts and the step's time limit."""
        now = time.monotonic()
        if self.has_ended or self._order.end:
            return
        silent_s = now - self._order_received_at
        self._wait_for_leader(silent_s > self._policy.pause_timeout_s)
        policy, is_holding = self._policy, self.is_holding
        if silent_s > (policy.succession_timeout_s if is_holding else policy.leader_timeout_s):
            self.is_orphaned = True
        if silent_s > (policy.holding_timeout_s if is_holding else policy.leader_timeout_s):
            self.abort(f"the leader {self.leader} is silent")
        elif now > self._late_at:
            self._late_at = float("inf")
            limit_s = self._subplan.steps[self._step].limit_s
            self._robot.execution.interrupt(MissionFailed(f"{self._phase()} took longer than {limit_s:g} s"))

    def _wait_for_leader(self, is_silent: bool) -> None:
        """Pause the step while the leader is silent. Carries stop by themselves, all at the same point; in its other
        steps a robot that holds an object does not move."""
        execution = self._robot.execution
        with self._changed:
            is_carrying = self.is_holding or isinstance(self._subplan.steps[self._step], Carry)
            is_doing = math.isfinite(self._late_at) and not is_carrying
            if self._is_waiting_for_leader and not (is_silent and is_doing):
                self._is_waiting_for_leader = False
                execution.resume()
            elif is_silent and is_doing and not execution.is_paused and not self._order.end:
                self._is_waiting_for_leader = True
                execution.pause()

    def abort(self, reason: str) -> None:
        """End the part safely, as if the leader had ordered it, unless it ends already."""
        with self._changed:  # `run` drops the interruption once it sees the end: a later one would hit the next part
            if not self._order.end:
                self._order = replace(self._order, end="aborted", reason=reason, sent=OWN_CLOCK.now())
                self._robot.execution.end_part(reason)
            self._changed.notify_all()

    @property
    def is_holding(self) -> bool:
        """Whether it holds an object, and has not failed."""
        return bool(self._executor.held) and not self._failure and not self._order.end

    def take_over_reservation(self, step: Reserve, is_reserved: bool) -> None:
        """Reserve what the former leader has reserved, for the floors that are left. is_reserved: whether the robot has
        its reservation. Raises SimulationError, RobotLost."""
        rides = sum(isinstance(each, Ride) for each in self._subplan.steps[max(self._step, 0) :])
        self._executor.reserve_again(step, rides + 1, is_reserved)

    def state(self) -> MemberState:
        """The status message for the leader."""
        session = self._robot.session.latest
        return MemberState(
            mission=self.mission,
            robot=self._subplan.robot,
            leader=self.leader,
            step=self._step,
            is_done=self._is_done,
            error_m=self._executor.error_m,
            began_at=self._began_at,
            trajectory_s=self._progress.at(self._clock.now())[0],
            failure=self._failure,
            is_aborted=self._is_aborted,
            has_left=self.has_ended,
            floor=session.at.floor,
            x=session.at.x,
            y=session.at.y,
            measurements=self._measurements() if self.has_ended else None,
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
            self._wait_for(len(self._subplan.steps))
            self._executor.release_reservations()  # after a fault the leader keeps them for its next attempt
            self._update_report(ProgramResult.DONE)
        except RoboCorbaError as error:
            self._fail(error)
        except Exception as error:
            self._fail(MissionFailed(f"{type(error).__name__}: {error}"))
            raise
        finally:
            self.has_ended = True

    def _wait_for(self, number: int) -> None:
        """Wait until the leader's start time of a step; after the last one for the end. Raises Aborted, or the robot's
        interruption."""
        with self._robot.execution.awaiting(self._awaited_between_steps):
            while True:
                self._robot.execution.check()
                with self._changed:
                    order = self._order
                    if order.end == "done" and number == len(self._subplan.steps):
                        return
                    if order.end:
                        raise Aborted(order.reason or "the mission ended early")
                    if order.step < number:
                        self._changed.wait(0.1)
                        continue
                early_s = order.at - self._clock.now()
                if early_s <= 0.0:
                    return
                # The last 5 ms in one piece.
                time.sleep(min(early_s, 0.05) if early_s > 0.005 else early_s)

    def _awaited_between_steps(self) -> str:
        order = self._order
        late = [name for name in order.waits_for if name != self._subplan.robot and order.step == self._step]
        return " and ".join(late) or self._silent_leader or "the next step"

    @property
    def _silent_leader(self) -> str:
        return f"its leader {self.leader}, which is silent" if self._is_waiting_for_leader or self.is_orphaned else ""

    def _awaited_within_step(self) -> str:
        """What holds it up: a silent leader, or in a carry what the leader waits for; empty if nothing does."""
        order = self._order
        is_carrying = isinstance(self._subplan.steps[self._step], Carry)
        is_held_up = is_carrying and order.step == self._step and not order.rate
        return self._silent_leader or (" and ".join(order.waits_for) if is_held_up else "")

    def _do_step(self, number: int) -> None:
        step = self._subplan.steps[number]
        self._step, self._is_done, self._began_at = number, False, self._clock.now()
        self._late_at = time.monotonic() + step.limit_s
        self._begun.append(IconBegun(number, f"steps[{number}]", self._phase(), time.monotonic() - self._began))
        self._update_report()
        with self._robot.execution.awaiting(self._awaited_within_step):
            self._executor.execute(step)
        self._late_at = float("inf")
        self._is_done = True

    def _fail(self, error: RoboCorbaError) -> None:
        """Stay stopped until the leader ends the mission for all robots, then end safely."""
        self._late_at = float("inf")
        self._wait_for_leader(False)
        was_ordered = isinstance(error, Aborted) and bool(self._order.end)
        self._is_aborted = isinstance(error, Aborted) and not was_ordered
        self._failure = "" if was_ordered else str(error)
        if not was_ordered:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._order.end), self._policy.end_order_timeout_s)
        self._robot.execution.settle(lambda why: True)
        self._executor.end_safely()
        reason = self._order.reason if was_ordered else str(error)
        self._update_report(ProgramResult.ABORTED if was_ordered else ProgramResult.FAILED, reason)

    def _phase(self) -> str:
        return self._phases[self._step] if 0 <= self._step < len(self._phases) else ""

    def _update_report(self, result: ProgramResult = ProgramResult.NO_RESULT, reason: str = "") -> None:
        self.report = ProgramReport(
            self.report.name,
            result,
            f"steps[{self._step}]" if self._step >= 0 else "",
            self._phase(),
            reason,
            self._step + 1 if self._is_done else max(self._step, 0),
            time.monotonic() - self._began,
        )

    def _measurements(self) -> MemberMeasurements:
        carry, clock = self._executor.carry, self._clock
        ticks, max_slip_m = (list(carry.ticks), carry.max_slip_m) if carry else ([], 0.0)
        return MemberMeasurements(clock.offset_s, clock.round_trip_s, ticks, max_slip_m)

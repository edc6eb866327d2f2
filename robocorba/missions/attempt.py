"""One attempt at a mission: its leader synchronizes the steps of all robots, by orders that it publishes.

If a robot is gone while an object is held by enough others, they go on without it. So they do under another leader."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from dataclasses import dataclass

from msgspec.structs import replace

from robocorba.errors.robots import MissionFailed
from robocorba.errors.services import NotReachable
from robocorba.missions.carry_progress import LeaderRhythm
from robocorba.missions.clearing import Requests
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.cooperative_planner import CarriedBody
from robocorba.missions.leader_areas import LeaderAreas
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.lookout import Look, Lookout, WayAhead
from robocorba.missions.messages import MemberState, Message, Order, WayMade
from robocorba.missions.recorder import LedMission
from robocorba.missions.report import ENDING
from robocorba.missions.subplan import Carry, CooperativePlan, holding_steps
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.transport import Transport
from robocorba.planning.request import Place

_log = logging.getLogger(__name__)


class AttemptFailed(MissionFailed):
    """What ends an attempt, but not the mission."""


class Interrupted(MissionFailed):
    """The leader's user or its robot ends the mission."""


@dataclass(frozen=True)
class LeaderRobot:
    """The robot that leads a mission, as its leader uses it. place: returns where it is. areas: what it reserves.
    interruption: returns why its user or its own state ends the mission, else an empty string. look: what is on its
    floor, by its data pool. awaiting: see ExecutionControl."""

    place: Callable[[], Place]
    areas: LeaderAreas
    interruption: Callable[[], str] = lambda: ""
    look: Look = lambda: ()
    awaiting: Callable[[Callable[[], str]], AbstractContextManager[None]] = lambda wait: contextlib.nullcontext()

    def check(self, prefix: str = "") -> None:
        """Raise Interrupted if the mission is to end, with a prefix to its reason."""
        if reason := self.interruption():
            raise Interrupted(prefix + reason)


class Attempt:
    """Leads the robots of a plan that they have accepted. Its methods are called by one thread. body: what the robots
    carry."""

    def __init__(
        self,
        plan: CooperativePlan,
        body: CarriedBody,
        led: LedMission,
        transport: Transport,
        robot: LeaderRobot,
        policy: LeaderPolicy,
    ) -> None:
        self.plan, self._body, self._led = plan, body, led
        self._transport, self._robot, self._policy = transport, robot, policy
        self._name = transport.name
        #: Robots that take part still, and those that do not any more.
        self._active = {subplan.robot for subplan in plan.subplans}
        self.without: set[str] = set()
        self._order = Order(mission=plan.mission, leader=self._name, term=led.term)
        self._ordered_at = 0.0
        #: The latest state of each member, and when a state of it was received last [s, monotonic].
        self.states: dict[str, MemberState] = {}
        self._received_at: dict[str, float] = {}
        #: Those that have not finished the present step, and those that hold up a carry.
        self._late: set[str] = set()
        self._holding_up: set[str] = set()
        #: See Order.
        self._received_states: dict[str, tuple[float, float]] = {}
        #: Of the present carry.
        self._rhythm: LeaderRhythm | None = None
        self._way: WayAhead | None = None

    def subscriptions(self) -> list[tuple[type[Message], str]]:
        """The messages that an attempt receives."""
        return [(WayMade, "*"), *((MemberState, subplan.robot) for subplan in self.plan.subplans)]

    # ---- synchronized steps ----

    def run(self) -> None:
        """Have all robots do all steps. Raises AttemptFailed, MissionFailed."""
        self._received_at = dict.fromkeys(self._active, time.monotonic())
        for step in range(len(self.plan.phases)):
            self._do(step)

    def carry_on(self, former: str) -> None:
        """Have the robots of a plan that a former leader began do the rest of it without that leader.

        Raises AttemptFailed if not enough of them hold the object, MissionFailed."""
        self._collect_states(former)
        step = max((self.states[name].step for name in self._active), default=-1)
        names = ", ".join(sorted(self._active)) or "no robot"
        if not self._is_held(step) or not self._is_enough(self._active):
            raise AttemptFailed(f"{former} is silent, and {names} can't carry on")
        self._await_gone(self.without, f"{former} is silent")
        self._do(step, is_begun=True)
        for later in range(step + 1, len(self.plan.phases)):
            self._do(later)

    def _do(self, step: int, is_begun: bool = False) -> None:
        """Have all robots do a step, or the rest of it."""
        steps = {subplan.robot: subplan.steps[step] for subplan in self.plan.subplans}
        limit_s = max(each.limit_s for each in steps.values())
        carry = next((each for each in steps.values() if isinstance(each, Carry)), None)
        trajectory = Trajectory.from_rows(carry.rows) if carry else None
        self._way = self._watched_way(trajectory) if trajectory else None
        at = OWN_CLOCK.now() + self._policy.step_lead_s
        self._order = self._order_for(step, at)
        if trajectory:
            begun = (self._trajectory_s(step), 0.0) if is_begun else (0.0, 1.0)
            self._rhythm = LeaderRhythm(at, self._policy.rate_change_lead_s, trajectory.duration, *begun)
        phase = self._led.begin_phase(self.plan, self._phase_name(step), at, self.without)
        while not self._active <= phase.done.keys():
            self._late = self._active - phase.done.keys()
            self.publish_order()
            self.receive_states(0.02)
            done_before = len(phase.done)
            for name in self._active & self.states.keys():
                state = self.states[name]
                if state.step == step and state.began_at > at - self._policy.step_lead_s:
                    phase.started.setdefault(name, state.began_at)
                if state.step > step or (state.step == step and state.is_done):
                    phase.done.setdefault(name, OWN_CLOCK.now())
            if len(phase.done) > done_before:
                self._led.update(self.plan)
            self._check_members(phase.name, step)
            if OWN_CLOCK.now() > at + limit_s + self._policy.step_grace_s:
                late = sorted(self._active - phase.done.keys())
                raise AttemptFailed(f"{phase.name}: {', '.join(late)} took longer than {limit_s:g} s")
            if self._rhythm and self._rhythm.set_rate(min(self._carry_rate(), self._way_rate()), OWN_CLOCK.now()):
                self._ordered_at = 0.0
            if (name := self._phase_name(step)) != phase.name:
                phase.done.update(dict.fromkeys(self._active, OWN_CLOCK.now()))
                phase = self._led.begin_phase(self.plan, name, OWN_CLOCK.now(), self.without)

    def _order_for(self, step: int, at: float) -> Order:
        self._ordered_at, self._rhythm = 0.0, None
        self._late, self._holding_up = set(), set()
        mission, leader, term = self.plan.mission, self._name, self._led.term
        return Order(mission=mission, leader=leader, term=term, step=step, at=at, without=sorted(self.without))

    def _waits_for(self) -> list[str]:
        """See Order."""
        if self._way and self._way.blocker:
            return [f"a free way: {self._way.reason}"]
        return sorted(self._holding_up or self._late)

    def _phase_name(self, step: int) -> str:
        if self._way and self._way.blocker:
            return f"waiting: {self._way.reason}"
        return self.plan.phases[step] + (f" without {', '.join(sorted(self.without))}" if self.without else "")

    # ---- the way of a carry ----

    def _watched_way(self, trajectory: Trajectory) -> WayAhead | None:
        body, policy = self._body, self._policy
        if body.footprint is None:
            return None
        lookout = Lookout(trajectory, body.footprint, {self.plan.thing, *self._active}, self._robot.look, policy)

        def ask(robot: str) -> Requests:
            return Requests({robot: body.aside(robot)}, self.plan.mission, self._led.term, self._transport, policy)

        return WayAhead(lookout, ask, policy)

    def _way_rate(self) -> float:
        """The rate at which what is in the way lets the carry continue. Raises AttemptFailed if it stays there."""
        way, rhythm = self._way, self._rhythm
        if way is None or rhythm is None:
            return 1.0
        rate = way.rate(rhythm.at(OWN_CLOCK.now()))
        if way.blocker and (way.waited_s > self._policy.way_timeout_s or way.staying):
            at = way.blocker.shape.centroid
            where = f" at ({at.x:.2f}, {at.y:.2f})" if way.blocker.name else ""
            why = f", and {way.staying}" if way.staying else ""
            raise AttemptFailed(f"carrying: {way.reason}{where}{why}")
        return rate

    def _carry_rate(self) -> float:
        """The rate at which the carry may continue, 0 to 1."""
        errors_m = {name: self.states[name].error_m for name in self._active & self.states.keys()}
        far = {name for name, error_m in errors_m.items() if error_m > self._policy.stop_error_m}
        self._holding_up = far | self._silent(self._policy.carry_pause_timeout_s)
        if self._holding_up:
            return 0.0
        return 0.5 if max(errors_m.values(), default=0.0) > self._policy.slow_error_m else 1.0

    def _trajectory_s(self, step: int) -> float:
        """The trajectory time [s] at which the members stand in a step that has begun."""
        states = (self.states[name] for name in self._active)
        return max((state.trajectory_s for state in states if state.step == step), default=0.0)

    # ---- who takes part ----

    def _check_members(self, phase: str, step: int) -> None:
        self._robot.check(f"{phase}: {self._name}: ")
        for name in sorted(self._active & self.states.keys()):
            state = self.states[name]
            if state.failure:
                what = MissionFailed if state.is_aborted else AttemptFailed
                raise what(f"{phase}: {name} at {state.floor} ({state.x:.2f}, {state.y:.2f}): {state.failure}")
            if state.has_left:
                raise AttemptFailed(f"{phase}: {name} has left the mission")
        if silent := self._silent(self._policy.member_timeout_s):
            self._go_on_without(silent, phase, step)

    def _silent(self, timeout_s: float) -> set[str]:
        now = time.monotonic()
        return {name for name in self._active if now - self._received_at[name] > timeout_s}

    def _go_on_without(self, silent: set[str], phase: str, step: int) -> None:
        """Drop robots that are gone, and wait for others while all hold an object. Raises AttemptFailed if the others
        can't go on."""
        why = f"{phase}: {_are_silent(silent)}"
        is_held = self._is_held(step)
        if is_held and self._present(silent):
            if self._silent(self._policy.member_timeout_s + self._policy.gone_timeout_s):
                raise AttemptFailed(f"{why}, though still there")
            return
        if self._name in silent or not is_held or not self._is_enough(self._active - silent):
            raise AttemptFailed(why)
        try:
            self._led.confirm()
        except NotReachable as error:
            raise AttemptFailed(f"{why}; {error}") from None
        _log.warning("mission %s: %s; the others continue", self.plan.mission, why)
        self._drop(silent)

    def _drop(self, names: Collection[str]) -> None:
        self._active.difference_update(names)
        self.without.update(names)
        self._order = replace(self._order, without=sorted(self.without))

    def _present(self, names: Collection[str]) -> set[str]:
        """Those of these robots that are on the leader's floor, or all while that is unknown."""
        with contextlib.suppress(NotReachable):
            return {seen.name for seen in self._robot.look() if seen.is_robot}.intersection(names)
        return set(names)

    def _is_held(self, step: int) -> bool:
        """Whether the robots hold an object between them before and after what they do in this step."""
        return step in holding_steps(self.plan)

    def _is_enough(self, robots: set[str]) -> bool:
        return any(robots.issuperset(carriers) for carriers in self.plan.enough)

    # ---- from a former leader ----

    def _collect_states(self, former: str) -> None:
        """Have the robots report to this leader. Those that do not, or have ended their part, are dropped."""
        self._drop({former})
        self._order = self._order_for(-1, 0.0)
        began = time.monotonic()
        complete_at: float | None = None
        while (now := time.monotonic()) - began < self._policy.report_timeout_s:
            if self._active <= self.states.keys():
                complete_at = complete_at or now
                if now - complete_at >= self._policy.clock_measuring_s:
                    break
            self.publish_order()
            self.receive_states(0.02)
            self._robot.check()
        ended = {name for name, state in self.states.items() if state.has_left or state.failure}
        self._drop(self._active - (self.states.keys() - ended))

    def _await_gone(self, names: Collection[str], why: str) -> None:
        """Wait until robots are gone. Raises AttemptFailed if they stay."""
        began = time.monotonic()
        while self._present(names):
            if time.monotonic() - began > self._policy.gone_timeout_s:
                raise AttemptFailed(f"{why}, though still there")
            self.publish_order()
            self.receive_states(0.05)
            self._robot.check()

    # ---- the end ----

    def end(self, end: str, reason: str, never_began: Collection[str] = ()) -> None:
        """Publish the end until all members have ended or timed out, except those that never began."""
        names = self._active.difference(never_began)
        self._led.note(self.plan, "done" if end == "done" else ENDING, end != "done")
        self._order = replace(self._order_for(self._order.step, self._order.at), end=end, reason=reason)
        began = time.monotonic()
        while (now := time.monotonic()) - began < self._policy.end_timeout_s:
            self.publish_order()
            self.receive_states(0.02)
            left = {name for name, state in self.states.items() if state.has_left}
            received_at = [max(began, self._received_at.get(name, began)) for name in names - left]
            if all(now - at >= self._policy.member_timeout_s for at in received_at):
                return
        _log.warning(
            "mission %s: not all robots reported their end within %g s", self.plan.mission, self._policy.end_timeout_s
        )

    # ---- messages ----

    def receive_states(self, timeout_s: float) -> None:
        """Take the members' states into account, and answers of robots that were asked to step aside."""
        received = self._transport.receive(timeout_s)
        while received:
            message = received.message
            if isinstance(message, MemberState):
                if message.mission == self.plan.mission and message.leader == self._name:
                    self._take_state(message, received.received_at)
            elif isinstance(message, WayMade) and self._way:
                self._way.receive(message)
            received = self._transport.receive(0.0)

    def _take_state(self, state: MemberState, received_at: float) -> None:
        before = self.states.get(state.robot)
        if before is None or state.sent >= before.sent:
            self.states[state.robot] = state
            self._received_states[state.robot] = (state.sent, received_at)
        self._received_at[state.robot] = time.monotonic()

    def publish_order(self) -> None:
        """Publish the order if it is due."""
        now = time.monotonic()
        if now - self._ordered_at >= self._policy.order_interval_s:
            self._ordered_at = now
            states = dict(self._received_states)
            order, at = replace(self._order, received_states=states, waits_for=self._waits_for()), OWN_CLOCK.now()
            if self._rhythm is None:
                self._transport.publish(order)
                return
            rhythm = self._rhythm.order(at)
            if self._transport.publish(replace(order, **rhythm._asdict())):
                self._rhythm.note_sent(rhythm, at)


def _are_silent(names: Collection[str]) -> str:
    return f"{', '.join(sorted(names))} {'is' if len(names) == 1 else 'are'} silent"

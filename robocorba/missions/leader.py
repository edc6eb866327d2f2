"""The mission layer: a leader collects offers, makes a plan, has each robot accept its SubPlan, synchronizes the steps
of all robots, and reports the result.

After a fault all robots end safely, and the leader begins another attempt from where everything stands now."""

from __future__ import annotations

import logging
import math
import random
import time
from collections.abc import Callable, Collection, Container, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from msgspec.structs import replace

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import GoalReached, InTheWay, MissionFailed, MissionTakenOver
from robocorba.missions.clearing import Requests, requests_for
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.cooperative_planner import CooperativePlanner
from robocorba.missions.lookout import Look, Lookout
from robocorba.missions.messages import Answer, Assignment, Call, MemberState, Offer, Order, WayMade
from robocorba.missions.report import RECOVERING, MissionReport, PhaseTimes
from robocorba.missions.subplan import Carry, CooperativePlan
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.transport import Transport
from robocorba.missions.way_ahead import WayAhead
from robocorba.planning.request import Place


@dataclass(frozen=True)
class LeaderPolicy:
    """Intervals, timeouts and limits of a leader."""

    #: Time for robots to offer their help [s].
    offer_timeout_s: float = 3.0
    #: The same once enough robots have offered [s]: time for nearer ones.
    surplus_offer_timeout_s: float = 1.0
    #: Time for robots to answer an assignment [s].
    answer_timeout_s: float = 6.0
    #: The same after the first refusal [s]: no robot is kept waiting for a plan that has failed.
    timeout_after_refusal_s: float = 1.0
    #: Interval between repeated calls and assignments [s].
    repeat_interval_s: float = 0.5
    #: Time to reach an agreement while robots refuse or are busy [s].
    agreement_timeout_s: float = 60.0
    #: The same after a fault, also while robots are missing or servers don't answer [s].
    recovery_timeout_s: float = 60.0
    #: Maximum number of attempts that begin after a fault.
    max_recoveries: int = 5
    #: Maximum random pause between attempts [s]. It separates leaders that compete for the same robots.
    max_retry_pause_s: float = 3.0
    #: Candidates beyond the helpers needed, the nearest first.
    spare_candidates: int = 4
    #: Interval between order messages [s].
    order_interval_s: float = 0.1
    #: Lead time of a step: time for its order to reach all members before it begins [s].
    step_lead_s: float = 0.3
    #: Lead time of a change of the carry's rate [s].
    rate_change_lead_s: float = 0.15
    #: The attempt ends after this time without status messages from a member [s].
    member_timeout_s: float = 4.0
    #: The carry pauses after this time without status messages from a member [s].
    carry_pause_timeout_s: float = 0.5
    #: The attempt ends if a step exceeds its limit by this time [s]; members detect it first.
    step_grace_s: float = 3.0
    #: Time for members to end safely [s].
    end_timeout_s: float = 25.0
    #: The attempt ends if something stays in the way of a carry for this time [s].
    way_timeout_s: float = 20.0
    #: The carry runs at half rate if a carrier's position error exceeds this [m].
    slow_error_m: float = 0.06
    #: The carry pauses if a carrier's position error exceeds this [m].
    stop_error_m: float = 0.12


DEFAULT_POLICY = LeaderPolicy()

_log = logging.getLogger(__name__)


class _Fault(MissionFailed):
    """What ends an attempt, but not the mission."""


class _Interrupted(MissionFailed):
    """The leader's user or its robot ends the mission."""


class _Offers(NamedTuple):
    """The answers to a call: positions of the free robots, and what occupies the busy ones."""

    free: dict[str, Place]
    busy: dict[str, str]


class Leader:
    """Leads one mission, in one thread. place: returns the leader's current place. on_phase: called with the plan and
    each phase that begins. interruption: returns the reason of an interruption, else an empty string. on_progress:
    called with the plan, the phases of all attempts that have begun, and whether the mission ends safely, after each
    change of them; must not block.

    term, attempts: of the mission's record; see MissionContent. begin_attempt: called with the number of each attempt
    before it begins; raises MissionTakenOver if another robot leads the mission now, NotReachable if that is unknown.
    look: what is on the leader's floor, for its carries.

    The leader's own part is done by its mission agent, like that of every other robot."""

    def __init__(
        self,
        mission: str,
        transport: Transport,
        place: Callable[[], Place],
        on_phase: Callable[[CooperativePlan, str], None] = lambda plan, phase: None,
        interruption: Callable[[], str] = lambda: "",
        policy: LeaderPolicy = DEFAULT_POLICY,
        on_progress: Callable[[CooperativePlan, Sequence[PhaseTimes], bool], None] = lambda plan, phases, ending: None,
        term: int = 1,
        attempts: int = 0,
        begin_attempt: Callable[[int], None] = lambda attempt: None,
        look: Look = lambda: (),
    ) -> None:
        self._mission, self._transport, self._place, self._on_phase = mission, transport, place, on_phase
        self._on_progress, self._on_attempt, self._look = on_progress, begin_attempt, look
        self._interruption, self._policy = interruption, policy
        self._name, self._term, self._attempts = transport.name, term, attempts
        self._phases: list[PhaseTimes] = []
        #: What ended the attempts before.
        self._faults: list[str] = []
        #: Of the last plan.
        self._planner: CooperativePlanner | None = None
        #: Of the present carry.
        self._way: WayAhead | None = None
        self._begin_attempt(None, mission)

    def _begin_attempt(self, plan: CooperativePlan | None, mission: str) -> None:
        self._plan = plan
        self._order = Order(mission=mission, leader=self._name, term=self._term)
        self._ordered_at = 0.0
        #: The latest state of each member, and when a state of it was received last [s, monotonic].
        self._states: dict[str, MemberState] = {}
        self._received_at: dict[str, float] = {}
        #: See Order.
        self._received_states: dict[str, tuple[float, float]] = {}

    def lead(self, kind: str, make_planner: Callable[[], CooperativePlanner]) -> MissionReport:
        """Run the mission to its end. kind: for display. make_planner: called before each attempt; its planner plans
        with what is where then. It raises GoalReached if there is nothing to do. Errors are in the report."""
        began, result, reason = OWN_CLOCK.now(), "done", ""
        try:
            while not self._attempt(make_planner):
                pass
        except GoalReached as error:
            _log.info("mission %s: %s", self._mission, error)
        except Exception as error:
            result, reason = "failed", str(error) or type(error).__name__
            if not isinstance(error, MissionFailed):
                _log.warning("mission %s: %s: %s", self._mission, type(error).__name__, error)
            if self._faults:
                reason = f"{reason}; before: {'; '.join(self._faults)}"
            if self._plan:
                self._end(self._plan, "aborted", reason)
        measurements = {name: state.measurements for name, state in self._states.items() if state.measurements}
        received = [each for each in list(self._transport.received) if each.message.mission.startswith(self._mission)]
        return MissionReport(
            self._mission,
            kind,
            self._name,
            result,
            reason,
            began,
            OWN_CLOCK.now(),
            self._plan,
            self._phases,
            measurements,
            received,
            tuple(self._faults),
        )

    def _attempt(self, make_planner: Callable[[], CooperativePlanner]) -> bool:
        """Agree on a plan, and do it. Returns whether it was done to its end; if not, all robots have ended safely."""
        plan = self._agree(make_planner)
        try:
            for step in range(len(plan.phases)):
                self._do(plan, step)
        except _Fault as fault:
            if len(self._faults) == self._policy.max_recoveries:
                raise
            _log.warning("mission %s: %s; %s tries again", self._mission, fault, self._name)
            self._end(plan, "aborted", str(fault))
            self._plan = None
            self._faults.append(str(fault))
            self._phases.append(PhaseTimes(RECOVERING, OWN_CLOCK.now(), {}, {}))
            self._on_progress(plan, self._phases, False)
            return False
        self._end(plan, "done", "")
        return True

    # ---- agreement: no robot moves ----

    def _agree(self, make_planner: Callable[[], CooperativePlanner]) -> CooperativePlan:
        """A plan that all of its robots have accepted."""
        is_recovering, policy = bool(self._faults), self._policy
        deadline = time.monotonic() + (policy.recovery_timeout_s if is_recovering else policy.agreement_timeout_s)
        refusing: dict[str, str] = {}
        staying: dict[str, str] = {}
        while True:
            self._attempts += 1
            mission = f"{self._mission}.{self._attempts}"
            try:
                self._on_attempt(self._attempts)
                planner = make_planner()
                offers = self._collect_offers(mission, planner)
                if missing := _lacking(planner, offers.free, offers.busy):
                    is_hopeless = not offers.busy or _lacking(planner, [*offers.free, *offers.busy])
                    if is_hopeless and not is_recovering:
                        raise MissionFailed(missing)
                else:
                    candidates = self._candidates(planner, offers.free, {*refusing, *staying})
                    plan = planner.plan(mission, self._name, candidates, staying)
                    refusing = self._agree_on(plan)
                    if not refusing:
                        self._planner = planner
                        return plan
                    reasons = "; ".join(f"{name}: {why}" for name, why in refusing.items())
                    missing = f"not enough robots accept: {reasons}"
            except InTheWay as blocked:
                staying.update(self._clear_way(mission, blocked.aside))
                missing = _stays(staying) or str(blocked)
                if time.monotonic() <= deadline:
                    continue
            except RoboCorbaError as error:  # what is in the way may leave; after a fault, what is away may come back
                is_final = isinstance(error, (GoalReached, MissionTakenOver, _Interrupted))
                if is_final or not (is_recovering or staying):
                    raise
                missing = f"{error}; {_stays(staying)}" if staying else str(error)
                staying = {}
            if time.monotonic() > deadline:
                raise MissionFailed(missing)
            self._pause(random.uniform(0.0, policy.max_retry_pause_s))

    def _clear_way(self, mission: str, aside: Mapping[str, tuple[str, float, float] | None]) -> dict[str, str]:
        """Ask robots to step aside. Returns those that stay, with the reasons."""
        self._phases.append(PhaseTimes(f"clearing the way: {', '.join(sorted(aside))}", OWN_CLOCK.now(), {}, {}))
        requests = requests_for(aside, mission, self._name, self._term, self._transport.publish)
        self._transport.subscribe([(WayMade, name) for name in requests.robots])
        while requests.robots:
            requests.update()
            received = self._transport.receive(0.05)
            if received and isinstance(received.message, WayMade):
                requests.receive(received.message)
            self._check_interruption()
        return requests.staying

    def _collect_offers(self, mission: str, planner: CooperativePlanner) -> _Offers:
        """Publish calls and collect the offers."""
        offers, policy = _Offers({}, {}), self._policy
        if not planner.helpers:
            return offers
        self._transport.subscribe([(Offer, "*")])
        floor, x, y = planner.meeting_point
        call = Call(mission=mission, leader=self._name, term=self._term, floor=floor, x=x, y=y, helpers=planner.helpers)
        began, sent_at = time.monotonic(), 0.0
        while (now := time.monotonic()) - began < (
            policy.offer_timeout_s if _lacking(planner, offers.free) else policy.surplus_offer_timeout_s
        ):
            if now - sent_at > policy.repeat_interval_s:
                self._transport.publish(replace(call, received_offers=[*offers.free, *offers.busy]), 1.0)
                sent_at = now
            received = self._transport.receive(0.05)
            if received and isinstance(received.message, Offer) and received.message.mission == mission:
                offer = received.message
                if offer.busy:
                    offers.busy[offer.robot] = offer.busy
                else:
                    offers.free[offer.robot] = Place(offer.floor, offer.x, offer.y)
            self._check_interruption()
        return offers

    def _candidates(
        self, planner: CooperativePlanner, free: dict[str, Place], refusing: Container[str]
    ) -> dict[str, Place]:
        """The leader and the nearest free robots; those that refused before only if there are not enough others."""
        here = planner.meeting_point

        def rank(name: str) -> tuple[bool, bool, bool, float]:
            at = free[name]
            is_far = at.floor != here.floor
            return name not in planner.required, name in refusing, is_far, math.dist(at[1:], here[1:])

        nearest = sorted(free, key=rank)
        willing = [name for name in nearest if name not in refusing]
        names = willing if len(willing) >= planner.helpers else nearest
        names = names[: planner.helpers + self._policy.spare_candidates]
        return {self._name: self._place(), **{name: free[name] for name in names}}

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.05))
            self._check_interruption()

    def _agree_on(self, plan: CooperativePlan) -> dict[str, str]:
        """Robots that refuse their SubPlan, with the reasons; then the plan is aborted and the others are free again.

        Raises MissionFailed if the leader's own mission agent refuses."""
        self._begin_attempt(plan, plan.mission)
        self._on_phase(plan, "asking")
        self._on_progress(plan, self._phases, False)
        refusing = {name: why for name, why in self._assign(plan).items() if why}
        if refusing:
            self._end(plan, "aborted", f"{', '.join(refusing)} did not accept", set(refusing))
            self._plan = None
        if self._name in refusing:
            raise MissionFailed(f"{self._name} can't do its own part: {refusing[self._name]}")
        return refusing

    def _assign(self, plan: CooperativePlan) -> dict[str, str]:
        """Assign the SubPlans to the robots: each one's reason to refuse, empty if it accepts. Orders are published
        meanwhile, so that robots that have accepted do not time out."""
        assignments = {
            subplan.robot: Assignment(
                mission=plan.mission, leader=self._name, term=self._term, phases=plan.phases, subplan=subplan
            )
            for subplan in plan.subplans
        }
        self._transport.subscribe(
            [(WayMade, "*"), *((kind, name) for name in assignments for kind in (Answer, MemberState))]
        )
        answers: dict[str, str] = {}
        deadline, sent_at = time.monotonic() + self._policy.answer_timeout_s, 0.0
        while len(answers) < len(assignments) and time.monotonic() < deadline:
            if time.monotonic() - sent_at > self._policy.repeat_interval_s:
                for name, assignment in assignments.items():
                    if name not in answers:
                        self._transport.publish(assignment, 1.0)
                sent_at = time.monotonic()
            received = self._transport.receive(0.05)
            if received and isinstance(received.message, Answer) and received.message.mission == plan.mission:
                answer = received.message
                answers[answer.robot] = "" if answer.accepts else answer.reason or "no"
                if not answer.accepts:
                    deadline = min(deadline, time.monotonic() + self._policy.timeout_after_refusal_s)
            self._publish_order()
            self._check_interruption()
        return {name: answers.get(name, "no answer in time") for name in assignments}

    # ---- synchronized steps ----

    def _do(self, plan: CooperativePlan, step: int) -> None:
        """Have all robots do a step."""
        steps = {subplan.robot: subplan.steps[step] for subplan in plan.subplans}
        limit_s = max(each.limit_s for each in steps.values())
        carry = next((each for each in steps.values() if isinstance(each, Carry)), None)
        trajectory = Trajectory.from_rows(carry.rows) if carry else None
        self._way = self._watched_way(plan, trajectory) if trajectory else None
        at = OWN_CLOCK.now() + self._policy.step_lead_s
        phase = PhaseTimes(plan.phases[step], at, {}, {})
        self._phases.append(phase)
        self._on_phase(plan, phase.name)
        self._on_progress(plan, self._phases, False)
        self._order = Order(mission=plan.mission, leader=self._name, term=self._term, step=step, at=at)
        if carry:
            self._order = replace(self._order, rate=1.0, since=at)
        self._ordered_at = 0.0
        if step == 0:
            self._received_at = dict.fromkeys(steps, time.monotonic())
        while len(phase.done) < len(steps):
            self._receive_states(0.02, plan)
            done_before = len(phase.done)
            for name, state in self._states.items():
                if state.step == step and state.began_at:
                    phase.started.setdefault(name, state.began_at)
                if state.step > step or (state.step == step and state.is_done):
                    phase.done.setdefault(name, OWN_CLOCK.now())
            if len(phase.done) > done_before:
                self._on_progress(plan, self._phases, False)
            self._check_members(phase.name)
            if OWN_CLOCK.now() > at + limit_s + self._policy.step_grace_s:
                late = [name for name in steps if name not in phase.done]
                raise _Fault(f"{phase.name}: {', '.join(late)} took longer than {limit_s:g} s")
            if trajectory:
                self._set_rate(min(self._carry_rate(), self._way_rate()), trajectory.duration)
                name = self._carry_phase(plan.phases[step])
                if name != phase.name:
                    phase.done.update(dict.fromkeys(steps, OWN_CLOCK.now()))
                    phase = PhaseTimes(name, OWN_CLOCK.now(), {}, {})
                    self._phases.append(phase)
                    self._on_phase(plan, name)
                    self._on_progress(plan, self._phases, False)
            self._publish_order()

    # ---- the way of a carry ----

    def _watched_way(self, plan: CooperativePlan, trajectory: Trajectory) -> WayAhead | None:
        planner = self._planner
        if planner is None or planner.footprint is None:
            return None
        team = {plan.thing, *(subplan.robot for subplan in plan.subplans)}
        lookout = Lookout(trajectory, planner.footprint, team, self._look)

        def ask(robot: str) -> Requests:
            aside = {robot: planner.aside(robot)}
            return requests_for(aside, plan.mission, self._name, self._term, self._transport.publish)

        return WayAhead(lookout, ask)

    def _way_rate(self) -> float:
        """The rate at which what is in the way lets the carry continue. Raises _Fault if it stays there."""
        way, order = self._way, self._order
        if way is None:
            return 1.0
        rate = way.rate(order.trajectory_s + order.rate * max(0.0, OWN_CLOCK.now() - order.since))
        if way.blocker and (way.waited_s > self._policy.way_timeout_s or way.staying):
            at = f" at ({way.blocker.x:.2f}, {way.blocker.y:.2f})" if way.blocker.x or way.blocker.y else ""
            why = f", and {way.staying}" if way.staying else ""
            raise _Fault(f"carrying: {way.blocker.name} is in the way{at}{why}")
        return rate

    def _carry_phase(self, phase: str) -> str:
        blocker = self._way.blocker if self._way else None
        return f"waiting: {blocker.name} is in the way" if blocker else phase

    def _carry_rate(self) -> float:
        """The rate at which the carry may continue, 0 to 1."""
        oldest = min(self._received_at.values())
        worst_m = max((state.error_m for state in self._states.values()), default=0.0)
        if time.monotonic() - oldest > self._policy.carry_pause_timeout_s or worst_m > self._policy.stop_error_m:
            return 0.0
        return 0.5 if worst_m > self._policy.slow_error_m else 1.0

    def _set_rate(self, rate: float, duration_s: float) -> None:
        """Continue the carry at this rate, from a time in the future that all members will know in advance."""
        order = self._order
        if rate == order.rate or OWN_CLOCK.now() < order.since:
            return
        since = OWN_CLOCK.now() + self._policy.rate_change_lead_s
        trajectory_s = min(duration_s, order.trajectory_s + order.rate * (since - order.since))
        self._order = replace(order, trajectory_s=trajectory_s, rate=rate, since=since)

    def _check_members(self, phase: str) -> None:
        self._check_interruption(f"{phase}: {self._name}: ")
        for name, state in self._states.items():
            if state.failure:
                what = MissionFailed if state.is_aborted else _Fault
                raise what(f"{phase}: {name} at {state.floor} ({state.x:.2f}, {state.y:.2f}): {state.failure}")
            if state.has_left:
                raise _Fault(f"{phase}: {name} has left the mission")
        now = time.monotonic()
        for name, received_at in self._received_at.items():
            if now - received_at > self._policy.member_timeout_s:
                raise _Fault(f"{phase}: {name} is silent")

    def _check_interruption(self, prefix: str = "") -> None:
        if reason := self._interruption():
            raise _Interrupted(prefix + reason)

    # ---- the end ----

    def _end(self, plan: CooperativePlan, end: str, reason: str, never_began: Collection[str] = ()) -> None:
        """Publish the end until all members have ended or timed out, except those that never began."""
        names = {subplan.robot for subplan in plan.subplans}.difference(never_began)
        self._on_phase(plan, "done" if end == "done" else "ending safely")
        self._on_progress(plan, self._phases, end != "done")
        step, at = self._order.step, self._order.at
        self._order = Order(
            mission=plan.mission, leader=self._name, term=self._term, step=step, at=at, end=end, reason=reason
        )
        self._ordered_at = 0.0
        began = time.monotonic()
        while (now := time.monotonic()) - began < self._policy.end_timeout_s:
            self._publish_order()
            self._receive_states(0.02, plan)
            left = {name for name, state in self._states.items() if state.has_left}
            received_at = [max(began, self._received_at.get(name, began)) for name in names - left]
            if all(now - at >= self._policy.member_timeout_s for at in received_at):
                return
        _log.warning(
            "mission %s: not all robots reported their end within %g s", plan.mission, self._policy.end_timeout_s
        )

    # ---- messages ----

    def _receive_states(self, timeout_s: float, plan: CooperativePlan) -> None:
        received = self._transport.receive(timeout_s)
        while received:
            state = received.message
            if isinstance(state, MemberState) and state.mission == plan.mission:
                before = self._states.get(state.robot)
                if before is None or state.sent >= before.sent:
                    self._states[state.robot] = state
                    self._received_states[state.robot] = (state.sent, received.received_at)
                self._received_at[state.robot] = time.monotonic()
            elif isinstance(state, WayMade) and self._way:
                self._way.receive(state)
            received = self._transport.receive(0.0)

    def _publish_order(self) -> None:
        """Publish the order if it is due."""
        now = time.monotonic()
        if now - self._ordered_at >= self._policy.order_interval_s:
            self._ordered_at = now
            self._transport.publish(replace(self._order, received_states=dict(self._received_states)))


def _stays(staying: Mapping[str, str]) -> str:
    """The robots that do not step aside, and why."""
    return "; ".join(f"{name} is in the way and {why}" for name, why in staying.items())


def _lacking(
    planner: CooperativePlanner, robots: Collection[str], busy: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Why these helpers are not sufficient, empty if they are."""
    others = "".join(f"; {name} {does}" for name, does in busy.items())
    if len(robots) < planner.helpers:
        return (
            f"{planner.helpers} helpers are needed; {', '.join(sorted(robots)) or 'no robot'} offered to help{others}"
        )
    if absent := sorted(planner.required.difference(robots)):
        return f"{' and '.join(absent)} did not offer to help: not there, or not free{others}"
    return ""

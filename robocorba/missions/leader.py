"""The mission layer: a leader collects offers, makes a plan, has each robot accept its SubPlan, synchronizes the steps
of all robots, and reports the result."""

from __future__ import annotations

import logging
import math
import random
import time
from collections.abc import Callable, Collection, Container, Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol

from robocorba.errors.robots import MissionFailed
from robocorba.missions.messages import Answer, Call, Offer, Order, Proposal, Record, State
from robocorba.missions.subplan import Carry, CooperativePlan
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.transport import Received, Transport
from robocorba.planning.request import Place

#: Time for robots to offer their help [s].
OFFER_TIMEOUT_S = 3.0
#: The same once enough robots have offered [s]: time for nearer ones.
SURPLUS_OFFER_TIMEOUT_S = 1.0
#: Time for robots to answer a proposal [s].
ANSWER_TIMEOUT_S = 6.0
#: The same after the first refusal [s]: no robot is kept waiting for a plan that has failed.
TIMEOUT_AFTER_REFUSAL_S = 1.0
#: Interval between repeated calls and proposals [s].
PROPOSAL_INTERVAL_S = 0.5
#: Time for all attempts to reach an agreement while robots refuse or are busy [s].
AGREEMENT_TIMEOUT_S = 60.0
#: Longest random pause between attempts [s]. It separates leaders that compete for the same robots.
MAX_RETRY_PAUSE_S = 3.0
#: Candidates beyond the helpers needed, the nearest first.
SPARE_CANDIDATES = 4
#: Interval between order messages [s].
ORDER_INTERVAL_S = 0.1
#: Lead time of a step: time for its order to reach all members before it begins [s].
STEP_LEAD_S = 0.3
#: Lead time of a change of the carry's rate [s].
RATE_CHANGE_LEAD_S = 0.15
#: The mission ends after this time without status messages from a member [s].
MEMBER_TIMEOUT_S = 4.0
#: The carry pauses after this time without status messages from a member [s].
CARRY_PAUSE_TIMEOUT_S = 0.5
#: The mission ends if a step exceeds its limit by this time [s]; members detect it first.
STEP_GRACE_S = 3.0
#: Time for members to end safely [s].
END_TIMEOUT_S = 25.0
#: The carry runs at half rate if a carrier's position error exceeds this [m].
SLOW_ERROR_M = 0.06
#: The carry pauses if a carrier's position error exceeds this [m].
STOP_ERROR_M = 0.12

_log = logging.getLogger(__name__)


class Expansion(Protocol):
    """The planner of a cooperative icon."""

    @property
    def helpers(self) -> int:
        """Number of robots needed in addition to the leader."""

    @property
    def wanted(self) -> frozenset[str]:
        """Robots that must be among the helpers."""

    @property
    def meeting_point(self) -> Place:
        """Where the helpers are needed."""

    def plan(self, mission: str, leader: str, robots: dict[str, Place]) -> CooperativePlan:
        """A plan for some of these robots, including the leader. Raises MissionFailed, ImpossibleCarry, PathError."""


class PhaseRecord(NamedTuple):
    """The times of a step by the leader's clock: its start, and when each robot started and finished it."""

    name: str
    began: float
    started: dict[str, float]
    done: dict[str, float]


class MissionReport(NamedTuple):
    """The outcome of a mission. result: done or failed; reason: of the failure. received: by the leader."""

    mission: str
    kind: str
    leader: str
    result: str
    reason: str
    began: float
    ended: float
    plan: CooperativePlan | None
    phases: list[PhaseRecord]
    records: dict[str, Record]
    received: list[Received]


class _Offers(NamedTuple):
    """The answers to a call: positions of the free robots, and what occupies the busy ones."""

    free: dict[str, Place]
    busy: dict[str, str]


class Leader:
    """Leads one mission, in one thread. place: the leader's current place. on_phase: called with the plan and each
    phase that begins. is_interrupted: returns the reason of an interruption, else an empty string.

    The leader's own part is done by its mission agent, like that of every other robot."""

    def __init__(
        self,
        mission: str,
        transport: Transport,
        place: Callable[[], Place],
        on_phase: Callable[[CooperativePlan, str], None] = lambda plan, phase: None,
        is_interrupted: Callable[[], str] = lambda: "",
    ) -> None:
        self._mission, self._transport, self._place, self._on_phase = mission, transport, place, on_phase
        self._is_interrupted = is_interrupted
        self._name = transport.name
        self._order = Order(mission=mission, leader=self._name)
        self._states: dict[str, State] = {}
        self._state_received_at: dict[str, float] = {}
        self._echo: dict[str, tuple[float, float]] = {}
        self._phases: list[PhaseRecord] = []
        self._plan: CooperativePlan | None = None
        self._ordered_at = 0.0

    def lead(self, kind: str, expansion: Expansion) -> MissionReport:
        """Run the mission to its end. Errors are in the report."""
        began, result, reason = time.time(), "done", ""
        try:
            plan = self._agree(expansion)
            for step in range(len(plan.phases)):
                self._do(plan, step)
            self._end(plan, "done", "")
        except Exception as error:
            result, reason = "failed", str(error) or type(error).__name__
            if not isinstance(error, MissionFailed):
                _log.warning("mission %s: %s: %s", self._mission, type(error).__name__, error)
            if self._plan:
                self._end(self._plan, "aborted", reason)
        records = {name: state.record for name, state in self._states.items() if state.record}
        messages = [each for each in list(self._transport.received) if each.message.mission.startswith(self._mission)]
        return MissionReport(
            self._mission,
            kind,
            self._name,
            result,
            reason,
            began,
            time.time(),
            self._plan,
            self._phases,
            records,
            messages,
        )

    # ---- agreement: no robot moves ----

    def _agree(self, expansion: Expansion) -> CooperativePlan:
        """A plan that all of its robots have accepted."""
        deadline = time.monotonic() + AGREEMENT_TIMEOUT_S
        refusing: dict[str, str] = {}
        attempt = 0
        while True:
            attempt += 1
            mission = f"{self._mission}.{attempt}"
            offers = self._collect_offers(mission, expansion)
            if missing := _lacking(expansion, offers.free, offers.busy):
                if not offers.busy or _lacking(expansion, [*offers.free, *offers.busy]):
                    raise MissionFailed(missing)
            else:
                plan = expansion.plan(mission, self._name, self._candidates(expansion, offers.free, refusing))
                refusing = self._agree_on(plan)
                if not refusing:
                    return plan
                missing = "not enough robots accept: " + "; ".join(f"{name}: {why}" for name, why in refusing.items())
            if time.monotonic() > deadline:
                raise MissionFailed(missing)
            self._pause(random.uniform(0.0, MAX_RETRY_PAUSE_S))

    def _collect_offers(self, mission: str, expansion: Expansion) -> _Offers:
        """Publish calls and collect the offers."""
        needed, here = expansion.helpers, expansion.meeting_point
        offers = _Offers({}, {})
        if not needed:
            return offers
        self._transport.subscribe([(Offer, "*")])
        began, sent_at = time.monotonic(), 0.0
        while (now := time.monotonic()) - began < (
            OFFER_TIMEOUT_S if _lacking(expansion, offers.free) else SURPLUS_OFFER_TIMEOUT_S
        ):
            if now - sent_at > PROPOSAL_INTERVAL_S:
                call = Call(
                    mission=mission,
                    leader=self._name,
                    floor=here.floor,
                    x=here.x,
                    y=here.y,
                    helpers=needed,
                    heard=[*offers.free, *offers.busy],
                )
                self._transport.publish(call, 1.0)
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

    def _candidates(self, expansion: Expansion, free: dict[str, Place], refusing: Container[str]) -> dict[str, Place]:
        """The leader and the nearest free robots; those that refused before only if there are not enough others."""
        here = expansion.meeting_point

        def order(name: str) -> tuple[bool, bool, bool, float]:
            at = free[name]
            is_far = at.floor != here.floor
            return name not in expansion.wanted, name in refusing, is_far, math.dist(at[1:], here[1:])

        nearest = sorted(free, key=order)
        willing = [name for name in nearest if name not in refusing]
        names = (willing if len(willing) >= expansion.helpers else nearest)[: expansion.helpers + SPARE_CANDIDATES]
        return {self._name: self._place(), **{name: free[name] for name in names}}

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.05))
            self._check_interruption()

    def _agree_on(self, plan: CooperativePlan) -> dict[str, str]:
        """Robots that refuse their SubPlan, with the reasons; then the plan is aborted and the others are free again.

        Raises MissionFailed if the leader's own mission agent refuses."""
        self._plan = plan
        self._order = Order(mission=plan.mission, leader=self._name)
        self._states, self._state_received_at, self._echo = {}, {}, {}  # discard those of earlier attempts
        self._on_phase(plan, "asking")
        refusing = {name: why for name, why in self._propose(plan).items() if why}
        if refusing:
            self._end(plan, "aborted", f"{', '.join(refusing)} did not accept", set(refusing))
            self._plan = None
        if self._name in refusing:
            raise MissionFailed(f"{self._name} can't do its own part: {refusing[self._name]}")
        return refusing

    def _propose(self, plan: CooperativePlan) -> dict[str, str]:
        """Propose the plan to its robots: each one's reason to refuse, empty if it accepts. Orders are published
        meanwhile, so that robots that have accepted do not time out."""
        names = [subplan.robot for subplan in plan.subplans]
        self._transport.subscribe([(kind, name) for name in names for kind in (Answer, State)])
        answers: dict[str, str] = {}
        deadline, sent_at = time.monotonic() + ANSWER_TIMEOUT_S, 0.0
        while len(answers) < len(names) and time.monotonic() < deadline:
            if time.monotonic() - sent_at > PROPOSAL_INTERVAL_S:
                for subplan in plan.subplans:
                    if subplan.robot not in answers:
                        proposal = Proposal(
                            mission=plan.mission, leader=self._name, phases=plan.phases, subplan=subplan
                        )
                        self._transport.publish(proposal, 1.0)
                sent_at = time.monotonic()
            received = self._transport.receive(0.05)
            if received and isinstance(received.message, Answer) and received.message.mission == plan.mission:
                answer = received.message
                answers[answer.robot] = "" if answer.accepts else answer.reason or "no"
                if not answer.accepts:
                    deadline = min(deadline, time.monotonic() + TIMEOUT_AFTER_REFUSAL_S)
            self._publish_order(None)
            self._check_interruption()
        return {name: answers.get(name, "no answer in time") for name in names}

    # ---- synchronized steps ----

    def _do(self, plan: CooperativePlan, step: int) -> None:
        """Have all robots do a step."""
        names = [subplan.robot for subplan in plan.subplans]
        limit_s = max(subplan.steps[step].limit_s for subplan in plan.subplans)
        at = time.time() + STEP_LEAD_S
        phase = PhaseRecord(plan.phases[step], at, {}, {})
        self._phases.append(phase)
        self._on_phase(plan, phase.name)
        self._order = Order(mission=plan.mission, leader=self._name, step=step, at=at)
        self._ordered_at = 0.0
        if step == 0:
            self._state_received_at = dict.fromkeys(names, time.monotonic())
        pacer = self._pacer_of(plan, step)
        while len(phase.done) < len(names):
            self._receive_states(0.02, plan)
            for name in names:
                state = self._states.get(name)
                if state is None or state.step < step:
                    continue
                if state.step == step and state.began_at:
                    phase.started.setdefault(name, state.began_at)
                if state.is_done or state.step > step:
                    phase.done.setdefault(name, time.time())
            self._check_members(names, phase.name)
            if time.time() > at + limit_s + STEP_GRACE_S:
                late = [name for name in names if name not in phase.done]
                raise MissionFailed(f"{phase.name}: {', '.join(late)} took longer than {limit_s:g} s")
            if pacer:
                pacer.set_rate(self._carry_rate(names))
            self._publish_order(pacer)

    def _pacer_of(self, plan: CooperativePlan, step: int) -> _CarryPacer | None:
        for subplan in plan.subplans:
            own_step = subplan.steps[step]
            if isinstance(own_step, Carry):
                return _CarryPacer(Trajectory.from_rows(own_step.rows).duration, self._order.at)
        return None

    def _carry_rate(self, names: list[str]) -> float:
        """The rate at which the carry may continue, 0 to 1."""
        now = time.monotonic()
        if any(now - self._state_received_at[name] > CARRY_PAUSE_TIMEOUT_S for name in names):
            return 0.0
        worst = max((self._states[name].error_m for name in names if name in self._states), default=0.0)
        return 0.0 if worst > STOP_ERROR_M else 0.5 if worst > SLOW_ERROR_M else 1.0

    def _check_members(self, names: list[str], phase: str) -> None:
        self._check_interruption(f"{phase}: {self._name}: ")
        now = time.monotonic()
        for name in names:
            state = self._states.get(name)
            if state and state.failed:
                raise MissionFailed(f"{phase}: {name} at {state.floor} ({state.x:.2f}, {state.y:.2f}): {state.failed}")
            if state and state.ended:
                raise MissionFailed(f"{phase}: {name} has left the mission")
            if now - self._state_received_at.get(name, now) > MEMBER_TIMEOUT_S:
                raise MissionFailed(f"{phase}: {name} is silent")

    def _check_interruption(self, prefix: str = "") -> None:
        if reason := self._is_interrupted():
            raise MissionFailed(prefix + reason)

    # ---- the end ----

    def _end(self, plan: CooperativePlan, end: str, reason: str, never_began: Collection[str] = ()) -> None:
        """Publish the end until all members have ended or timed out, except those that never began."""
        names = {subplan.robot for subplan in plan.subplans}.difference(never_began)
        self._on_phase(plan, "done" if end == "done" else "ending safely")
        self._order = Order(
            mission=plan.mission, leader=self._name, step=self._order.step, at=self._order.at, end=end, reason=reason
        )
        self._ordered_at = 0.0
        began = time.monotonic()
        for name in names:
            self._state_received_at.setdefault(name, began)
        while time.monotonic() - began < END_TIMEOUT_S:
            self._publish_order(None)
            self._receive_states(0.02, plan)
            now = time.monotonic()
            waiting = [
                name
                for name in names
                if not (state := self._states.get(name)) or (state.mission == plan.mission and not state.ended)
            ]
            if not [name for name in waiting if now - max(self._state_received_at[name], began) < MEMBER_TIMEOUT_S]:
                return
        _log.warning("mission %s: not all robots reported their end within %g s", plan.mission, END_TIMEOUT_S)

    # ---- messages ----

    def _receive_states(self, timeout_s: float, plan: CooperativePlan) -> None:
        received = self._transport.receive(timeout_s)
        while received:
            state = received.message
            if isinstance(state, State) and state.mission == plan.mission:
                before = self._states.get(state.robot)
                if before is None or before.mission != state.mission or state.sent >= before.sent:
                    self._states[state.robot] = state
                    self._echo[state.robot] = (state.sent, received.received_at)
                self._state_received_at[state.robot] = time.monotonic()
            received = self._transport.receive(0.0)

    def _publish_order(self, pacer: _CarryPacer | None) -> None:
        now = time.monotonic()
        if now - self._ordered_at < ORDER_INTERVAL_S:
            return
        self._ordered_at = now
        order = Order(
            mission=self._order.mission,
            leader=self._name,
            step=self._order.step,
            at=self._order.at,
            along_s=pacer.along_s if pacer else 0.0,
            rate=pacer.rate if pacer else 0.0,
            since=pacer.since if pacer else 0.0,
            end=self._order.end,
            reason=self._order.reason,
            heard=dict(self._echo),
        )
        self._transport.publish(order)


def _lacking(expansion: Expansion, robots: Collection[str], busy: Mapping[str, str] = MappingProxyType({})) -> str:
    """Why these helpers are not sufficient, empty if they are."""
    others = "".join(f"; {name} {does}" for name, does in busy.items())
    if len(robots) < expansion.helpers:
        return (
            f"{expansion.helpers} helpers are needed; {', '.join(sorted(robots)) or 'no robot'} offered to help{others}"
        )
    if absent := sorted(expansion.wanted.difference(robots)):
        return f"{' and '.join(absent)} did not offer to help: not there, or not free{others}"
    return ""


class _CarryPacer:
    """Sets the progress of a carry: at `along_s` on the trajectory at time `since`, and its rate from then on."""

    def __init__(self, duration_s: float, begins: float) -> None:
        self._duration_s = duration_s
        self.since, self.along_s, self.rate = begins, 0.0, 1.0

    def set_rate(self, rate: float) -> None:
        """Continue at this rate, from a time in the future that all members will know in advance."""
        if rate == self.rate or time.time() < self.since:
            return
        since = time.time() + RATE_CHANGE_LEAD_S
        self.along_s = min(self._duration_s, self.along_s + self.rate * (since - self.since))
        self.since, self.rate = since, rate

"""The mission layer: a leader makes a plan with those who offer themselves, asks each to accept its SubPlan, lets all
of them do it step by step in the same rhythm, and answers for the result."""

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
from robocorba.missions.transport import Came, Transport
from robocorba.planning.request import Place

#: Robots have so long to offer themselves, and to accept, s. Proposals are said again so often, s.
OFFER_S, ANSWER_S, AGAIN_S = 3.0, 6.0, 0.5
#: Once one has refused, the others have so long to answer, s.
REFUSED_S = 1.0
#: Where enough robots have offered themselves, the leader waits for nearer ones no longer than this, s.
ENOUGH_S = 1.0
#: Where robots refuse, or are busy, a leader tries again for so long, s, with pauses up to this between, which keep
#: leaders that want the same robots from asking all at once again and again.
AGREE_S, LONGEST_PAUSE_S = 60.0, 3.0
#: Of those who offer themselves so many more than are needed are looked at: those who are nearest.
MORE_THAN_NEEDED = 4
#: Orders are said so often, s; a step begins so long after the word, and a rhythm changes, s.
ORDER_S, AHEAD_S, CHANGE_S = 0.1, 0.3, 0.15
#: A member that was not heard for so long is gone, s; the carry goes on no farther without it after, s.
SILENT_S, WAIT_S = 4.0, 0.5
#: A step that is late by so much more than its limit ends the mission, s.
GRACE_S = 3.0
#: How long members have for a safe end, s.
END_S = 25.0
#: A carrier that is farther from its place slows the others down, and stops them, m.
SLOW_M, STOP_M = 0.06, 0.12

_log = logging.getLogger(__name__)


class Expansion(Protocol):
    """What a cooperative icon becomes."""

    @property
    def helpers(self) -> int:
        """How many robots are needed beside the leader."""

    @property
    def wanted(self) -> frozenset[str]:
        """Names that must be among the helpers."""

    @property
    def meeting_point(self) -> Place:
        """Where they are needed."""

    def plan(self, mission: str, leader: str, robots: dict[str, Place]) -> CooperativePlan:
        """A plan with some of these robots, the leader among them. Raises MissionFailed, ImpossibleCarry, PathError."""


class Phase(NamedTuple):
    """A step as it went, in the leader's time: when it began, and when each robot began and had done it."""

    name: str
    began: float
    started: dict[str, float]
    done: dict[str, float]


class MissionReport(NamedTuple):
    """How a mission went. result: done or failed; reason: why not done. heard: every message that came."""

    mission: str
    kind: str
    leader: str
    result: str
    reason: str
    began: float
    ended: float
    plan: CooperativePlan | None
    phases: list[Phase]
    records: dict[str, Record]
    heard: list[Came]


class _Offers(NamedTuple):
    """Who has answered a call: where those are who are free, and what the others do meanwhile."""

    free: dict[str, Place]
    busy: dict[str, str]


class Leader:
    """Leads one mission, in one thread. place: where the leader is. tell: is told the plan and the phase that begins.

    The leader's own part is done by its mission agent, which hears it as every other robot does."""

    def __init__(
        self,
        mission: str,
        transport: Transport,
        place: Callable[[], Place],
        tell: Callable[[CooperativePlan, str], None] = lambda plan, phase: None,
        is_interrupted: Callable[[], str] = lambda: "",
    ) -> None:
        self._mission, self._transport, self._place, self._tell = mission, transport, place, tell
        self._is_interrupted = is_interrupted
        self._name = transport.name
        self._order = Order(mission=mission, leader=self._name)
        self._states: dict[str, State] = {}
        self._heard_at: dict[str, float] = {}
        self._echo: dict[str, tuple[float, float]] = {}
        self._phases: list[Phase] = []
        self._plan: CooperativePlan | None = None
        self._ordered_at = 0.0

    def lead(self, kind: str, expansion: Expansion) -> MissionReport:
        """To the end; what goes wrong is in the report."""
        began, result, reason = time.time(), "done", ""
        try:
            plan = self._agree(expansion)
            for step in range(len(plan.phases)):
                self._do(plan, step)
            self._end(plan, "done", "")
        except Exception as wrong:
            result, reason = "failed", str(wrong) or type(wrong).__name__
            if not isinstance(wrong, MissionFailed):
                _log.warning("mission %s: %s: %s", self._mission, type(wrong).__name__, wrong)
            if self._plan:
                self._end(self._plan, "aborted", reason)
        records = {name: state.record for name, state in self._states.items() if state.record}
        heard = [came for came in list(self._transport.heard) if came.message.mission.startswith(self._mission)]
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
            heard,
        )

    # ---- before anybody moves ----

    def _agree(self, expansion: Expansion) -> CooperativePlan:
        """A plan that all of its robots have accepted."""
        deadline = time.monotonic() + AGREE_S
        refusing: dict[str, str] = {}
        attempt = 0
        while True:
            attempt += 1
            mission = f"{self._mission}.{attempt}"
            offers = self._called(mission, expansion)
            if missing := _missing(expansion, offers.free, offers.busy):
                if not offers.busy or _missing(expansion, [*offers.free, *offers.busy]):
                    raise MissionFailed(missing)
            else:
                plan = expansion.plan(mission, self._name, self._chosen(expansion, offers.free, refusing))
                refusing = self._refusing(plan)
                if not refusing:
                    return plan
                missing = "not enough robots accept: " + "; ".join(f"{name}: {why}" for name, why in refusing.items())
            if time.monotonic() > deadline:
                raise MissionFailed(missing)
            self._pause(random.uniform(0.0, LONGEST_PAUSE_S))

    def _called(self, mission: str, expansion: Expansion) -> _Offers:
        """Who answers the call."""
        needed, here = expansion.helpers, expansion.meeting_point
        offers = _Offers({}, {})
        if not needed:
            return offers
        self._transport.listen([(Offer, "*")])
        began, said = time.monotonic(), 0.0
        while (now := time.monotonic()) - began < (OFFER_S if _missing(expansion, offers.free) else ENOUGH_S):
            if now - said > AGAIN_S:
                call = Call(
                    mission=mission,
                    leader=self._name,
                    floor=here.floor,
                    x=here.x,
                    y=here.y,
                    helpers=needed,
                    heard=[*offers.free, *offers.busy],
                )
                self._transport.say(call, 1.0)
                said = now
            came = self._transport.get(0.05)
            if came and isinstance(came.message, Offer) and came.message.mission == mission:
                offer = came.message
                if offer.busy:
                    offers.busy[offer.robot] = offer.busy
                else:
                    offers.free[offer.robot] = Place(offer.floor, offer.x, offer.y)
            self._check_interruption()
        return offers

    def _chosen(self, expansion: Expansion, free: dict[str, Place], refusing: Container[str]) -> dict[str, Place]:
        """Us, and the nearest; who refused last only where there are not enough others."""
        here = expansion.meeting_point

        def order(name: str) -> tuple[bool, bool, bool, float]:
            at = free[name]
            is_far = at.floor != here.floor
            return name not in expansion.wanted, name in refusing, is_far, math.dist(at[1:], here[1:])

        nearest = sorted(free, key=order)
        willing = [name for name in nearest if name not in refusing]
        names = (willing if len(willing) >= expansion.helpers else nearest)[: expansion.helpers + MORE_THAN_NEEDED]
        return {self._name: self._place(), **{name: free[name] for name in names}}

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.05))
            self._check_interruption()

    def _refusing(self, plan: CooperativePlan) -> dict[str, str]:
        """Who does not accept its part, and why; all others are let go then. Raises MissionFailed where that is us."""
        self._plan = plan
        self._order = Order(mission=plan.mission, leader=self._name)
        self._states, self._heard_at, self._echo = {}, {}, {}  # of an attempt before this one
        self._tell(plan, "asking")
        refusing = {name: why for name, why in self._asked(plan).items() if why}
        if refusing:
            self._end(plan, "aborted", f"{', '.join(refusing)} did not accept", set(refusing))
            self._plan = None
        if self._name in refusing:
            raise MissionFailed(f"{self._name} can't do its own part: {refusing[self._name]}")
        return refusing

    def _asked(self, plan: CooperativePlan) -> dict[str, str]:
        """Of each robot: why it does not accept, empty where it does. Who does hears us while others don't answer."""
        names = [subplan.robot for subplan in plan.subplans]
        self._transport.listen([(kind, name) for name in names for kind in (Answer, State)])
        answers: dict[str, str] = {}
        deadline, said = time.monotonic() + ANSWER_S, 0.0
        while len(answers) < len(names) and time.monotonic() < deadline:
            if time.monotonic() - said > AGAIN_S:
                for subplan in plan.subplans:
                    if subplan.robot not in answers:
                        proposal = Proposal(
                            mission=plan.mission, leader=self._name, phases=plan.phases, subplan=subplan
                        )
                        self._transport.say(proposal, 1.0)
                said = time.monotonic()
            came = self._transport.get(0.05)
            if came and isinstance(came.message, Answer) and came.message.mission == plan.mission:
                answer = came.message
                answers[answer.robot] = "" if answer.accepts else answer.reason or "no"
                if not answer.accepts:  # nobody is kept for long for what comes to nothing
                    deadline = min(deadline, time.monotonic() + REFUSED_S)
            self._say_order(None)
            self._check_interruption()
        return {name: answers.get(name, "no answer in time") for name in names}

    # ---- all together ----

    def _do(self, plan: CooperativePlan, step: int) -> None:
        """A step of all robots."""
        names = [subplan.robot for subplan in plan.subplans]
        limit_s = max(subplan.steps[step].limit_s for subplan in plan.subplans)
        at = time.time() + AHEAD_S
        phase = Phase(plan.phases[step], at, {}, {})
        self._phases.append(phase)
        self._tell(plan, phase.name)
        self._order = Order(mission=plan.mission, leader=self._name, step=step, at=at)
        self._ordered_at = 0.0
        if step == 0:
            self._heard_at = dict.fromkeys(names, time.monotonic())
        rhythm = self._rhythm(plan, step)
        while len(phase.done) < len(names):
            self._hear(0.02, plan)
            for name in names:
                state = self._states.get(name)
                if state is None or state.step < step:
                    continue
                if state.step == step and state.began_at:
                    phase.started.setdefault(name, state.began_at)
                if state.is_done or state.step > step:
                    phase.done.setdefault(name, time.time())
            self._check_members(names, phase.name)
            if time.time() > at + limit_s + GRACE_S:
                late = [name for name in names if name not in phase.done]
                raise MissionFailed(f"{phase.name}: {', '.join(late)} took longer than {limit_s:g} s")
            if rhythm:
                rhythm.beat(self._slowness(names))
            self._say_order(rhythm)

    def _rhythm(self, plan: CooperativePlan, step: int) -> _Baton | None:
        for subplan in plan.subplans:
            does = subplan.steps[step]
            if isinstance(does, Carry):
                return _Baton(Trajectory.from_rows(does.rows).duration, self._order.at)
        return None

    def _slowness(self, names: list[str]) -> float:
        """How fast the carry may go on, 0 to 1."""
        now = time.monotonic()
        if any(now - self._heard_at[name] > WAIT_S for name in names):
            return 0.0
        worst = max((self._states[name].error_m for name in names if name in self._states), default=0.0)
        return 0.0 if worst > STOP_M else 0.5 if worst > SLOW_M else 1.0

    def _check_members(self, names: list[str], phase: str) -> None:
        self._check_interruption(f"{phase}: {self._name}: ")
        now = time.monotonic()
        for name in names:
            state = self._states.get(name)
            if state and state.failed:
                raise MissionFailed(f"{phase}: {name} at {state.floor} ({state.x:.2f}, {state.y:.2f}): {state.failed}")
            if state and state.ended:
                raise MissionFailed(f"{phase}: {name} has left the mission")
            if now - self._heard_at.get(name, now) > SILENT_S:
                raise MissionFailed(f"{phase}: {name} is silent")

    def _check_interruption(self, who: str = "") -> None:
        if reason := self._is_interrupted():
            raise MissionFailed(who + reason)

    # ---- the end ----

    def _end(self, plan: CooperativePlan, end: str, reason: str, never_began: Collection[str] = ()) -> None:
        """Say it until all members have ended, those that still can; without those that never began."""
        names = {subplan.robot for subplan in plan.subplans}.difference(never_began)
        self._tell(plan, "done" if end == "done" else "ending safely")
        self._order = Order(
            mission=plan.mission, leader=self._name, step=self._order.step, at=self._order.at, end=end, reason=reason
        )
        self._ordered_at = 0.0
        began = time.monotonic()
        for name in names:
            self._heard_at.setdefault(name, began)
        while time.monotonic() - began < END_S:
            self._say_order(None)
            self._hear(0.02, plan)
            now = time.monotonic()
            waiting = [
                name
                for name in names
                if not (state := self._states.get(name)) or (state.mission == plan.mission and not state.ended)
            ]
            if not [name for name in waiting if now - max(self._heard_at[name], began) < SILENT_S]:
                return
        _log.warning("mission %s: not all robots said that they have ended", plan.mission)

    # ---- messages ----

    def _hear(self, timeout_s: float, plan: CooperativePlan) -> None:
        came = self._transport.get(timeout_s)
        while came:
            state = came.message
            if isinstance(state, State) and state.mission == plan.mission:
                before = self._states.get(state.robot)
                if before is None or before.mission != state.mission or state.sent >= before.sent:
                    self._states[state.robot] = state
                    self._echo[state.robot] = (state.sent, came.came)
                self._heard_at[state.robot] = time.monotonic()
            came = self._transport.get(0.0)

    def _say_order(self, rhythm: _Baton | None) -> None:
        now = time.monotonic()
        if now - self._ordered_at < ORDER_S:
            return
        self._ordered_at = now
        order = Order(
            mission=self._order.mission,
            leader=self._name,
            step=self._order.step,
            at=self._order.at,
            along_s=rhythm.along_s if rhythm else 0.0,
            rate=rhythm.rate if rhythm else 0.0,
            since=rhythm.since if rhythm else 0.0,
            end=self._order.end,
            reason=self._order.reason,
            heard=dict(self._echo),
        )
        self._transport.say(order)


def _missing(expansion: Expansion, robots: Collection[str], busy: Mapping[str, str] = MappingProxyType({})) -> str:
    """Why these helpers are not enough, empty where they are."""
    others = "".join(f"; {name} {does}" for name, does in busy.items())
    if len(robots) < expansion.helpers:
        return (
            f"{expansion.helpers} helpers are needed; {', '.join(sorted(robots)) or 'nobody'} offered to help{others}"
        )
    if absent := sorted(expansion.wanted.difference(robots)):
        return f"{' and '.join(absent)} did not offer to help: not there, or not free{others}"
    return ""


class _Baton:
    """What gives the rhythm: so far along a trajectory since a time, and so fast."""

    def __init__(self, duration_s: float, begins: float) -> None:
        self._duration_s = duration_s
        self.since, self.along_s, self.rate = begins, 0.0, 1.0

    def beat(self, rate: float) -> None:
        """Go on at this rate: from a moment on that all members will have heard of before it comes."""
        if rate == self.rate or time.time() < self.since:
            return
        since = time.time() + CHANGE_S
        self.along_s = min(self._duration_s, self.along_s + self.rate * (since - self.since))
        self.since, self.rate = since, rate

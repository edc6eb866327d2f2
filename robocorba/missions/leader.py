"""The mission layer: a leader reserves the areas that its mission needs, collects offers, makes a plan, has each robot
accept its SubPlan, leads attempts at it, and reports the result.

After a fault all robots end safely, and the leader begins another attempt from where everything stands now."""

from __future__ import annotations

import logging
import random
import re
import time
from collections.abc import Callable, Collection, Mapping, Sequence

from msgspec.structs import replace

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import GoalReached, InTheWay, MissionFailed, MissionTakenOver, RobotLost
from robocorba.map_editor.polygons import FloorArea
from robocorba.missions.attempt import Attempt, AttemptFailed, Interrupted, LeaderRobot
from robocorba.missions.clearing import Requests
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.cooperative_planner import CarriedBody, CooperativePlanner
from robocorba.missions.leader_policy import DEFAULT_POLICY, LeaderPolicy
from robocorba.missions.messages import Answer, Assignment, Call, Offer, WayMade
from robocorba.missions.party import lacking, nearest_first
from robocorba.missions.recorder import LedMission
from robocorba.missions.remaining_carry import RemainingCarry
from robocorba.missions.report import ASKING, RECOVERING, WAITING_FOR_AREAS, MissionReport
from robocorba.missions.subplan import CooperativePlan
from robocorba.missions.transport import Transport
from robocorba.planning.request import Place

_log = logging.getLogger(__name__)


class Leader:
    """Leads one mission, in one thread. led: the mission, which others follow. robot: the one that leads; its own part
    is done by its mission agent, like that of every other robot."""

    def __init__(
        self, led: LedMission, transport: Transport, robot: LeaderRobot, policy: LeaderPolicy = DEFAULT_POLICY
    ) -> None:
        self._led, self._transport, self._robot, self._policy = led, transport, robot, policy
        self._mission, self._name = led.name, transport.name
        #: What ended the attempts before.
        self._faults: list[str] = []
        #: Whether robots have begun to do a plan.
        self._has_begun = False
        #: The last attempt on which all agreed, and whether it goes on.
        self._attempt: Attempt | None = None
        self._is_under_way = False
        #: Until when it waits for areas [s, monotonic], and whether it had to.
        self._areas_deadline, self._has_waited = 0.0, False

    def lead(
        self, kind: str, make_planner: Callable[[], CooperativePlanner], inherited: RemainingCarry | None = None
    ) -> MissionReport:
        """Run the mission to its end. kind: for display. make_planner: called before each attempt; its planner plans
        with what is where then. It raises GoalReached if there is nothing to do. inherited: what the robots hold as
        the mission is taken over. Errors are in the report."""
        began, result, reason = OWN_CLOCK.now(), "done", ""
        try:
            if inherited:
                self._carry_on(inherited)
            while not self._is_done(make_planner):
                pass
        except GoalReached as error:
            _log.info("mission %s: %s", self._mission, error)
        except Exception as error:
            result, reason = "failed", str(error) or type(error).__name__
            if not isinstance(error, MissionFailed):
                _log.warning("mission %s: %s: %s", self._mission, type(error).__name__, error)
            if self._faults:
                reason = f"{reason}, at attempt {len(self._faults) + 1}{_before(self._faults, reason)}"
            self._end("aborted", reason)
        self._robot.areas.release()
        attempt = self._attempt
        states = attempt.states if attempt else {}
        measurements = {name: state.measurements for name, state in states.items() if state.measurements}
        received = [each for each in list(self._transport.received) if each.message.mission.startswith(self._mission)]
        return MissionReport(
            self._mission,
            kind,
            self._name,
            result,
            reason,
            began,
            OWN_CLOCK.now(),
            attempt.plan if attempt else None,
            self._led.phases,
            measurements,
            received,
            tuple(self._faults),
        )

    def _is_done(self, make_planner: Callable[[], CooperativePlanner]) -> bool:
        """Agree on a plan, and do it. Returns whether all of its robots have done it to its end; if not, all have
        ended safely."""
        attempt = self._agree(make_planner)
        self._has_begun = True
        return self._is_run(attempt.run) and not attempt.without

    def _carry_on(self, inherited: RemainingCarry) -> None:
        """Do the rest of a plan with the robots that are left, as far as possible. Then all have ended safely."""
        attempt = self._begin(inherited.plan, inherited)
        self._transport.subscribe(attempt.subscriptions())
        self._has_begun = True
        self._is_run(lambda: attempt.carry_on(inherited.plan.leader))

    def _is_run(self, run: Callable[[], None]) -> bool:
        """Whether an attempt comes to its end. If not, all robots have ended safely."""
        try:
            run()
        except AttemptFailed as fault:
            if len(self._faults) == self._policy.max_recoveries:
                raise
            _log.warning("mission %s: %s; %s tries again", self._mission, fault, self._name)
            self._end("aborted", str(fault))
            self._faults.append(str(fault))
            self._led.begin_without_robots(RECOVERING)
            return False
        self._end("done", "")
        return True

    def _begin(self, plan: CooperativePlan, body: CarriedBody) -> Attempt:
        self._is_under_way = True
        self._attempt = Attempt(plan, body, self._led, self._transport, self._robot, self._policy)
        return self._attempt

    def _end(self, end: str, reason: str, never_began: Collection[str] = ()) -> None:
        if self._attempt and self._is_under_way:
            self._is_under_way = False
            self._attempt.end(end, reason, never_began)

    # ---- agreement: no robot moves ----

    def _agree(self, make_planner: Callable[[], CooperativePlanner]) -> Attempt:
        """An attempt at a plan that all of its robots have accepted."""
        is_recovering, policy = self._has_begun, self._policy
        deadline = time.monotonic() + (policy.recovery_timeout_s if is_recovering else policy.agreement_timeout_s)
        refusing: dict[str, str] = {}
        staying: dict[str, str] = {}
        while True:
            try:
                self._led.begin_attempt()
                began = time.monotonic()
                planner = self._planner_with_areas(make_planner, staying)
                deadline += time.monotonic() - began  # waiting for areas may take longer than agreeing
                with self._robot.awaiting(lambda: "offers of helpers"):
                    free, busy = self._collect_offers(planner)
                if missing := lacking(planner, free, busy):
                    is_hopeless = not busy or lacking(planner, [*free, *busy])
                    if is_hopeless and not is_recovering:
                        raise MissionFailed(missing)
                else:
                    candidates = self._candidates(planner, free, {*refusing, *staying})
                    plan = planner.plan(self._led.attempt, self._name, candidates, staying)
                    attempt = self._begin(plan, planner)
                    with self._robot.awaiting(lambda: "the answers of helpers"):
                        refusing = self._refusals(attempt)
                    if not refusing:
                        return attempt
                    reasons = "; ".join(f"{name}: {why}" for name, why in refusing.items())
                    missing = f"not enough robots accept: {reasons}"
            except InTheWay as blocked:
                staying.update(self._clear_way(blocked.aside))
                missing = _stays(staying) or str(blocked)
                if time.monotonic() <= deadline:
                    continue
            except RoboCorbaError as error:  # what is in the way may leave; after a fault, what is away may come back
                is_final = isinstance(error, (GoalReached, MissionTakenOver, Interrupted))
                if is_final or not (is_recovering or staying):
                    raise
                missing = f"{error}; {_stays(staying)}" if staying else str(error)
                staying = {}
            if time.monotonic() > deadline:
                raise MissionFailed(missing)
            self._pause(random.uniform(0.0, policy.max_retry_pause_s), f"another try: {missing}")

    def _planner_with_areas(
        self, make_planner: Callable[[], CooperativePlanner], staying: Collection[str]
    ) -> CooperativePlanner:
        """A planner whose areas are granted to this robot, with what is where after the wait for them."""
        self._areas_deadline = time.monotonic() + self._policy.areas_timeout_s
        while True:
            planner, self._has_waited = make_planner(), False
            planner.reserve(self._reserve, staying)
            if not self._has_waited:
                return planner

    def _reserve(self, alternatives: Sequence[Sequence[FloorArea]], hold_s: float) -> int:
        """See ReserveOneOf. Raises MissionFailed, SimulationError, RobotLost."""
        policy, areas = self._policy, self._robot.areas
        index = areas.request(alternatives, hold_s)
        answered, ahead = time.monotonic(), 0
        while True:
            try:
                state = areas.state()
                if state and state.granted:
                    break
                ahead = state.ahead if state else 0
                if state is None:  # the robot was logged off meanwhile
                    index = areas.request(alternatives, hold_s)
                answered = time.monotonic()
            except RobotLost:  # the simulation server may come back
                if time.monotonic() - answered > policy.recovery_timeout_s:
                    raise
            if not self._has_waited:
                self._has_waited = True
                self._led.begin_without_robots(WAITING_FOR_AREAS)
            if time.monotonic() > self._areas_deadline:
                raise MissionFailed(f"the areas were not granted within {policy.areas_timeout_s:g} s")
            self._pause(policy.areas_interval_s, f"reserved areas, {ahead} ahead")
        if self._has_waited:
            self._led.begin_without_robots(ASKING)
        return index

    def _clear_way(self, aside: Mapping[str, tuple[str, float, float] | None]) -> dict[str, str]:
        """Ask robots to step aside. Returns those that stay, with the reasons."""
        self._led.begin_without_robots(f"clearing the way: {', '.join(sorted(aside))}")
        requests = Requests(aside, self._led.attempt, self._led.term, self._transport, self._policy)
        self._transport.subscribe([(WayMade, name) for name in requests.robots])
        with self._robot.awaiting(lambda: f"{' and '.join(requests.robots)} to step aside"):
            while requests.robots:
                requests.update()
                received = self._transport.receive(0.05)
                if received and isinstance(received.message, WayMade):
                    requests.receive(received.message)
                self._robot.check()
        return requests.staying

    def _collect_offers(self, planner: CooperativePlanner) -> tuple[dict[str, Place], dict[str, str]]:
        """Publish calls and collect the offers: the places of free robots, and what occupies the busy ones."""
        free: dict[str, Place] = {}
        busy: dict[str, str] = {}
        mission, policy = self._led.attempt, self._policy
        if not planner.helpers:
            return free, busy
        self._transport.subscribe([(Offer, "*")])
        floor, x, y = planner.meeting_point
        call = Call(
            mission=mission, leader=self._name, term=self._led.term, floor=floor, x=x, y=y, helpers=planner.helpers
        )
        began, sent_at = time.monotonic(), 0.0
        while (now := time.monotonic()) - began < (
            policy.offer_timeout_s if lacking(planner, free) else policy.surplus_offer_timeout_s
        ):
            if now - sent_at > policy.repeat_interval_s:
                self._transport.publish(replace(call, received_offers=[*free, *busy]), 1.0)
                sent_at = now
            received = self._transport.receive(0.05)
            if received and isinstance(received.message, Offer) and received.message.mission == mission:
                offer = received.message
                if offer.busy:
                    busy[offer.robot] = offer.busy
                else:
                    free[offer.robot] = Place(offer.floor, offer.x, offer.y)
            self._robot.check()
        return free, busy

    def _candidates(
        self, planner: CooperativePlanner, free: dict[str, Place], refusing: Collection[str]
    ) -> dict[str, Place]:
        """The leader and the nearest free robots; those that refused before only if there are not enough others."""
        nearest = nearest_first(planner, free, refusing)
        willing = [name for name in nearest if name not in refusing]
        names = willing if len(willing) >= planner.helpers else nearest
        names = names[: planner.helpers + self._policy.spare_candidates]
        return {self._name: self._robot.place(), **{name: free[name] for name in names}}

    def _pause(self, seconds: float, awaited: str) -> None:
        until = time.monotonic() + seconds
        with self._robot.awaiting(lambda: awaited):
            while (left := until - time.monotonic()) > 0.0:
                time.sleep(min(left, 0.05))
                self._robot.check()

    def _refusals(self, attempt: Attempt) -> dict[str, str]:
        """Robots that refuse their SubPlan, with the reasons; then the attempt has ended and the others are free again.

        Raises MissionFailed if the leader's own mission agent refuses."""
        self._led.note(attempt.plan, ASKING)
        refusing = {name: why for name, why in self._assign(attempt).items() if why}
        if refusing:
            self._end("aborted", f"{', '.join(refusing)} did not accept", set(refusing))
            self._attempt = None
        if self._name in refusing:
            raise MissionFailed(f"{self._name} can't do its own part: {refusing[self._name]}")
        return refusing

    def _assign(self, attempt: Attempt) -> dict[str, str]:
        """Assign the SubPlans to the robots: each one's reason to refuse, empty if it accepts. Orders are published
        meanwhile, so that robots that have accepted do not time out."""
        plan, leader, term = attempt.plan, self._name, self._led.term
        assignments = {
            subplan.robot: Assignment(
                mission=plan.mission, leader=leader, term=term, phases=plan.phases, subplan=subplan
            )
            for subplan in plan.subplans
        }
        self._transport.subscribe([*attempt.subscriptions(), *((Answer, name) for name in assignments)])
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
            attempt.publish_order()
            self._robot.check()
        return {name: answers.get(name, "no answer in time") for name in assignments}


def _before(faults: Sequence[str], last: str) -> str:
    """The faults of earlier attempts: of those that differ by numbers only the latest, and none like `last`."""
    found = {re.sub(r"[\d.]+", "", fault): fault for fault in (*faults, last)}
    others = [fault for fault in found.values() if fault != last]
    return f"; before: {'; '.join(others)}" if others else ""


def _stays(staying: Mapping[str, str]) -> str:
    """The robots that do not step aside, and why."""
    return "; ".join(f"{name} is in the way and {why}" for name, why in staying.items())

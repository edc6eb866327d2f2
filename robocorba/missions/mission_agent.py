"""The part of each robot in missions: it offers its help while it is free, and carries out accepted SubPlans."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import msgspec

from robocorba.errors.events import EventError
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.missions.execution import ObjectLocator
from robocorba.missions.making_way import MakingWay
from robocorba.missions.member import DEFAULT_POLICY, Member, MemberPolicy
from robocorba.missions.messages import Answer, Assignment, Call, MakeWay, Message, Offer, Order, WayMade
from robocorba.missions.subplan import CooperativePlan, Reserve
from robocorba.missions.transport import Received, Transport
from robocorba.robot.agent import ControlAgent
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.system.background import Background

#: Publishing is retried for this time; pause after the channel failed [s].
RETRY_S = 1.0
#: Failed attempts after which a warning is logged: a channel that starts meanwhile is there before.
WARN_AFTER = 3

_log = logging.getLogger(__name__)


class MissionAgent:
    """Takes part in missions from `start` to `close`. agent: of the robot. locate: returns objects in its frame.
    plan_of: reads a plan by leader and mission in the leader's data pool; None if that fails, after 2 s at most.
    on_orphaned: called with a mission and its term when the leader is silent and the robot can lead the mission, as it
    has ended its part or holds an object; must not block."""

    def __init__(
        self,
        transport: Transport,
        agent: ControlAgent,
        locate: ObjectLocator,
        policy: MemberPolicy = DEFAULT_POLICY,
        on_orphaned: Callable[[str, int], None] = lambda mission, term: None,
        plan_of: Callable[[str, str], CooperativePlan | None] = lambda leader, mission: None,
    ) -> None:
        self._transport, self._agent, self._locate, self._policy = transport, agent, locate, policy
        self._on_orphaned, self._plan_of = on_orphaned, plan_of
        #: The call that it has answered last, until it gets its assignment or is not needed; since when the leader's
        #: orders come without one [s, monotonic].
        self._offered: Call | None = None
        self._missing_since = 0.0
        self._member: Member | None = None
        #: The highest term of each of the latest 100 missions, the latest one last.
        self._terms: dict[str, int] = {}
        #: The latest task to step aside for others.
        self._making_way: MakingWay | None = None
        self._ended_at: float | None = None
        self._published_at = 0.0
        self._published: object = None
        #: The leader of which it receives orders; * for all, None before the first subscription.
        self._orders_from: str | None = None
        #: Whether on_orphaned was called since the leader fell silent.
        self._is_announced = False
        self._closing = threading.Event()
        self._thread = Background("missions", self._run, lambda reason: agent.stop(reason))

    def start(self) -> MissionAgent:
        self._thread.start()
        return self

    def close(self) -> None:
        self._closing.set()
        self._transport.wake()
        self._thread.wait_for_end()

    @property
    def mission(self) -> str:
        """The mission in which the robot takes part; empty for none."""
        member = self._member
        return member.of if member is not None and not member.has_ended else ""

    def is_holding_for(self, mission: str) -> bool:
        """Whether the robot holds an object for a mission whose leader is silent."""
        member = self._member
        return member is not None and member.of == mission and member.is_orphaned and member.is_holding

    def take_over_reservation(self, step: Reserve, is_reserved: bool) -> None:
        """See Member."""
        if member := self._member:
            member.take_over_reservation(step, is_reserved)

    def _run(self) -> None:
        failures = 0
        while not self._closing.is_set():
            try:
                self._check_leader()
                self._subscribe()
                timeout_s = self._policy.state_interval_s / 4 if self._member else None
                if received := self._transport.receive(timeout_s):
                    self._handle(received)
                self._publish_state()
                failures = 0
            except (NotReachable, EventError) as error:
                failures += 1
                level = logging.WARNING if failures == WARN_AFTER else logging.INFO
                _log.log(level, "no event channel, next attempt in %g s: %s", RETRY_S, error)
                self._closing.wait(RETRY_S)
            except Exception:  # one bad message must not end the thread
                _log.exception("handling a mission message failed")
                self._closing.wait(RETRY_S)

    def _subscribe(self) -> None:
        member = self._member
        leader = self._offered.leader if self._offered else ""
        if member is not None:
            leader = "*" if member.is_orphaned else member.leader
        if leader != self._orders_from:
            patterns: list[tuple[type[Message], str]] = [(Call, "*"), (Assignment, "*"), (MakeWay, "*")]
            if leader:
                patterns.append((Order, leader))
            self._transport.subscribe(patterns)
            self._orders_from = leader

    def _check_leader(self) -> None:
        """Check the member's timeouts, also while there is no event channel."""
        member = self._member
        if member is None:
            return
        member.check_timeouts()
        can_lead = member.has_ended or member.is_holding
        needs_leader = member.is_orphaned and can_lead and member.leader != self._transport.name
        if needs_leader and not self._is_announced:
            self._on_orphaned(member.of, member.term)
        self._is_announced = needs_leader

    def _handle(self, received: Received) -> None:
        message = received.message
        if isinstance(message, (Call, Assignment, MakeWay, Order)) and not self._obeys(message):
            return
        if isinstance(message, Order) and self._member:
            self._member.follow(message, received.received_at)
        elif isinstance(message, Order):
            self._catch_up(message)
        elif isinstance(message, Call):
            self._answer_call(message)
        elif isinstance(message, Assignment) and message.subplan.robot == self._transport.name:
            self._answer_assignment(message)
        elif isinstance(message, MakeWay) and message.robot == self._transport.name:
            self._make_way(message)

    def _obeys(self, message: Call | Assignment | MakeWay | Order) -> bool:
        """Whether no leader of a later term is known. A part under an earlier leader ends, unless the later one goes on
        with the same attempt."""
        highest = self._terms.pop(message.of, 0)
        self._terms[message.of] = max(highest, message.term)
        while len(self._terms) > 100:
            del self._terms[next(iter(self._terms))]
        member = self._member
        if member and member.of == message.of and member.term < message.term and not member.has_ended:
            goes_on = isinstance(message, Order) and message.mission == member.mission
            if not goes_on:
                member.abort(f"{message.leader} leads the mission now")
        return message.term >= highest

    def _answer_call(self, call: Call) -> None:
        if self._transport.name in (call.leader, *call.received_offers) or not self._has_arms:
            return
        busy = self._occupation()
        if not busy and not self._agent.is_free:
            return
        floor, x, y, _ = self._agent.place
        name, leader = self._transport.name, call.leader
        offer = Offer(mission=call.mission, robot=name, leader=leader, floor=floor, x=x, y=y, busy=busy)
        self._transport.publish(offer, RETRY_S)
        if not busy:
            self._offered, self._missing_since = call, 0.0

    def _catch_up(self, order: Order) -> None:
        """Read the SubPlan in the leader's data pool if its event is lost: the leader waits for answers still."""
        call = self._offered
        if call is None or call.mission != order.mission:
            return
        if order.step >= 0 or order.end:
            self._offered = None
            return
        now = time.monotonic()
        self._missing_since = self._missing_since or now
        if now - self._missing_since < self._policy.plan_timeout_s:
            return
        self._missing_since = now  # of the next attempt, if this one fails
        plan = self._plan_of(order.leader, order.mission)
        if plan is not None:
            self._offered = None
            _log.info("mission %s: read the plan in the data pool of %s", order.mission, order.leader)
            for subplan in plan.subplans:
                if subplan.robot == self._transport.name:
                    self._answer_assignment(
                        Assignment(
                            mission=order.mission,
                            leader=order.leader,
                            term=order.term,
                            phases=plan.phases,
                            subplan=subplan,
                        )
                    )

    @property
    def _has_arms(self) -> bool:
        """Whether it can do the steps of plans, which move its arms at least out of the way."""
        try:
            return len(self._agent.joints) == len(JOINTS)
        except RobotError:
            return False

    def _occupation(self) -> str:
        """What the robot does; empty if it has no task."""
        if self._member is not None and not self._member.has_ended:
            return f"is in mission {self._member.mission}"
        if not self._agent.is_busy:
            return ""
        task = self._making_way
        return f"makes way for mission {task.request.of}" if task and task.is_running else "runs a program"

    def _make_way(self, request: MakeWay) -> None:
        """Step aside if the robot is free. A repeated request gets an answer how far it is."""
        task = self._making_way
        if task is not None and task.is_for(request):
            self._transport.publish(task.answer, RETRY_S)
            return
        answer = WayMade(mission=request.mission, robot=request.robot, leader=request.leader, reason=self._occupation())
        if not answer.reason:
            try:
                self._making_way = self._agent.begin_part(lambda robot: MakingWay(request, robot))
            except RobotError as error:
                answer = msgspec.structs.replace(answer, reason=str(error))
        self._transport.publish(answer, RETRY_S)

    def _answer_assignment(self, assignment: Assignment) -> None:
        """Accept if the robot is free. A repeated assignment gets the same answer."""
        mission, leader, reason, self._offered = assignment.mission, assignment.leader, "", None
        if self._member is None or self._member.mission != mission:
            reason = self._accept(assignment)
        answer = Answer(mission=mission, robot=self._transport.name, leader=leader, accepts=not reason, reason=reason)
        self._transport.publish(answer, RETRY_S)

    def _accept(self, assignment: Assignment) -> str:
        """The reason of a refusal, empty if accepted."""
        if self._member is not None and not self._member.has_ended:
            return f"is in mission {self._member.mission}"
        if not self._has_arms:
            return "does not have the joints of a SmartPal"
        is_own = assignment.leader == self._transport.name
        try:
            member = self._agent.begin_part(lambda robot: Member(assignment, robot, self._locate, self._policy), is_own)
        except RobotError as error:
            return str(error)
        self._member, self._ended_at = member, None
        self._subscribe()
        return ""

    def _publish_state(self) -> None:
        member = self._member
        if member is None:
            return
        now = time.monotonic()
        state = member.state()
        changes = (state.step, state.is_done, state.failure, state.has_left)
        if changes != self._published or now - self._published_at >= self._policy.state_interval_s:
            self._transport.publish(state)
            self._published, self._published_at = changes, now
        if state.has_left:
            self._ended_at = self._ended_at or now
            if now - self._ended_at > self._policy.final_state_s:
                self._member = None

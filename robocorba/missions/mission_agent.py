"""The part of each robot in missions: it offers its help while it is free, and carries out accepted proposals."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

from robocorba.control.robot import Robot
from robocorba.errors.events import EventError
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.missions.execution import ObjectLocator
from robocorba.missions.member import Member
from robocorba.missions.messages import Answer, Call, Offer, Order, Proposal
from robocorba.missions.transport import Received, Transport
from robocorba.simulation.registry import Pose

#: Interval between status messages to the leader [s]; changes are published immediately.
STATE_INTERVAL_S = 0.1
#: Polling interval without a mission [s]; messages wake the thread immediately.
IDLE_POLL_S = 0.25
#: A member repeats its final status message for this time [s], in case one is lost.
FINAL_STATE_S = 3.0
#: Publishing is retried for this time; pause after the channel failed [s].
RETRY_S = 1.0

_log = logging.getLogger(__name__)


class Owner(Protocol):
    """The interface of the control agent that missions need."""

    @property
    def is_free(self) -> bool:
        """Whether the robot can begin a task now."""

    @property
    def is_busy(self) -> bool:
        """Whether the robot is doing a task after which it will be free."""

    @property
    def place(self) -> Pose:
        """The robot's current pose."""

    def begin_part(self, make: Callable[[Robot], Member], for_own_mission: bool) -> Member:
        """Begin a part in a mission. for_own_mission: the robot's own program leads it. Raises IllegalOrder."""


class MissionAgent:
    """Takes part in missions from `start` to `close`. owner: the robot. locate: objects in the robot's frame."""

    def __init__(self, transport: Transport, owner: Owner, locate: ObjectLocator) -> None:
        self._transport, self._owner, self._locate = transport, owner, locate
        self._member: Member | None = None
        self._ended_at: float | None = None
        self._published_at = 0.0
        self._published: object = None
        self._is_subscribed = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="missions", daemon=True)

    def start(self) -> MissionAgent:
        self._thread.start()
        return self

    def close(self) -> None:
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._subscribe()
                if received := self._transport.receive(STATE_INTERVAL_S / 4 if self._member else IDLE_POLL_S):
                    self._handle(received)
                self._publish_state()
            except (NotReachable, EventError) as error:
                _log.info("no event channel, next attempt in %g s: %s", RETRY_S, error)
                self._closing.wait(RETRY_S)
            except Exception:  # one bad message must not end the thread
                _log.exception("handling a mission message failed")

    def _subscribe(self) -> None:
        if not self._is_subscribed:
            leader = self._member.leader if self._member else ""
            patterns: list[tuple[type[Call | Proposal | Order], str]] = [(Call, "*"), (Proposal, "*")]
            if leader:
                patterns.append((Order, leader))
            self._transport.subscribe(patterns)
            self._is_subscribed = True

    def _handle(self, received: Received) -> None:
        message = received.message
        if isinstance(message, Order) and self._member:
            self._member.follow(message, received.received_at)
        elif isinstance(message, Call):
            self._answer_call(message)
        elif isinstance(message, Proposal) and message.subplan.robot == self._transport.name:
            self._answer_proposal(message)

    def _answer_call(self, call: Call) -> None:
        if self._transport.name in (call.leader, *call.heard):
            return
        if self._member is not None and not self._member.has_ended:
            busy = f"is in mission {self._member.mission}"
        elif self._owner.is_busy:
            busy = "runs a program"
        elif self._owner.is_free:
            busy = ""
        else:
            return
        at = self._owner.place
        self._transport.publish(
            Offer(
                mission=call.mission,
                robot=self._transport.name,
                leader=call.leader,
                floor=at.floor,
                x=at.x,
                y=at.y,
                busy=busy,
            ),
            RETRY_S,
        )

    def _answer_proposal(self, proposal: Proposal) -> None:
        """Accept if the robot is free. A repeated proposal gets the same answer."""
        reason = ""
        if self._member is None or self._member.mission != proposal.mission:
            reason = self._accept(proposal)
        answer = Answer(
            mission=proposal.mission,
            robot=self._transport.name,
            leader=proposal.leader,
            accepts=not reason,
            reason=reason,
        )
        self._transport.publish(answer, RETRY_S)

    def _accept(self, proposal: Proposal) -> str:
        """The reason of a refusal, empty if accepted."""
        if self._member is not None and not self._member.has_ended:
            return f"is in mission {self._member.mission}"
        is_own = proposal.leader == self._transport.name
        try:
            member = self._owner.begin_part(lambda robot: Member(proposal, robot, self._locate), is_own)
        except RobotError as error:
            return str(error)
        self._member, self._ended_at, self._is_subscribed = member, None, False
        self._subscribe()
        return ""

    def _publish_state(self) -> None:
        member = self._member
        if member is None:
            return
        member.check_timeouts()
        now = time.monotonic()
        state = member.state()
        changes = (state.step, state.is_done, state.failed, state.ended)
        if changes != self._published or now - self._published_at >= STATE_INTERVAL_S:
            self._transport.publish(state)
            self._published, self._published_at = changes, now
        if state.ended:
            self._ended_at = self._ended_at or now
            if now - self._ended_at > FINAL_STATE_S:
                self._member, self._is_subscribed = None, False

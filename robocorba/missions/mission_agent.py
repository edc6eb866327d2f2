"""What each robot does for missions of others: it offers itself while it is free, and does what it accepted."""

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
from robocorba.missions.execution import Places
from robocorba.missions.member import Member
from robocorba.missions.messages import Answer, Call, Offer, Order, Proposal
from robocorba.missions.transport import Came, Transport
from robocorba.simulation.registry import Pose

#: The leader is told how things are so often, and at once where they change, s.
EVERY_S = 0.1
#: Who has no part in a mission looks around so often only; a message is heard at once, s.
IDLE_S = 0.25
#: A member that has ended says so for so long, in case it was not heard, s.
FAREWELL_S = 3.0
RETRY_S = 1.0

_log = logging.getLogger(__name__)


class Owner(Protocol):
    """The control agent, as far as missions need it."""

    @property
    def is_free(self) -> bool:
        """Whether the robot could begin something now."""

    @property
    def is_busy(self) -> bool:
        """Whether it does something now, and will be free again."""

    @property
    def place(self) -> Pose:
        """Where the robot is."""

    def begin_part(self, make: Callable[[Robot], Member], for_own_mission: bool) -> Member:
        """Begin a part in a mission; of the robot's own one while its program leads it. Raises IllegalOrder."""


class MissionAgent:
    """Of the robot `owner`, from `start` to `close`. where: objects, seen from the robot."""

    def __init__(self, transport: Transport, owner: Owner, where: Places) -> None:
        self._transport, self._owner = transport, owner
        self._where = where
        self._member: Member | None = None
        self._ended_at: float | None = None
        self._told_at = 0.0
        self._told: object = None
        self._is_listening = False
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
                self._listen()
                if came := self._transport.get(EVERY_S / 4 if self._member else IDLE_S):
                    self._hear(came)
                self._look()
            except (NotReachable, EventError) as wrong:
                _log.info("no channel: %s", wrong)
                self._closing.wait(RETRY_S)
            except Exception:  # one message must not end what all missions need
                _log.exception("a mission's message failed")

    def _listen(self) -> None:
        if not self._is_listening:
            leader = self._member.leader if self._member else ""
            patterns: list[tuple[type[Call | Proposal | Order], str]] = [(Call, "*"), (Proposal, "*")]
            if leader:
                patterns.append((Order, leader))
            self._transport.listen(patterns)
            self._is_listening = True

    def _hear(self, came: Came) -> None:
        message = came.message
        if isinstance(message, Order) and self._member:
            self._member.follow(message, came.came)
        elif isinstance(message, Call):
            self._offer(message)
        elif isinstance(message, Proposal) and message.subplan.robot == self._transport.name:
            self._answer(message)

    def _offer(self, call: Call) -> None:
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
        self._transport.say(
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

    def _answer(self, proposal: Proposal) -> None:
        """Accept where we are free; the same answer again where it is asked for again."""
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
        self._transport.say(answer, RETRY_S)

    def _accept(self, proposal: Proposal) -> str:
        """Why not, empty where we do."""
        if self._member is not None and not self._member.has_ended:
            return f"is in mission {self._member.mission}"
        is_own = proposal.leader == self._transport.name
        try:
            member = self._owner.begin_part(lambda robot: Member(proposal, robot, self._where), is_own)
        except RobotError as wrong:
            return str(wrong)
        self._member, self._ended_at, self._is_listening = member, None, False
        self._listen()
        return ""

    def _look(self) -> None:
        member = self._member
        if member is None:
            return
        member.look()
        now = time.monotonic()
        state = member.state()
        news = (state.step, state.is_done, state.failed, state.ended)
        if news != self._told or now - self._told_at >= EVERY_S:
            self._transport.say(state)
            self._told, self._told_at = news, now
        if state.ended:
            self._ended_at = self._ended_at or now
            if now - self._ended_at > FAREWELL_S:
                self._member, self._is_listening = None, False

"""Messages between the robots of a mission: one event type for each, msgpack maps with a version.

While a mission runs, leader and members publish their full state periodically instead of changes: a lost, repeated or
late event does no harm."""

from __future__ import annotations

import re
from typing import Any

import msgspec
from msgspec import Struct, field

from robocorba.errors.simulation import InvalidMission
from robocorba.missions.subplan import VERSION, SubPlan
from robocorba.system.decoding import convert


class _Message(Struct, frozen=True, kw_only=True):
    """mission: the name of an attempt at it, which ends in a number of its own. sent: time of sending by the sender's
    clock [s since 1970]."""

    mission: str
    sent: float = 0.0

    @property
    def of(self) -> str:
        """The mission's name, without the number of the attempt."""
        return re.sub(r"\.\d+$", "", self.mission)


class _LeaderMessage(_Message, frozen=True, kw_only=True):
    """term: of the leader; see MissionContent. Members obey the highest that they have seen."""

    leader: str
    term: int = 1


class Call(_LeaderMessage, frozen=True, kw_only=True):
    """A leader looks for a number of helpers near a place. Every robot that is free, or will be free after its task,
    answers with an Offer, except those in `received_offers`, whose offers the leader has received."""

    floor: str
    x: float
    y: float
    helpers: int
    received_offers: list[str] = field(default_factory=list, name="heard")


class Offer(_Message, frozen=True, kw_only=True):
    """A robot offers its help and reports its position. busy: its present task; empty if it is free."""

    robot: str
    leader: str
    floor: str
    x: float
    y: float
    busy: str = ""


class Assignment(_LeaderMessage, frozen=True, kw_only=True):
    """A leader assigns a SubPlan to a robot, which has to accept it. Repeated until the robot answers."""

    phases: tuple[str, ...]
    subplan: SubPlan


class Answer(_Message, frozen=True, kw_only=True):
    """A robot accepts an assignment, or refuses it with a reason."""

    robot: str
    leader: str
    accepts: bool
    reason: str = ""


class MakeWay(_LeaderMessage, frozen=True, kw_only=True):
    """A leader asks a robot that is not in its mission to step aside, to (x, y) [m]. Repeated until it is there."""

    robot: str
    floor: str
    x: float
    y: float


class WayMade(_Message, frozen=True, kw_only=True):
    """A robot answers each MakeWay: it is on its way, it `is_done`, or it stays for a reason."""

    robot: str
    leader: str
    is_done: bool = False
    reason: str = ""


class Order(_LeaderMessage, frozen=True, kw_only=True):
    """The mission as its leader directs it. All times are by the leader's clock.

    step, at: the current step of all robots and its start time; step is -1 before the first one. trajectory_s, rate,
    since: trajectory time of the carried body [s] at time `since`, and its rate from then on (0: stopped, 1: as
    planned). without: robots whose part has ended, while the others carry on. end: empty while the mission runs, then
    "done" or "aborted"; reason: of the abort. waits_for: for display, the robots that have not finished the step, or
    what holds up the carry. received_states: for each robot, when it sent its latest state (by its own clock) and when
    the leader received it, for LeaderClock."""

    step: int = -1
    at: float = 0.0
    trajectory_s: float = field(default=0.0, name="along_s")
    rate: float = 0.0
    since: float = 0.0
    without: list[str] = field(default_factory=list)
    end: str = ""
    reason: str = ""
    waits_for: list[str] = field(default_factory=list)
    received_states: dict[str, tuple[float, float]] = field(default_factory=dict, name="heard")


class MemberState(_Message, frozen=True, kw_only=True):
    """The status of a member: its current step, whether it has finished it, its distance from its setpoint [m], when it
    began the step by the leader's clock. trajectory_s: of the carried body [s]; see Order. failure: why it cannot
    continue; empty if it can. is_aborted: a user has ended its part. has_left: its part has ended; then it reports its
    measurements."""

    robot: str
    leader: str
    step: int = -1
    is_done: bool = False
    error_m: float = 0.0
    began_at: float = 0.0
    trajectory_s: float = field(default=0.0, name="along_s")
    failure: str = field(default="", name="failed")
    is_aborted: bool = field(default=False, name="aborted")
    has_left: bool = field(default=False, name="ended")
    floor: str = ""
    x: float = 0.0
    y: float = 0.0
    measurements: MemberMeasurements | None = field(default=None, name="record")


class MemberMeasurements(Struct, frozen=True):
    """Measurements of a member. offset_s: the leader's clock minus its own. ticks: leader's time and trajectory time
    [s] of each control cycle of the last carry. max_slip_m: largest distance of the grip point from the hand while
    carrying."""

    offset_s: float
    round_trip_s: float = field(name="delay_s")
    ticks: list[tuple[float, float]]
    max_slip_m: float = field(name="farthest_m")


Message = Call | Offer | Assignment | Answer | MakeWay | WayMade | Order | MemberState
#: The message of each event type.
KINDS: dict[str, type[Message]] = {
    "mission.call": Call,
    "mission.offer": Offer,
    "mission.proposal": Assignment,
    "mission.answer": Answer,
    "mission.make_way": MakeWay,
    "mission.way_made": WayMade,
    "mission.order": Order,
    "mission.state": MemberState,
}
_TYPES = {kind: type for type, kind in KINDS.items()}


def type_of(message: Message | type[Message]) -> str:
    """The event type of a message, such as mission.order."""
    return _TYPES[message if isinstance(message, type) else type(message)]


def sender_of(message: Message) -> str:
    """The robot whose message it is, which is also the source of its event."""
    return message.robot if isinstance(message, (Offer, Answer, WayMade, MemberState)) else message.leader


def payload(message: Message) -> dict[str, Any]:
    """The message as the payload of an event."""
    members: dict[str, Any] = msgspec.to_builtins(message)
    return {"version": VERSION, **members}


def message_of(type: str, content: Any) -> Message:
    """The message in an event. Raises InvalidMission if type, version or form is wrong."""
    kind = KINDS.get(type)
    if kind is None:
        raise InvalidMission("type", f"{type[:80]!r} is not a mission message; known types: {', '.join(KINDS)}")
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise InvalidMission("version", f"must be {VERSION}")
    try:
        return convert(content, kind)
    except msgspec.ValidationError as error:
        raise InvalidMission(type, str(error)) from None

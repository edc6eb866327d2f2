"""Messages between the robots of a mission: one event type a message, msgpack maps with a version.

While a mission runs, leader and members publish their full state periodically instead of changes: a lost, repeated or
late event does no harm."""

from __future__ import annotations

from typing import Any

import msgspec
from msgspec import Struct

from robocorba.errors.simulation import InvalidMission
from robocorba.missions.subplan import VERSION, SubPlan

_TYPE = "mission."


class _Message(Struct, frozen=True, kw_only=True):
    """mission: its id. sent: time of sending by the sender's clock [s since 1970]."""

    mission: str
    sent: float = 0.0


class Call(_Message, frozen=True, kw_only=True):
    """A leader looks for a number of helpers near a place. Robots that are free or busy answer with an Offer, except
    those in `heard`, whose offers the leader has received."""

    leader: str
    floor: str
    x: float
    y: float
    helpers: int
    heard: list[str] = []


class Offer(_Message, frozen=True, kw_only=True):
    """A robot offers its help and reports its position. busy: what occupies it; empty if it is free."""

    robot: str
    leader: str
    floor: str
    x: float
    y: float
    busy: str = ""


class Proposal(_Message, frozen=True, kw_only=True):
    """A leader asks a robot to do a SubPlan. Repeated until the robot answers."""

    leader: str
    phases: tuple[str, ...]
    subplan: SubPlan


class Answer(_Message, frozen=True, kw_only=True):
    """A robot accepts a proposal, or refuses it with a reason."""

    robot: str
    leader: str
    accepts: bool
    reason: str = ""


class Order(_Message, frozen=True, kw_only=True):
    """The setpoints of the leader. All times are by the leader's clock.

    step, at: the current step of all robots and its start time; step is -1 before the first one. along_s, rate, since:
    position of the carried body on its trajectory [s] at time `since`, and its rate from then on. end: empty while the
    mission runs, then "done" or "aborted"; reason: of the abort. heard: for each robot, when it sent its latest state
    (by its own clock) and when the leader received it."""

    leader: str
    step: int = -1
    at: float = 0.0
    along_s: float = 0.0
    rate: float = 0.0
    since: float = 0.0
    end: str = ""
    reason: str = ""
    heard: dict[str, tuple[float, float]] = {}


class State(_Message, frozen=True, kw_only=True):
    """The status of a member: its current step, whether it has finished it, its distance from its setpoint [m], when it
    began the step by the leader's clock. failed: why it cannot continue; empty if it can. ended: it has left the
    mission."""

    robot: str
    leader: str
    step: int = -1
    is_done: bool = False
    error_m: float = 0.0
    began_at: float = 0.0
    failed: str = ""
    ended: bool = False
    floor: str = ""
    x: float = 0.0
    y: float = 0.0
    record: Record | None = None


class Record(Struct, frozen=True):
    """Measurements of a member, sent when it ends. offset_s: of the leader's clock. delay_s: shortest round trip.
    ticks: leader's time and trajectory time [s] of each control cycle of the last carry. farthest_m: largest distance
    of the grip point from the hand while carrying."""

    offset_s: float
    delay_s: float
    ticks: list[tuple[float, float]]
    farthest_m: float


Message = Call | Offer | Proposal | Answer | Order | State
KINDS: dict[str, type[Message]] = {
    _TYPE + kind.__name__.lower(): kind for kind in (Call, Offer, Proposal, Answer, Order, State)
}
_NAMES = {kind: name for name, kind in KINDS.items()}


def type_of(message: Message | type[Message]) -> str:
    """The event type of a message, such as mission.order."""
    return _NAMES[message if isinstance(message, type) else type(message)]


def payload(message: Message) -> dict[str, Any]:
    """The message as the payload of an event."""
    found: dict[str, Any] = msgspec.to_builtins(message)
    return {"version": VERSION, **found}


def message_of(type: str, content: Any) -> Message:
    """The message in an event. Raises InvalidMission if type, version or form is wrong."""
    kind = KINDS.get(type)
    if kind is None:
        raise InvalidMission("type", f"{type[:80]!r} is not a mission message; known types: {', '.join(KINDS)}")
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise InvalidMission("version", f"must be {VERSION}")
    rest = {key: value for key, value in content.items() if key != "version"}
    try:
        return msgspec.convert(rest, kind)
    except msgspec.ValidationError as error:
        raise InvalidMission(type, str(error)) from None

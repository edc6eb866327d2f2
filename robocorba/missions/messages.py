"""What the robots of a mission tell each other: one event type a message, msgpack maps with a version.

While a mission runs, leader and members say over and over how things are, rather than once what has changed: an event
that is lost, comes twice or late does no harm."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from robocorba.errors.simulation import InvalidMission
from robocorba.missions.subplan import VERSION, SubPlan

_TYPE = "mission."


class _Message(Struct, frozen=True, kw_only=True):
    """mission: its id. sent: by the clock of who says it, s since 1970."""

    mission: str
    sent: float = 0.0


class Call(_Message, frozen=True, kw_only=True):
    """A leader looks for helpers near a place, and how many. Robots answer that are free, or will be some time; not
    those that it has heard."""

    leader: str
    floor: str
    x: float
    y: float
    helpers: int
    heard: list[str] = []


class Offer(_Message, frozen=True, kw_only=True):
    """A robot is free, and stands there. busy: what it does meanwhile where it is not free."""

    robot: str
    leader: str
    floor: str
    x: float
    y: float
    busy: str = ""


class Proposal(_Message, frozen=True, kw_only=True):
    """A leader asks a robot to do a SubPlan; it is said again until the robot answers."""

    leader: str
    phases: tuple[str, ...]
    subplan: SubPlan


class Answer(_Message, frozen=True, kw_only=True):
    """Whether a robot accepts; if not, why."""

    robot: str
    leader: str
    accepts: bool
    reason: str = ""


class Order(_Message, frozen=True, kw_only=True):
    """How the leader wants things: all in its time.

    step, at: the step that everybody does from a time on; -1: none yet. along_s, rate, since: how far the body that is
    carried is along its trajectory, and how fast it goes on, from a time on. end: "" while it goes on, "done" or
    "aborted", with the reason. heard: of each robot, when it sent the last state that came, and when that came."""

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
    """How a member gets on: the step that it is at, whether it is done with it, how far it is from where it shall be,
    m, when it began it by the leader's clock, and why it can't go on. ended: it takes no part any more."""

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
    """What a member measured, told at its end. offset_s: of the leader's clock. ticks: leader's time and seconds along
    the trajectory, of each control tick of the last carry. farthest_m: of the grip from the hand while carrying."""

    offset_s: float
    delay_s: float
    ticks: list[tuple[float, float]]
    farthest_m: float


Message = Call | Offer | Proposal | Answer | Order | State
KINDS: dict[str, type[Message]] = {
    _TYPE + kind.__name__.lower(): kind for kind in (Call, Offer, Proposal, Answer, Order, State)
}
_NAMES = {kind: name for name, kind in KINDS.items()}
Any_ = TypeVar("Any_", bound=Struct)


def type_of(message: Message | type[Message]) -> str:
    """The type of its event, such as mission.order."""
    return _NAMES[message if isinstance(message, type) else type(message)]


def payload(message: Message) -> dict[str, Any]:
    """For an event."""
    found: dict[str, Any] = msgspec.to_builtins(message)
    return {"version": VERSION, **found}


def message_of(type: str, content: Any) -> Message:
    """The message in an event. Raises InvalidMission for what is none."""
    kind = KINDS.get(type)
    if kind is None:
        raise InvalidMission("type", f"{type[:80]!r} is no message of a mission")
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise InvalidMission("version", f"not {VERSION}")
    rest = {key: value for key, value in content.items() if key != "version"}
    try:
        return msgspec.convert(rest, kind)
    except msgspec.ValidationError as wrong:
        raise InvalidMission(type, str(wrong)) from None

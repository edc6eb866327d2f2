"""The record of a mission, as its leader keeps it in the Omni database: JSON, described in docs/mission.md."""

from __future__ import annotations

import time
import uuid
from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta, Struct

from robocorba.simulation.store import MAX_DOCUMENT
from robocorba.system.decoding import decode_json

#: Maximum length of a text [characters]; a longer reason is cut off.
MAX_TEXT = 2000
#: Texts of a record; CORBA strings have no NUL.
Text = Annotated[str, Meta(max_length=MAX_TEXT, pattern="^[^\x00]*$")]
Seconds = Annotated[float, Meta(ge=0.0, le=1e12)]
Count = Annotated[int, Meta(ge=0, le=2**31 - 1)]
#: Maximum number of phases, leaders and faults; the first ones are left out.
MAX_PHASES, MAX_LEADERS, MAX_FAULTS = 1000, 20, 20
#: Members of a record that the IDL's MissionState does not have: a state by mission control has their defaults.
RECORD_ONLY = ("format", "is_offered", "leaders", "icon", "attempts", "faults", "plan", "report")


class MissionResult(Enum):
    """How a mission ended, or that it runs."""

    RUNNING = "running"
    DONE = "done"
    ABORTED = "aborted"
    FAILED = "failed"


class PhaseRecord(Struct, frozen=True):
    """A phase that has begun. begun, ended: POSIX times by the leader's clock [s]; ended is 0 while it runs.
    waited_for: the robot that finished last, or has not finished yet."""

    name: Text
    begun: Seconds
    ended: Seconds = 0.0
    waited_for: Text = ""


class MemberRecord(Struct, frozen=True):
    """A robot of a mission and its role, such as leader or helper."""

    robot: Text
    role: Text


class LeaderRecord(Struct, frozen=True):
    """A robot that leads a mission since POSIX time `since` [s], from term `term` on. reason: why it took over."""

    robot: Text
    term: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    since: Seconds
    reason: Text = ""


class MissionContent(Struct, frozen=True, kw_only=True):
    """The state of a mission. Unknown fields are ignored, so that later releases may add some.

    kind: tag of the cooperative icon. about: the object that it moves. is_offered: mission control has offered it to
    `leader`, which has not accepted it yet. term: increments with each change of the leader, and with each robot to
    which it is offered; who leads in a lower one is not obeyed. leaders: those since the first change, the present
    one last. icon: the cooperative icon, for a robot that takes over. attempts: number of the last attempt. faults:
    what ended the attempts before. plan: of the present attempt, a CooperativePlan. phases_in_all: 0 before there is a
    plan. begun, ended: as of a phase. report: at the end, see docs/mission.md."""

    format: Literal[1] = 1
    kind: Text
    about: Text
    leader: Text
    is_offered: bool = False
    term: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    leaders: Annotated[tuple[LeaderRecord, ...], Meta(max_length=MAX_LEADERS)] = ()
    icon: dict[str, Any] | None = None
    attempts: Count = 0
    faults: Annotated[tuple[Text, ...], Meta(max_length=MAX_FAULTS)] = ()
    plan: dict[str, Any] | None = None
    members: Annotated[tuple[MemberRecord, ...], Meta(max_length=100)] = ()
    phases: Annotated[tuple[PhaseRecord, ...], Meta(max_length=MAX_PHASES)] = ()
    phases_in_all: Count = 0
    begun: Seconds
    ended: Seconds = 0.0
    result: MissionResult = MissionResult.RUNNING
    reason: Text = ""
    report: dict[str, Any] | None = None

    @property
    def is_running(self) -> bool:
        return self.result is MissionResult.RUNNING

    def encode(self) -> bytes:
        """The document for the Omni database; without plan and report if it would be too long."""
        document = msgspec.json.encode(self)
        return document if len(document) <= MAX_DOCUMENT else msgspec.json.encode(self.summary)

    @property
    def summary(self) -> MissionContent:
        """The same without what can be long: plan and report."""
        return msgspec.structs.replace(self, plan=None, report=None)

    def state_json(self) -> dict[str, Any]:
        """The members that a state by mission control has, for JSON."""
        members: dict[str, Any] = msgspec.to_builtins(self)
        return {name: value for name, value in members.items() if name not in RECORD_ONLY}

    @classmethod
    def decode(cls, document: bytes) -> MissionContent:
        """The inverse of `encode`. Raises msgspec.ValidationError, msgspec.DecodeError for any other document."""
        return decode_json(document, cls)

    @property
    def all_leaders(self) -> tuple[LeaderRecord, ...]:
        """Those that have led the mission, the present one last."""
        return self.leaders or (LeaderRecord(self.leader, self.term, self.begun),)

    @property
    def latest(self) -> float:
        """The latest of its times [s]."""
        phases = (max(phase.begun, phase.ended) for phase in self.phases)
        return max(self.begun, self.ended, *phases, *(leader.since for leader in self.leaders))

    def successors(self) -> list[str]:
        """The members that may take the mission over when its leader is gone, in turn."""
        return [member.robot for member in self.members if member.robot != self.leader]

    def taken_over(self, robot: str, reason: str, at: float) -> MissionContent:
        """The mission with a new leader since POSIX time `at` [s], in the next term."""
        term = self.term + 1
        leaders = (*self.all_leaders, LeaderRecord(robot, term, at, reason[:MAX_TEXT]))[-MAX_LEADERS:]
        return msgspec.structs.replace(self, leader=robot, term=term, leaders=leaders)

    def offered_to(self, robot: str) -> MissionContent:
        """A mission that nobody has led, offered to another robot, in the next term."""
        return msgspec.structs.replace(self, leader=robot, term=self.term + 1)

    def ended_as(self, result: MissionResult, reason: str, at: float) -> MissionContent:
        """The mission with its end at POSIX time `at` [s]; a phase that runs ends with it."""
        phases = tuple(
            phase if phase.ended else msgspec.structs.replace(phase, ended=max(at, phase.begun))
            for phase in self.phases
        )
        reason = reason[:MAX_TEXT]
        return msgspec.structs.replace(self, phases=phases, plan=None, ended=at, result=result, reason=reason)

    def brief_report(self, name: str) -> dict[str, Any]:
        """A report from what the record has, for a mission whose leader left none."""
        ended = self.ended or time.time()
        return {
            "mission": name,
            "kind": self.kind.replace("_", " "),
            "leader": self.leader,
            "result": self.result.value,
            "reason": self.reason,
            "robots": {member.robot: member.role for member in self.members},
            "thing": self.about,
            "began": self.begun,
            "seconds": max(0.0, ended - self.begun),
            "phases": [
                {
                    "name": phase.name,
                    "began_s": phase.begun - self.begun,
                    "started_s": {},
                    "done_s": {phase.waited_for: phase.ended - self.begun} if phase.ended and phase.waited_for else {},
                    "waited_for": phase.waited_for,
                    "skew_ms": None,
                }
                for phase in self.phases
            ],
            "tick_skew_ms": None,
            "farthest_grip_m": None,
            "clocks": {},
            "latency_ms": {},
            "events": [],
            "events_in_all": 0,
        }


class MissionState(NamedTuple):
    """A mission of the building. version: increments with each change, over all missions."""

    name: str
    version: int
    content: MissionContent


def decoded(document: bytes) -> MissionContent | None:
    """The content of a record; None if it is none of a mission."""
    try:
        return MissionContent.decode(document)
    except (msgspec.MsgspecError, UnicodeError):
        return None


def new_mission_name(leader: str) -> str:
    """A unique name of a mission, not too long for the Omni database."""
    return f"{leader[:150]}-{time.strftime('%Y%m%d-%H%M%S')}-{uuid.uuid4().hex[:6]}"

"""Cooperative plans: the synchronized steps of all robots of a mission.

A plan is divided into SubPlans, one for each robot. All robots begin their n-th step simultaneously, after every robot
has finished the step before: these steps are a phase of the mission."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta, Struct

from robocorba.system.decoding import decode_msgpack

#: Version of the format of plans and messages; other versions are refused.
VERSION = 1
#: A row of Trajectory.to_rows.
Row = tuple[float, ...]


def _tag(name: str) -> str:
    return re.sub(r"(?<=.)([A-Z])", r"_\1", name).lower()


class _Step(Struct, frozen=True, kw_only=True, tag_field="step", tag=_tag):
    """limit_s: time limit of the step."""

    limit_s: float = 60.0


class Reserve(_Step, frozen=True, kw_only=True):
    """Reserve areas (floor, polygon [m]), one for each floor of the path, and wait until they are granted.

    hold_s: duration of the reservation."""

    areas: tuple[tuple[str, tuple[tuple[float, float], ...]], ...]
    hold_s: float


class Gather(_Step, frozen=True, kw_only=True):
    """Drive to the meeting point [m, rad], by elevator if it is on another floor."""

    floor: str
    x: float
    y: float
    heading: float


class Approach(_Step, frozen=True, kw_only=True):
    """Drive straight to a pose nearby."""

    x: float
    y: float
    heading: float


class TakeHold(_Step, frozen=True, kw_only=True):
    """Bring the hands to the edge of an object, `height_m` above the floor, and grip it at (x, y).

    at: expected pose of the object [m, rad]; the step fails if the object has moved."""

    thing: str
    at: tuple[float, float, float]
    x: float
    y: float
    height_m: float


class Carry(_Step, frozen=True, kw_only=True):
    """Move with the carried body along its trajectory. rows: see Trajectory.to_rows. place: pose of the robot's base in
    the frame of the body [m, rad]."""

    rows: list[Row]
    place: tuple[float, float, float]


class Ride(_Step, frozen=True, kw_only=True):
    """Ride to another floor. The robot with the area reservation releases the area of the floor that it leaves."""

    elevator: str
    destination: str


class CallCabin(_Step, frozen=True, kw_only=True):
    """Call an elevator for a party of `size` robots and wait until its doors are open.

    boarding_s: time that the party needs to drive in, and to drive out [s]; 0 if that is unknown."""

    elevator: str
    destination: str
    party: str
    size: int
    boarding_s: float = 0.0


class PutDown(_Step, frozen=True, kw_only=True):
    """Release the object and open the grippers."""


class BackOff(_Step, frozen=True, kw_only=True):
    """Drive back from the object and tuck the arms."""

    distance_m: float


class Reach(_Step, frozen=True, kw_only=True):
    """Bring one hand to a pose in the robot's frame: x, y, z [m], roll, pitch, yaw [rad]."""

    hand: str
    pose: tuple[float, float, float, float, float, float]


class Grip(_Step, frozen=True, kw_only=True):
    """Open or close a gripper."""

    hand: str
    closes: bool


Step = Reserve | Gather | Approach | TakeHold | Carry | Ride | CallCabin | PutDown | BackOff | Reach | Grip


class Idle(_Step, frozen=True, kw_only=True, tag="wait"):
    """Do nothing while other robots do their step."""


Steps = Annotated[tuple[Step | Idle, ...], Meta(min_length=1, max_length=100)]


class SubPlan(Struct, frozen=True):
    """The steps of one robot. role: such as leader or helper, for display."""

    robot: str
    role: str
    steps: Steps


class CooperativePlan(Struct, frozen=True):
    """All SubPlans of a mission. phases: names of the steps, for display. thing: name of the object. enough: the
    smallest groups of its robots that can hold the object without the others."""

    mission: str
    kind: str
    leader: str
    thing: str
    phases: tuple[str, ...]
    subplans: tuple[SubPlan, ...]
    version: int = VERSION
    enough: tuple[tuple[str, ...], ...] = ()


class PhaseSteps(NamedTuple):
    """A phase: the simultaneous steps of all robots, in the order of the robots. name: for display."""

    name: str
    steps: Sequence[Step | Idle]


def plan_of(
    mission: str,
    kind: str,
    leader: str,
    thing: str,
    roles: Sequence[tuple[str, str]],
    phases: Sequence[PhaseSteps],
    enough: tuple[tuple[str, ...], ...] = (),
) -> CooperativePlan:
    """A plan from its phases. roles: robots with their roles, in the order of the phases' steps."""
    subplans = tuple(
        SubPlan(robot, role, tuple(phase.steps[number] for phase in phases))
        for number, (robot, role) in enumerate(roles)
    )
    return CooperativePlan(mission, kind, leader, thing, tuple(phase.name for phase in phases), subplans, enough=enough)


def holding_steps(plan: CooperativePlan) -> range:
    """The numbers of the steps before and during which the robots hold an object together; the last one puts it
    down."""
    kinds = [{type(subplan.steps[number]) for subplan in plan.subplans} for number in range(len(plan.phases))]
    first = max((number for number, found in enumerate(kinds) if TakeHold in found), default=len(kinds))
    last = max((number for number, found in enumerate(kinds) if PutDown in found), default=-1)
    return range(first + 1, last + 1)


class StoredPlan(Struct, frozen=True):
    """A mission in its leader's data pool. phase: the current one."""

    plan: CooperativePlan
    phase: str

    def encode(self) -> bytes:
        """The content for the data pool."""
        return msgspec.msgpack.encode(self)

    @staticmethod
    def decode(content: bytes) -> StoredPlan:
        """The inverse of `encode`. Raises msgspec.ValidationError for invalid content."""
        return decode_msgpack(content, StoredPlan)

"""Cooperative plans: the synchronized steps of all robots of a mission.

A plan is divided into SubPlans, one a robot. All robots begin their n-th step simultaneously, after every robot has
finished the step before."""

from __future__ import annotations

import re
from typing import Annotated

from msgspec import Meta, Struct

#: Version of the format of plans and messages; other versions are refused.
VERSION = 1
MAX_STEPS = 100
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
    """Call an elevator for a party of `size` robots and wait until its doors are open."""

    elevator: str
    destination: str
    party: str
    size: int


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


class Wait(_Step, frozen=True, kw_only=True):
    """Do nothing while other robots do their step."""


Steps = Annotated[tuple[Step | Wait, ...], Meta(min_length=1, max_length=MAX_STEPS)]


class SubPlan(Struct, frozen=True):
    """The steps of one robot. role: such as leader or helper, for display."""

    robot: str
    role: str
    steps: Steps


class CooperativePlan(Struct, frozen=True):
    """All SubPlans of a mission. phases: names of the steps, for display. thing: name of the object."""

    mission: str
    kind: str
    leader: str
    thing: str
    phases: tuple[str, ...]
    subplans: tuple[SubPlan, ...]
    version: int = VERSION

    def of(self, robot: str) -> SubPlan:
        """Raises KeyError."""
        for subplan in self.subplans:
            if subplan.robot == robot:
                return subplan
        raise KeyError(robot)

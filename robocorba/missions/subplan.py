"""Cooperative plans: what each robot of a mission does, step by step, in step with the others.

A plan is divided into SubPlans, one a robot. The n-th step of all of them begins at the same time, when every robot has
done the one before."""

from __future__ import annotations

import re
from typing import Annotated

from msgspec import Meta, Struct

#: Of the form of plans and messages; others are refused.
VERSION = 1
MOST_STEPS = 100
Row = tuple[float, ...]


def _tag(name: str) -> str:
    return re.sub(r"(?<=.)([A-Z])", r"_\1", name).lower()


class _Step(Struct, frozen=True, kw_only=True, tag_field="step", tag=_tag):
    """`limit_s`: how long the robot may take for it."""

    limit_s: float = 60.0


class Reserve(_Step, frozen=True, kw_only=True):
    """Wait until areas are ours, polygons of floors, m, one for each floor of the way; for so long at most, s."""

    areas: tuple[tuple[str, tuple[tuple[float, float], ...]], ...]
    hold_s: float


class Gather(_Step, frozen=True, kw_only=True):
    """Drive to the meeting point, across floors where it must: m and rad."""

    floor: str
    x: float
    y: float
    heading: float


class Approach(_Step, frozen=True, kw_only=True):
    """Go straight to a place that is near."""

    x: float
    y: float
    heading: float


class TakeHold(_Step, frozen=True, kw_only=True):
    """Bring the hands to an object's edge `height_m` over the floor, and grip it at a place of the floor. at: where the
    object has to stand, m and rad."""

    thing: str
    at: tuple[float, float, float]
    x: float
    y: float
    height_m: float


class Carry(_Step, frozen=True, kw_only=True):
    """Hold on to a body that goes along a trajectory (rows as Trajectory.to_rows makes them), at `place` of it: where
    the base is in the frame of the body, m and rad."""

    rows: list[Row]
    place: tuple[float, float, float]


class Ride(_Step, frozen=True, kw_only=True):
    """Stand in a cabin together, and let it take you to another floor: whoever reserved gives back the one behind."""

    elevator: str
    destination: str


class CallCabin(_Step, frozen=True, kw_only=True):
    """Reserve the ride for a party of so many robots, and wait until the doors are open."""

    elevator: str
    destination: str
    party: str
    size: int


class PutDown(_Step, frozen=True, kw_only=True):
    """Let go."""


class BackOff(_Step, frozen=True, kw_only=True):
    """Drive away from the object, m, and take the arms in."""

    distance_m: float


class Reach(_Step, frozen=True, kw_only=True):
    """Bring one hand to a pose in the robot's frame (x, y, z, roll, pitch, yaw: m and rad)."""

    hand: str
    pose: tuple[float, float, float, float, float, float]


class Grip(_Step, frozen=True, kw_only=True):
    """Open or close a gripper."""

    hand: str
    closes: bool


Step = Reserve | Gather | Approach | TakeHold | Carry | Ride | CallCabin | PutDown | BackOff | Reach | Grip


class Wait(_Step, frozen=True, kw_only=True):
    """Let others do theirs."""


Steps = Annotated[tuple[Step | Wait, ...], Meta(min_length=1, max_length=MOST_STEPS)]


class SubPlan(Struct, frozen=True):
    """What one robot does. role: such as leader or helper, for people."""

    robot: str
    role: str
    steps: Steps


class CooperativePlan(Struct, frozen=True):
    """Of a mission; phases: what each step is for, for people."""

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

"""The mission "move table", and what its robots tell each other: A leads, B helps in its room, C comes from another.

In each step the leader sends B and C their SubPlans, both say when they are ready, the leader says go, and both tell
their results. Meanwhile each robot tells its state, and A and B look at the table together: their scans are of use to
each other only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from robocorba.events.subscription import Pattern

LEADER, HELPERS = "A", ("B", "C")
ROBOTS = (LEADER, *HELPERS)
#: States and scans of each robot, and steps of the mission, a second (where an answer does not take longer).
STATE_HZ, STEP_HZ = 20.0, 10.0

STATE, SCAN, SUBPLAN, READY, GO, RESULT, DONE = (
    "robot.state",
    "robot.scan",
    "mission.subplan",
    "mission.ready",
    "mission.go",
    "mission.result",
    "mission.done",
)

#: What each robot subscribes to: the leader watches all, the helpers watch the leader.
INTERESTS: Mapping[str, tuple[Pattern, ...]] = {
    "A": (
        *(Pattern(type, helper) for type in (STATE, READY, RESULT) for helper in HELPERS),
        Pattern(SCAN, "B"),
    ),
    "B": (*(Pattern(type, "A") for type in (STATE, f"{SUBPLAN}.B", GO, DONE, SCAN)),),
    "C": (*(Pattern(type, "A") for type in (STATE, f"{SUBPLAN}.C", GO, DONE)),),
}


class Sent(NamedTuple):
    """How many events of a type a robot sent."""

    type: str
    source: str
    number: int


def expected(robot: str, sent: list[Sent]) -> int:
    """How many of these a robot has to get."""
    return sum(one.number for one in sent if any(pattern.matches(one.type, one.source) for pattern in INTERESTS[robot]))


def is_mission(type: str) -> bool:
    """Whether an event is one that all sub-networks need; scans are not, and stay out of the latencies."""
    return type != SCAN


def state(robot: str, number: int) -> dict[str, Any]:
    """Where a robot and the joints of its arms are, after so many states."""
    phase = number / STATE_HZ + ROBOTS.index(robot)
    return {
        "pose": [2.0 + math.cos(phase), 3.0 + math.sin(phase), math.remainder(phase, math.tau)],
        "velocity": [0.5, 0.0, 1.0],
        "joints": [0.3 * math.sin(phase + joint) for joint in range(14)],
        "battery": 0.8,
    }


def scan(robot: str, number: int) -> dict[str, Any]:
    """360 ranges, mm, as 16-bit numbers in network order."""
    phase = number / STATE_HZ + ROBOTS.index(robot)
    ranges = (int(2500 + 1000 * math.sin(phase + math.radians(degree))) for degree in range(360))
    return {"ranges_mm": b"".join(mm.to_bytes(2, "big") for mm in ranges)}


def subplan(robot: str, step: int) -> dict[str, Any]:
    """What a helper has to do in a step: the way of its corner of the table."""
    corner = math.tau * ROBOTS.index(robot) / len(ROBOTS)
    way = [[step + point / 8 + 0.6 * math.cos(corner), 2.0 + 0.6 * math.sin(corner), 0.1 * point] for point in range(8)]
    return {"step": step, "task": "move table", "robot": robot, "way": way, "grip": "both hands", "speed": 0.4}

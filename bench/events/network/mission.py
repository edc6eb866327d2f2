"""The mission "move table" and its events: A leads, B helps in the same room, C comes from another room.

In each step the leader sends B and C their SubPlans, both report when they are ready, the leader sends the start
signal, and both report their results. Meanwhile each robot publishes its state and scans, which A and B exchange, or
A with both helpers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from robocorba.events.subscription import Pattern

LEADER, HELPERS = "A", ("B", "C")
ROBOTS = (LEADER, *HELPERS)
#: Rate of the states and scans of each robot, and of the steps of the mission (less if answers take longer) [Hz].
STATE_HZ, STEP_HZ = 20.0, 10.0

STATE, SCAN, SHARED_SCAN, OWN, SUBPLAN, READY, GO, RESULT, DONE = (
    "robot.state",
    "scan.room",
    "scan.shared",
    "robot.own",
    "mission.subplan",
    "mission.ready",
    "mission.go",
    "mission.result",
    "mission.done",
)
#: Which robots exchange scans, and the type of their events.
SCANS = {"nobody": "", "A, B": SCAN, "A, B, C": SHARED_SCAN}

#: Subscriptions of each robot: the leader receives from all robots, the helpers from the leader.
INTERESTS: Mapping[str, tuple[Pattern, ...]] = {
    "A": (
        *(Pattern(type, helper) for type in (STATE, READY, RESULT, SHARED_SCAN) for helper in HELPERS),
        Pattern(SCAN, "B"),
    ),
    "B": (*(Pattern(type, "A") for type in (STATE, f"{SUBPLAN}.B", GO, DONE, SCAN, SHARED_SCAN)),),
    "C": (*(Pattern(type, "A") for type in (STATE, f"{SUBPLAN}.C", GO, DONE, SHARED_SCAN)),),
}


class Sent(NamedTuple):
    """Number of events of a type that a robot sent."""

    type: str
    source: str
    number: int


def expected(robot: str, sent: list[Sent]) -> int:
    """How many of the sent events a robot must receive."""
    return sum(one.number for one in sent if any(pattern.matches(one.type, one.source) for pattern in INTERESTS[robot]))


def is_mission(type: str) -> bool:
    """Whether the event counts in the latencies; scans do not."""
    return type not in (SCAN, SHARED_SCAN)


def state(robot: str, number: int) -> dict[str, Any]:
    """State `number` of a robot: pose, velocity, joints of the arms."""
    phase = number / STATE_HZ + ROBOTS.index(robot)
    return {
        "pose": [2.0 + math.cos(phase), 3.0 + math.sin(phase), math.remainder(phase, math.tau)],
        "velocity": [0.5, 0.0, 1.0],
        "joints": [0.3 * math.sin(phase + joint) for joint in range(14)],
        "battery": 0.8,
    }


def scan(robot: str, number: int) -> dict[str, Any]:
    """360 ranges [mm] as 16-bit numbers in network byte order."""
    phase = number / STATE_HZ + ROBOTS.index(robot)
    ranges = (int(2500 + 1000 * math.sin(phase + math.radians(degree))) for degree in range(360))
    return {"ranges_mm": b"".join(mm.to_bytes(2, "big") for mm in ranges)}


def subplan(robot: str, step: int) -> dict[str, Any]:
    """The task of a helper in a step: the path of its corner of the table."""
    corner = math.tau * ROBOTS.index(robot) / len(ROBOTS)
    way = [[step + point / 8 + 0.6 * math.cos(corner), 2.0 + 0.6 * math.sin(corner), 0.1 * point] for point in range(8)]
    return {"step": step, "task": "move table", "robot": robot, "way": way, "grip": "both hands", "speed": 0.4}

"""Examples of what clients send: names, programs, missions and messages, and arguments of plausible calls."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from omniORB import CORBA

from robocorba.missions.subplan import VERSION

#: Robots of the system, and of these calls.
ROBOT, OTHER, OURS = "A", "B", "F"

ICONS: list[dict[str, Any]] = [
    {"icon": "mbase_path", "floor": "L1", "x": 3.0, "y": 3.0, "heading": 1.0, "speed": 0.5},
    {"icon": "mbase_to", "x": 3.0, "y": 2.0, "heading": 0.0, "speed": 0.3},
    {"icon": "mbase_by", "ahead": 0.2, "left": 0.1, "turn": 0.5, "speed": 0.3},
    {"icon": "mbase_velocity", "ahead": 0.1, "left": 0.0, "turn": 0.1, "seconds": 0.2},
    {"icon": "mhand_joints", "hand": "left", "joints": [0, 0, 0, 0.1, 0, 0, 0], "seconds": 0.5},
    {"icon": "mhand_pose", "hand": "right", "x": 0.4, "y": -0.2, "z": 0.8, "roll": 0, "pitch": 0, "yaw": 0},
    {"icon": "mhand_offset", "hand": "both", "dx": 0.01, "dy": 0.0, "dz": 0.01, "seconds": 0.1},
    {"icon": "mhand_posture", "hand": "both", "posture": "tuck"},
    {"icon": "lumbar", "lower": 0.0, "upper": 0.1, "seconds": 1},
    {"icon": "gripper", "hand": "left", "action": "close", "opening": 0.3, "force": 5, "object": "box"},
    {"icon": "wait_until", "condition": {"when": "closer_than", "sensor": "laser", "distance": 1.0}, "seconds": 0.1},
    {"icon": "wait_until", "condition": {"when": "event", "type": "a.*", "source": "*"}, "seconds": 0.1},
    {"icon": "stop_if_closer", "sensor": "front", "distance": 0.1, "icons": [{"icon": "wait", "seconds": 0.1}]},
    {"icon": "wait", "seconds": 0.1},
    {"icon": "confirm", "question": "hand is free?", "seconds": 0.1, "on_no": "go_on"},
    {"icon": "repeat", "times": 2, "icons": [{"icon": "wait", "seconds": 0.01}]},
    {
        "icon": "branch",
        "condition": {"when": "holding", "hand": "left"},
        "then": [{"icon": "wait", "seconds": 0.1}],
        "otherwise": [{"icon": "wait", "seconds": 0.1}],
    },
    {"icon": "branch", "condition": {"when": "result", "result": "done"}, "then": []},
    {"icon": "say", "type": "robot.said", "payload": {"n": [1, 2.5, None, "text"]}},
]
MISSIONS: list[dict[str, Any]] = [
    {"icon": "move_table", "table": "table", "to": {"floor": "L1", "x": 6.0, "y": 6.0, "heading": 0.0}},
    {"icon": "hand_over", "object": "box", "taker": OTHER, "giver": ROBOT},
]
#: Members of the messages of missions.
MESSAGE = {
    "version": VERSION,
    "mission": "m.1",
    "sent": 1.0,
    "leader": OTHER,
    "robot": ROBOT,
    "floor": "L1",
    "x": 3.0,
    "y": 3.0,
    "helpers": 1,
    "heard": [],
    "busy": "",
    "phases": ["gather", "do"],
    "subplan": {"mission": "m.1", "robot": ROBOT, "role": "helper", "steps": []},
    "accepts": True,
    "reason": "",
    "step": 0,
    "at": 1.0,
    "along_s": 0.0,
    "rate": 1.0,
    "since": 1.0,
    "end": "",
}
TEXTS: tuple[str, ...] = (
    "L1",
    "L2",
    "E1",
    ROBOT,
    OTHER,
    OURS,
    "a",
    "b",
    "simulated",
    "room",
    "desk",
    "table",
    "box",
    "main",
    "s1",
    "w",
    "top",
    "bottom",
    "mission.order",
    "robot.state",
    "*",
    "Mobility",
    "MnpL",
    "GripperR",
    "simulation",
    "map_editor",
)
#: A picture of one pixel.
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
    "1f15c4890000000d49444154789c63f8cfc0f01f00050001ff56c7a3d80000000049454e44ae426082"
)


def example(*arguments: Any) -> Callable[[], tuple[Any, ...]]:
    """The same arguments for each call."""
    return lambda: arguments


def always(reference: Any) -> Callable[[], Any]:
    """A maker of the only reference."""
    return lambda: reference


def fresh(make: Callable[[], Any], end: str) -> Callable[[], Any]:
    """A maker of references that ends the one before by its operation `end`."""
    before: list[Any] = []

    def ending_the_one_before() -> Any:
        for one in before:
            with contextlib.suppress(CORBA.Exception):
                getattr(one, end)()
        before[:] = [make()]
        return before[0]

    return ending_the_one_before


def title(interface: Any) -> str:
    """The name of an interface that the IDL compiler has made."""
    return str(interface._NP_RepositoryId.split(":")[1]).removeprefix("RoboCorba/").removeprefix("omg.org/")


def with_members(struct: Any, **members: Any) -> Any:
    """A copy of a struct with other members."""
    return type(struct)(*(members.get(name, value) for name, value in vars(struct).items()))

"""The JSON documents that are published for Foxglove: states of robots and missions, with their schemas."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from robocorba.robot.display import Display
from robocorba.simulation.mission_record import MissionContent

_TEXT, _NUMBER, _COUNT = {"type": "string"}, {"type": "number"}, {"type": "integer"}


def _schema(title: str, key: str, members: dict[str, Any]) -> dict[str, Any]:
    """The schema of an object with a list of objects."""
    item = {"type": "object", "properties": members}
    return {"title": title, "type": "object", "properties": {key: {"type": "array", "items": item}}}


#: Positions are in m, headings and joints in rad, speeds in m/s and rad/s.
ROBOTS_SCHEMA = _schema(
    "robocorba.Robots",
    "robots",
    {
        "name": _TEXT,
        "floor": _TEXT,
        "x": _NUMBER,
        "y": _NUMBER,
        "heading": _NUMBER,
        "speed": _NUMBER,
        "turn": _NUMBER,
        "elevator": {"type": "string", "description": "in which it rides"},
        "display": {"type": "string", "description": "working, waiting or exceptional; empty if it is not known"},
        "shows": {"type": "string", "description": "the text on its touch panel"},
    },
)
#: Times are POSIX times [s] by the leader's clock; `ended` is 0 while a mission runs.
MISSIONS_SCHEMA = _schema(
    "robocorba.Missions",
    "missions",
    {
        "name": _TEXT,
        "kind": _TEXT,
        "about": {"type": "string", "description": "the object that is moved"},
        "result": {"type": "string", "description": "running, done, failed or aborted"},
        "reason": _TEXT,
        "phase": _TEXT,
        "leader": _TEXT,
        "term": _COUNT,
        "robots": {"type": "array", "items": _TEXT},
        "begun": _NUMBER,
        "ended": _NUMBER,
    },
)


def robot_as_json(name: str, floor: str, motion: np.void, elevator: str, shown: Display | None) -> dict[str, Any]:
    """A robot as ROBOTS_SCHEMA describes it. motion: its row of MOTION. elevator: in which it rides, or empty. shown:
    on its touch panel, None if that is not known."""
    return {
        "name": name,
        "floor": floor,
        "x": float(motion["x"]),
        "y": float(motion["y"]),
        "heading": float(motion["heading"]),
        "speed": math.hypot(motion["vx"], motion["vy"]),
        "turn": float(motion["turn"]),
        "elevator": elevator,
        "display": shown.kind.name.lower() if shown else "",
        "shows": shown.text if shown else "",
    }


def mission_as_json(name: str, content: MissionContent) -> dict[str, Any]:
    """A mission as MISSIONS_SCHEMA describes it."""
    return {
        "name": name,
        "kind": content.kind,
        "about": content.about,
        "result": content.result.value,
        "reason": content.reason,
        "phase": content.phases[-1].name if content.phases else "",
        "leader": content.leader,
        "term": content.term,
        "robots": [member.robot for member in content.members],
        "begun": content.begun,
        "ended": content.ended,
    }

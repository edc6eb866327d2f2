"""What is known of a mission: its plan for others to read, and a report with figures for people."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from robocorba.missions.leader import MissionReport, Phase
from robocorba.missions.messages import Record, type_of
from robocorba.missions.subplan import CooperativePlan
from robocorba.missions.transport import Came
from robocorba.spatial.grids import Floats

REPORT_FILE = "report.json"


class KeptPlan(msgspec.Struct, frozen=True):
    """What a leader's data pool holds of a mission."""

    plan: CooperativePlan
    phase: str


def as_content(plan: CooperativePlan, phase: str) -> bytes:
    """For the data pool."""
    return msgspec.msgpack.encode(KeptPlan(plan, phase))


def plan_of(content: bytes) -> KeptPlan:
    """Raises msgspec.ValidationError for what `as_content` did not make."""
    return msgspec.msgpack.decode(content, type=KeptPlan)


def save(report: MissionReport, folder: Path) -> Path:
    """Write the report as JSON; the file."""
    file = folder / report.mission / REPORT_FILE
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(as_json(report), indent=1))
    return file


def as_json(report: MissionReport) -> dict[str, Any]:
    """Times in s since the mission began, by the leader's clock."""
    began = report.began
    phases = [
        {
            "name": phase.name,
            "began_s": phase.began - began,
            "started_s": {name: time - began for name, time in phase.started.items()},
            "done_s": {name: time - began for name, time in phase.done.items()},
            "waited_for": waited_for(phase),
            "skew_ms": 1000 * (max(phase.started.values()) - min(phase.started.values())) if phase.started else None,
        }
        for phase in report.phases
    ]
    skews = tick_skews_s(report.records) * 1000
    return {
        "mission": report.mission,
        "kind": report.kind,
        "leader": report.leader,
        "result": report.result,
        "reason": report.reason,
        "robots": {subplan.robot: subplan.role for subplan in report.plan.subplans} if report.plan else {},
        "thing": report.plan.thing if report.plan else "",
        "began": began,
        "seconds": report.ended - began,
        "phases": phases,
        "tick_skew_ms": spread(skews),
        "farthest_grip_m": max((record.farthest_m for record in report.records.values()), default=None),
        "clocks": {
            name: {"offset_ms": 1000 * record.offset_s, "delay_ms": 1000 * record.delay_s}
            for name, record in report.records.items()
        },
        "latency_ms": {
            origin: spread(np.array(latencies) * 1000)
            for origin, latencies in latencies_s(report.heard, report.records).items()
        },
        "events": [
            {
                "at_s": came.came - began,
                "type": type_of(came.message),
                "mission": came.message.mission,
                "sent": came.message.sent,
                "source": came.source,
                "origin": came.origin,
                "latency_ms": 1000 * latency_s(came, report.records),
            }
            for came in report.heard
        ],
    }


def waited_for(phase: Phase) -> str:
    """Who was done last, empty where not all were."""
    return max(phase.done, key=lambda name: phase.done[name]) if phase.done else ""


def spread(values: Floats) -> dict[str, float] | None:
    """Median, p99 and maximum; None of nothing."""
    if not len(values):
        return None
    return {
        "median": float(np.median(values)),
        "p99": float(np.percentile(values, 99)),
        "max": float(np.max(values)),
        "count": len(values),
    }


def tick_skews_s(records: Mapping[str, Record]) -> Floats:
    """How far apart the carriers were along their trajectory at the same time, s, at each tick of one of them."""
    tracks = [np.array(record.ticks) for record in records.values() if len(record.ticks) > 1]
    if len(tracks) < 2:
        return np.zeros(0)
    times = tracks[0][:, 0]
    within = (times >= max(track[0, 0] for track in tracks)) & (times <= min(track[-1, 0] for track in tracks))
    along = np.array([np.interp(times[within], track[:, 0], track[:, 1]) for track in tracks])
    skews: Floats = np.ptp(along, axis=0) if along.shape[1] else np.zeros(0)
    return skews


def latency_s(came: Came, records: Mapping[str, Record]) -> float:
    """From saying to hearing, with the clocks' difference taken off where it is known."""
    record = records.get(came.source)
    return came.came - (came.message.sent + (record.offset_s if record else 0.0))


def latencies_s(heard: Sequence[Came], records: Mapping[str, Record]) -> dict[str, list[float]]:
    """Of the messages that the leader got, by the channel where each came in."""
    found: dict[str, list[float]] = {}
    for came in heard:
        found.setdefault(came.origin, []).append(latency_s(came, records))
    return found

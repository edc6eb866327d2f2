"""Records of a mission: its plan in the data pool, and its report as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from robocorba.missions.leader import MissionReport, PhaseRecord
from robocorba.missions.messages import Record, type_of
from robocorba.missions.subplan import CooperativePlan
from robocorba.missions.transport import Received
from robocorba.spatial.grids import Floats

REPORT_FILE = "report.json"


class StoredPlan(msgspec.Struct, frozen=True):
    """A mission in its leader's data pool. phase: the current one."""

    plan: CooperativePlan
    phase: str


def encode_plan(plan: CooperativePlan, phase: str) -> bytes:
    """The content of a StoredPlan for the data pool."""
    return msgspec.msgpack.encode(StoredPlan(plan, phase))


def decode_plan(content: bytes) -> StoredPlan:
    """The inverse of `encode_plan`. Raises msgspec.ValidationError for invalid content."""
    return msgspec.msgpack.decode(content, type=StoredPlan)


def save(report: MissionReport, folder: Path) -> Path:
    """Write the report as JSON; return its file."""
    file = folder / report.mission / REPORT_FILE
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(as_json(report), indent=1))
    return file


def as_json(report: MissionReport) -> dict[str, Any]:
    """The report as JSON. Times are in s since the mission began, by the leader's clock."""
    began = report.began
    phases = [
        {
            "name": phase.name,
            "began_s": phase.began - began,
            "started_s": {name: time - began for name, time in phase.started.items()},
            "done_s": {name: time - began for name, time in phase.done.items()},
            "waited_for": slowest_robot(phase),
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
        "tick_skew_ms": distribution(skews),
        "farthest_grip_m": max((record.farthest_m for record in report.records.values()), default=None),
        "clocks": {
            name: {"offset_ms": 1000 * record.offset_s, "delay_ms": 1000 * record.delay_s}
            for name, record in report.records.items()
        },
        "latency_ms": {
            origin: distribution(np.array(latencies) * 1000)
            for origin, latencies in latencies_s(report.received, report.records).items()
        },
        "events": [
            {
                "at_s": received.received_at - began,
                "type": type_of(received.message),
                "mission": received.message.mission,
                "sent": received.message.sent,
                "source": received.source,
                "origin": received.origin,
                "latency_ms": 1000 * latency_s(received, report.records),
            }
            for received in report.received
        ],
    }


def slowest_robot(phase: PhaseRecord) -> str:
    """The robot that finished last; empty if none finished."""
    return max(phase.done, key=lambda name: phase.done[name]) if phase.done else ""


def distribution(values: Floats) -> dict[str, float] | None:
    """Median, p99, maximum and count; None without values."""
    if not len(values):
        return None
    return {
        "median": float(np.median(values)),
        "p99": float(np.percentile(values, 99)),
        "max": float(np.max(values)),
        "count": len(values),
    }


def tick_skews_s(records: Mapping[str, Record]) -> Floats:
    """Differences between the carriers' trajectory times [s] at each control cycle of one of them."""
    tracks = [np.array(record.ticks) for record in records.values() if len(record.ticks) > 1]
    if len(tracks) < 2:
        return np.zeros(0)
    times = tracks[0][:, 0]
    within = (times >= max(track[0, 0] for track in tracks)) & (times <= min(track[-1, 0] for track in tracks))
    along = np.array([np.interp(times[within], track[:, 0], track[:, 1]) for track in tracks])
    skews: Floats = np.ptp(along, axis=0) if along.shape[1] else np.zeros(0)
    return skews


def latency_s(received: Received, records: Mapping[str, Record]) -> float:
    """From sending to receipt, corrected by the offset of the sender's clock if it is known."""
    record = records.get(received.source)
    return received.received_at - (received.message.sent + (record.offset_s if record else 0.0))


def latencies_s(messages: Sequence[Received], records: Mapping[str, Record]) -> dict[str, list[float]]:
    """Latencies of the messages that the leader received, by the channel that each came from."""
    found: dict[str, list[float]] = {}
    for received in messages:
        found.setdefault(received.origin, []).append(latency_s(received, records))
    return found

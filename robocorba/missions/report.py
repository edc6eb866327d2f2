"""The report of a mission, as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.missions.messages import MemberMeasurements, MemberState, type_of
from robocorba.missions.subplan import CooperativePlan
from robocorba.missions.transport import Received

REPORT_FILE = "report.json"
#: Phases that no plan has: while the leader looks for helpers, and before that for its turn; after a fault; and after
#: a phase that failed.
ASKING, WAITING_FOR_AREAS, RECOVERING, ENDING = "asking", "waiting for areas", "recovering", "ending safely"
#: Messages in the report that the Omni database keeps, the last ones.
MAX_BRIEF_EVENTS = 500


class PhaseTimes(NamedTuple):
    """The times of a phase by the leader's clock: its start, and when each robot started and finished its step.
    without: robots of the plan that do not take part any more."""

    name: str
    began: float
    started: dict[str, float]
    done: dict[str, float]
    without: frozenset[str] = frozenset()


class MissionReport(NamedTuple):
    """The outcome of a mission. result: done or failed; reason: of the failure. received: by the leader. faults: what
    ended the attempts before the last one."""

    mission: str
    kind: str
    leader: str
    result: str
    reason: str
    began: float
    ended: float
    plan: CooperativePlan | None
    phases: list[PhaseTimes]
    measurements: dict[str, MemberMeasurements]
    received: list[Received]
    faults: tuple[str, ...] = ()

    def save(self, folder: Path) -> None:
        """Write it as JSON into a folder of its own."""
        file = folder / self.mission / REPORT_FILE
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(self.as_json(), indent=1))

    def as_json(self) -> dict[str, Any]:
        """Times are in s since the mission began, by the leader's clock."""
        latencies_ms: dict[str, list[float]] = {}
        for received in self.received:
            latencies_ms.setdefault(received.origin, []).append(self._latency_ms(received))
        return {
            "mission": self.mission,
            "kind": self.kind,
            "leader": self.leader,
            "result": self.result,
            "reason": self.reason,
            "faults": list(self.faults),
            "robots": {subplan.robot: subplan.role for subplan in self.plan.subplans} if self.plan else {},
            "thing": self.plan.thing if self.plan else "",
            "began": self.began,
            "seconds": self.ended - self.began,
            "phases": [self._phase_as_json(phase) for phase in self.phases],
            "tick_skew_ms": _distribution(_tick_skews_s(self.measurements) * 1000),
            "farthest_grip_m": max((member.max_slip_m for member in self.measurements.values()), default=None),
            "clocks": {
                name: {"offset_ms": 1000 * member.offset_s, "delay_ms": 1000 * member.round_trip_s}
                for name, member in self.measurements.items()
            },
            "latency_ms": {origin: _distribution(np.array(found)) for origin, found in latencies_ms.items()},
            "events": [
                {
                    "at_s": received.received_at - self.began,
                    "type": type_of(received.message),
                    "mission": received.message.mission,
                    "sent": received.message.sent,
                    "source": received.source,
                    "origin": received.origin,
                    "latency_ms": self._latency_ms(received),
                }
                for received in self.received
            ],
        }

    def brief_json(self) -> dict[str, Any]:
        """The report for the Omni database: as `as_json`, but of the messages only those that say something new, the
        last MAX_BRIEF_EVENTS of them. events_in_all: the number that the leader received."""
        new = _without_repetitions(self.received)[-MAX_BRIEF_EVENTS:]
        events = self._replace(received=new).as_json()["events"]
        return {**self.as_json(), "events": events, "events_in_all": len(self.received)}

    def _phase_as_json(self, phase: PhaseTimes) -> dict[str, Any]:
        started, done = phase.started, phase.done
        return {
            "name": phase.name,
            "began_s": phase.began - self.began,
            "started_s": {name: time - self.began for name, time in started.items()},
            "done_s": {name: time - self.began for name, time in done.items()},
            "waited_for": max(done, key=done.__getitem__, default=""),  # the robot that finished last
            "skew_ms": 1000 * (max(started.values()) - min(started.values())) if started else None,
        }

    def _latency_ms(self, received: Received) -> float:
        """From sending to receipt, corrected by the offset of the sender's clock if it is known."""
        sender = self.measurements.get(received.source)
        return 1000 * (received.received_at - (received.message.sent + (sender.offset_s if sender else 0.0)))


def _without_repetitions(received: Sequence[Received]) -> list[Received]:
    """Messages except states of a member that repeat its state before."""
    found: list[Received] = []
    last: dict[str, tuple[object, ...]] = {}
    for each in received:
        message = each.message
        if isinstance(message, MemberState):
            state = message.mission, message.step, message.is_done, message.failure, message.has_left
            if last.get(each.source) == state:
                continue
            last[each.source] = state
        found.append(each)
    return found


def _distribution(values: Floats) -> dict[str, float] | None:
    """Median, p99, maximum and count; None without values."""
    if not len(values):
        return None
    return {
        "median": float(np.median(values)),
        "p99": float(np.percentile(values, 99)),
        "max": float(np.max(values)),
        "count": len(values),
    }


def _tick_skews_s(measurements: Mapping[str, MemberMeasurements]) -> Floats:
    """Differences between the carriers' trajectory times [s] at each control cycle of one of them."""
    tracks = [np.array(member.ticks) for member in measurements.values() if len(member.ticks) > 1]
    if len(tracks) < 2:
        return np.zeros(0)
    times = tracks[0][:, 0]
    within = (times >= max(track[0, 0] for track in tracks)) & (times <= min(track[-1, 0] for track in tracks))
    positions_s = np.array([np.interp(times[within], track[:, 0], track[:, 1]) for track in tracks])
    skews: Floats = np.ptp(positions_s, axis=0)
    return skews

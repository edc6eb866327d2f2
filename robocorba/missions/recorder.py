"""A leader's records of its missions in the Omni database, written in a thread of their own: a mission never waits for
them, and a database that was away for a while gets the latest state afterwards."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from robocorba.backoff import Backoff
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.simulation import InvalidMission, StaleMission
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.report import MissionReport, PhaseTimes
from robocorba.missions.subplan import CooperativePlan
from robocorba.simulation.mission_record import MemberRecord, MissionContent, MissionResult, PhaseRecord
from robocorba.simulation.store import Mission

#: Pause after each write [s]: changes that come faster are written together.
WRITE_PAUSE_S = 0.1
#: Pauses after failed writes.
BACKOFF = Backoff(0.25, 2.0)
#: Missions that wait to be written; the oldest are dropped. A robot leads one at a time.
MAX_WAITING = 20
#: Time for the last writes when the recorder is closed [s].
CLOSE_LIMIT_S = 3.0
#: The phases before the plan's first one, and after one that failed.
ASKING, ENDING = "asking", "ending safely"

_log = logging.getLogger(__name__)


class MissionRecorder:
    """Writes the latest state of each mission by `put`, which returns the new version, and raises StaleMission,
    InvalidMission or, if it should be retried, another RoboCorbaError. Its thread runs from the first record to
    `close`."""

    def __init__(self, put: Callable[[Mission], int], backoff: Backoff = BACKOFF) -> None:
        self._put, self._backoff = put, backoff
        self._changed = threading.Condition()
        self._waiting: dict[str, MissionContent] = {}
        self._versions: dict[str, int] = {}
        self._is_closing = False
        self._thread: threading.Thread | None = None

    def record(self, name: str, content: MissionContent) -> None:
        """Write this state of a mission soon, in place of one that was not written yet. Does not block."""
        with self._changed:
            if self._is_closing:
                return
            self._waiting[name] = content
            while len(self._waiting) > MAX_WAITING:
                del self._waiting[next(iter(self._waiting))]
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="mission records", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def close(self) -> None:
        """Try once more to write what waits, and end the thread."""
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        if self._thread:
            self._thread.join(CLOSE_LIMIT_S)

    def _run(self) -> None:
        failures = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_closing)
                if not self._waiting:
                    return
                name = next(iter(self._waiting))
                content = self._waiting.pop(name)
            is_written = self._write(name, content)
            failures = 0 if is_written else failures + 1
            with self._changed:
                if not is_written and not self._is_closing:
                    self._waiting.setdefault(name, content)
                pause_s = self._backoff.pause_s(failures) if failures else WRITE_PAUSE_S
                self._changed.wait_for(lambda: self._is_closing, pause_s)

    def _write(self, name: str, content: MissionContent) -> bool:
        """Whether the state need not be written again."""
        document = content.encode()
        try:
            try:
                version = self._put(Mission(name, self._versions.get(name, 0), document))
            except StaleMission as stale:  # an answer was lost, or mission control has written it
                version = self._put(Mission(name, stale.current, document))
        except InvalidMission as error:
            _log.warning("mission %s can't be recorded: %s", name, error)
            return True
        except RoboCorbaError as error:
            _log.info("mission %s is not recorded yet: %s", name, error)
            return False
        except Exception:  # a defect must not end the thread
            _log.exception("recording mission %s failed", name)
            return True
        self._versions[name] = version
        if not content.is_running:
            del self._versions[name]
        return True


class LedMission:
    """The record of a mission that this robot leads; only its leader's thread calls it.

    kind: tag of the icon. about: the object that it moves. clock: POSIX time [s]."""

    def __init__(
        self,
        recorder: MissionRecorder,
        name: str,
        kind: str,
        about: str,
        leader: str,
        clock: Callable[[], float] = OWN_CLOCK.now,
    ) -> None:
        self._recorder, self._name, self._clock = recorder, name, clock
        begun = clock()
        self._content = MissionContent(
            kind=kind, about=about, leader=leader, begun=begun, phases=(PhaseRecord(ASKING, begun),)
        )
        self._recorder.record(name, self._content)

    def update(self, plan: CooperativePlan, phases: Sequence[PhaseTimes], is_ending: bool) -> None:
        """Record the plan's phases that have begun. is_ending: the mission ends safely after a failure."""
        robots = [subplan.robot for subplan in plan.subplans]
        begun = self._content.begun
        rows = [PhaseRecord(ASKING, begun, phases[0].began if phases else 0.0)]
        rows += [_phase(phase, robots) for phase in phases]
        if phases and is_ending:
            now = next((row.begun for row in self._content.phases if row.name == ENDING), self._clock())
            if not rows[-1].ended:  # it may have been ordered for a moment that has not come
                rows[-1] = replace(rows[-1], begun=min(rows[-1].begun, now), ended=now)
            rows.append(PhaseRecord(ENDING, now))
        self._content = replace(
            self._content,
            members=tuple(MemberRecord(subplan.robot, subplan.role) for subplan in plan.subplans),
            phases=tuple(rows),
            phases_in_all=1 + len(plan.phases),
        )
        self._recorder.record(self._name, self._content)

    def end(self, report: MissionReport, is_aborted: bool) -> None:
        """Record the end. is_aborted: a user has aborted the mission."""
        result = MissionResult(report.result)
        if is_aborted and result is not MissionResult.DONE:
            result = MissionResult.ABORTED
        self._end(result, report.reason, report.ended)
        self._content = replace(self._content, report={**report.brief_json(), "result": result.value})
        self._recorder.record(self._name, self._content)

    def fail(self, reason: str, is_aborted: bool = False) -> None:
        """Record that the mission failed before it was led, or without a report."""
        self._end(MissionResult.ABORTED if is_aborted else MissionResult.FAILED, reason, self._clock())
        self._recorder.record(self._name, self._content)

    def _end(self, result: MissionResult, reason: str, at: float) -> None:
        self._content = self._content.ended_as(result, reason, at)


def _phase(phase: PhaseTimes, robots: Sequence[str]) -> PhaseRecord:
    missing = [robot for robot in robots if robot not in phase.done]
    if not missing:
        last = max(phase.done, key=phase.done.__getitem__)
        return PhaseRecord(phase.name, phase.began, max(phase.done[last], phase.began), last)
    return PhaseRecord(phase.name, phase.began, 0.0, missing[0] if phase.done else "")

"""A leader's records of its missions in the Omni database, written in a thread of their own: a mission waits for them
only before an attempt, to know that no other robot leads it. A database that was away for a while gets the latest state
afterwards, unless another robot has taken the mission over."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection, Sequence
from typing import Protocol

import msgspec
from msgspec.structs import replace

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MissionFailed, MissionTakenOver
from robocorba.errors.services import NotPermitted, NotReachable
from robocorba.errors.simulation import InvalidMission, StaleMission, UnknownMission
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.report import ASKING, ENDING, RECOVERING, MissionReport, PhaseTimes
from robocorba.missions.subplan import CooperativePlan
from robocorba.simulation.mission_record import (
    MAX_FAULTS,
    MAX_PHASES,
    MemberRecord,
    MissionContent,
    MissionResult,
    PhaseRecord,
    decoded,
)
from robocorba.simulation.store import Mission
from robocorba.system.background import Background
from robocorba.system.backoff import Backoff

#: Pauses after failed writes [s].
BACKOFF = Backoff(0.25, 2.0)
#: Missions that wait to be written; the oldest are dropped. A robot leads one at a time.
MAX_WAITING = 20

_log = logging.getLogger(__name__)


class MissionRecords(Protocol):
    """The Omni database, as far as missions are concerned. All methods raise NotReachable."""

    def mission(self, name: str) -> Mission:
        """A mission. Raises UnknownMission."""

    def put_mission(self, mission: Mission) -> int:
        """Store a mission; return its new version. Raises InvalidMission, StaleMission."""


class MissionRecorder:
    """Writes the latest state of each mission. Its thread runs from the first record to `close`."""

    def __init__(self, records: MissionRecords, backoff: Backoff = BACKOFF) -> None:
        self._records, self._backoff = records, backoff
        self._changed = threading.Condition()
        self._waiting: dict[str, MissionContent] = {}
        #: Held while a mission is written.
        self._writing = threading.Lock()
        self._versions: dict[str, int] = {}
        self._is_closing = False
        self._thread: Background | None = None

    def record(self, name: str, content: MissionContent) -> None:
        """Write this state of a mission soon, in place of one that was not written yet. Does not block."""
        with self._changed:
            if self._is_closing:
                return
            self._waiting[name] = content
            while len(self._waiting) > MAX_WAITING:
                del self._waiting[next(iter(self._waiting))]
            if self._thread is None:
                self._thread = Background("mission records", self._run, self._thread_failed)
                self._thread.start()
            self._changed.notify_all()

    def write(self, name: str, content: MissionContent) -> None:
        """Write this state of a mission now. Raises MissionTakenOver, InvalidMission, NotReachable."""
        with self._changed:
            self._waiting.pop(name, None)
        self._put(name, content)

    def close(self) -> None:
        """Try once more to write what waits, and end the thread."""
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        if self._thread:
            self._thread.join(3.0)  # s; the process does not wait longer for a database that hangs

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
                # After a write 0.1 s, so that changes that come faster are written together.
                pause_s = self._backoff.pause_s(failures) if failures else 0.1
                self._changed.wait_for(lambda: self._is_closing, pause_s)

    def _thread_failed(self, reason: str) -> None:
        """The next record starts another thread."""
        with self._changed:
            self._thread = None

    def _write(self, name: str, content: MissionContent) -> bool:
        """Whether the state need not be written again."""
        try:
            self._put(name, content)
        except (InvalidMission, MissionTakenOver) as error:
            _log.warning("mission %s can't be recorded: %s", name, error)
            return True
        except RoboCorbaError as error:
            _log.info("mission %s is not recorded yet: %s", name, error)
            return False
        except Exception:  # a defect must not end the thread
            _log.exception("recording mission %s failed", name)
        return True

    def _put(self, name: str, content: MissionContent) -> None:
        """Store a mission, unless another robot leads it. Raises MissionTakenOver, InvalidMission, NotReachable."""
        document = content.encode()
        with self._writing:
            try:
                version = self._records.put_mission(Mission(name, self._versions.get(name, 0), document))
            except StaleMission as stale:  # an answer was lost, mission control has written it, or another leader
                if stale.current:
                    _check_leader(self._records.mission(name), content)
                version = self._records.put_mission(Mission(name, stale.current, document))
            except NotPermitted:  # a guarded database takes a record only from the robot that leads the mission
                _check_leader(self._records.mission(name), content)
                raise
            self._versions[name] = version
            if not content.is_running:
                del self._versions[name]


def claimed(
    records: MissionRecords,
    name: str,
    new: MissionContent,
    term: int = 0,
    leads: Callable[[str, str], bool] = lambda leader, mission: True,
) -> MissionContent:
    """The record of a mission that the leader of `new` leads from now on; `new` if there is none.

    term: the one in which it was asked to lead the mission, or whose leader is silent; 0 if it begins the mission. A
    claim that comes too late has an older one. leads: whether a robot answers that it leads a mission; such a one is
    never displaced. Raises MissionTakenOver if another robot leads it, MissionFailed if it has ended, NotReachable."""
    for _ in range(5):  # others may write the record at the same time
        try:
            stored = records.mission(name)
        except UnknownMission:
            if term:
                raise MissionFailed(f"{name} is not offered any more") from None
            return new
        before = decoded(stored.document)
        if before is None:
            return new
        content = _claim(name, before, new, term, leads)
        try:
            records.put_mission(Mission(name, stored.version, content.encode()))
        except StaleMission:  # somebody has written it since: look at it again
            continue
        return content
    raise NotReachable(f"the record of {name} changes all the time")


def _claim(
    name: str, before: MissionContent, new: MissionContent, term: int, leads: Callable[[str, str], bool]
) -> MissionContent:
    """What the leader of `new` may store in place of a record. Raises MissionTakenOver, MissionFailed."""
    if not before.is_running:
        raise MissionFailed(f"{name} has ended already: {before.reason or before.result.value}")
    if term not in (0, before.term):
        raise MissionTakenOver(before.leader, before.term)
    if before.leader == new.leader:
        is_new = before.is_offered or not (before.phases or before.leaders)  # then its times are by another clock
        return replace(new, term=before.term) if is_new else replace(before, icon=new.icon)
    if not term or before.is_offered or leads(before.leader, name):
        raise MissionTakenOver(before.leader, before.term)
    return before.taken_over(new.leader, f"{before.leader} was silent", max(before.latest, new.begun))


def _check_leader(stored: Mission, content: MissionContent) -> None:
    """Raise MissionTakenOver if another robot leads a mission in the same term or a later one."""
    found = decoded(stored.document)
    if found and (found.term > content.term or (found.term == content.term and found.leader != content.leader)):
        raise MissionTakenOver(found.leader, found.term)


class LedMission:
    """A mission that this robot leads, as others see it: its record in the Omni database, and its plan in the data
    pool. Only its leader's thread calls it.

    content: the record as it begins. clock: POSIX time [s]. store_plan: stores a plan with its current phase in the
    data pool; must not block."""

    def __init__(
        self,
        recorder: MissionRecorder,
        name: str,
        content: MissionContent,
        clock: Callable[[], float] = OWN_CLOCK.now,
        store_plan: Callable[[CooperativePlan, str], None] = lambda plan, phase: None,
    ) -> None:
        self._recorder, self.name, self._clock, self._store_plan = recorder, name, clock, store_plan
        #: How far the times of the record are ahead of `clock` [s]: they go on from those of a former leader, whose
        #: clock was ahead of ours, or of our own before it was set back.
        self._ahead_s = max(0.0, content.latest - clock())
        #: Phases under earlier leaders, and the one in which this leader looks for helpers.
        self._before = (*content.phases, PhaseRecord(RECOVERING if content.phases else ASKING, self._now()))
        #: Phases that have begun under this leader, of all attempts.
        self.phases: list[PhaseTimes] = []
        self._content = replace(content, phases=_closed(self._before))
        self._plan: CooperativePlan | None = None
        self._recorder.record(self.name, self._content)

    @property
    def term(self) -> int:
        return self._content.term

    @property
    def attempt(self) -> str:
        """The name of the present attempt."""
        return f"{self.name}.{self._content.attempts}"

    def begin_attempt(self) -> None:
        """Note another attempt, before it begins. Raises MissionTakenOver, NotReachable."""
        self._content = replace(self._content, attempts=self._content.attempts + 1)
        self.confirm()

    def confirm(self) -> None:
        """Raise MissionTakenOver if another robot leads the mission, NotReachable if that is unknown."""
        try:
            self._recorder.write(self.name, self._content)
        except InvalidMission as error:  # there is no room; nobody could take it over
            _log.warning("mission %s can't be recorded: %s", self.name, error)

    def begin_without_robots(self, phase: str) -> None:
        """A phase begins in which no robot does a plan."""
        self.phases.append(PhaseTimes(phase, OWN_CLOCK.now(), {}, {}))
        self.update(self._plan)

    def begin_phase(self, plan: CooperativePlan, name: str, at: float, without: Collection[str]) -> PhaseTimes:
        """A phase in which all robots of the plan except some take part begins at this time of the leader's clock."""
        phase = PhaseTimes(name, at, {}, {}, frozenset(without))
        self.phases.append(phase)
        self._store_plan(plan, name)
        self.update(plan)
        return phase

    def note(self, plan: CooperativePlan, phase: str, is_ending: bool = False) -> None:
        """The robots of a plan are asked to do it, or all end. is_ending: safely, after a failure."""
        self._store_plan(plan, phase)
        self.update(plan, is_ending)

    def update(self, plan: CooperativePlan | None, is_ending: bool = False) -> None:
        """Record a change of the phases. plan: the latest one, if any. is_ending: all end safely after a failure."""
        robots = [subplan.robot for subplan in plan.subplans] if plan else []
        rows = [*self._before, *(self._phase(phase, robots) for phase in self.phases)]
        if self.phases and is_ending:
            now = next((row.begun for row in self._content.phases[len(rows) :] if row.name == ENDING), self._now())
            if not rows[-1].ended:  # it may have been ordered for a moment that has not come
                rows[-1] = replace(rows[-1], begun=min(rows[-1].begun, now), ended=now)
            rows.append(PhaseRecord(ENDING, now))
        if plan and plan is not self._plan:
            self._plan = plan
            self._content = replace(
                self._content,
                members=tuple(MemberRecord(subplan.robot, subplan.role) for subplan in plan.subplans),
                plan=msgspec.to_builtins(plan),
                phases_in_all=len(self._before) + len(self.phases) + len(plan.phases),
            )
        self._content = replace(self._content, phases=_closed(rows))
        self._recorder.record(self.name, self._content)

    def end(self, report: MissionReport, is_aborted: bool) -> None:
        """Record the end. is_aborted: a user has aborted the mission."""
        result = MissionResult(report.result)
        if is_aborted and result is not MissionResult.DONE:
            result = MissionResult.ABORTED
        ended = self._content.ended_as(result, report.reason, report.ended + self._ahead_s)
        document = {**report.brief_json(), "result": result.value}
        self._recorder.record(self.name, replace(ended, faults=report.faults[-MAX_FAULTS:], report=document))

    def fail(self, reason: str, is_aborted: bool = False) -> None:
        """Record that the mission failed before it was led, or without a report."""
        result = MissionResult.ABORTED if is_aborted else MissionResult.FAILED
        self._recorder.record(self.name, self._content.ended_as(result, reason, self._now()))

    def _now(self) -> float:
        return self._clock() + self._ahead_s

    def _phase(self, phase: PhaseTimes, robots: Sequence[str]) -> PhaseRecord:
        began = phase.began + self._ahead_s
        missing = [robot for robot in robots if robot not in phase.done and robot not in phase.without]
        if phase.done and not missing:
            last = max(phase.done, key=phase.done.__getitem__)
            return PhaseRecord(phase.name, began, max(phase.done[last] + self._ahead_s, began), last)
        return PhaseRecord(phase.name, began, 0.0, missing[0] if phase.done else "")


def _closed(rows: Sequence[PhaseRecord]) -> tuple[PhaseRecord, ...]:
    """Phases, the last MAX_PHASES of them; each ends at the latest when the next one begins."""
    ends = [*(following.begun for following in rows[1:]), 0.0]
    closed = [
        row if row.ended or not end else replace(row, ended=max(row.begun, end))
        for row, end in zip(rows, ends, strict=True)
    ]
    return tuple(closed[-MAX_PHASES:])

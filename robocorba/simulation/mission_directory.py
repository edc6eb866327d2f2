"""All missions of the building, in versions: what leaders store in the Omni database, kept until there is no room."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import msgspec

from robocorba.errors.simulation import NoLeader, NoRoom, UnknownMission
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState, decoded
from robocorba.simulation.store import Mission, SimulationStore
from robocorba.simulation.versioned import Versioned, first_version

_log = logging.getLogger(__name__)


class MissionDirectory:
    """The missions in `store`, which nobody else changes. Thread-safe. clock: time that passes steadily [s].

    No clock decides what is kept: those of leaders may be wrong, and ours may be set.

    A mission whose document is no MissionContent is stored like the others, but is in none of the lists here, and so is
    one that is offered to a robot."""

    def __init__(self, store: SimulationStore, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._clock = store, clock
        self._lock = threading.RLock()
        self._version = first_version()
        #: Without plans and reports.
        self._states: Versioned[str, MissionState] = Versioned(self._version)
        #: When each state was stored, or read after a restart [s, clock].
        self._noted_at: dict[str, float] = {}
        for mission in store.missions():
            content = decoded(mission.document)
            if content and content.is_offered:  # by an earlier process, which has ended: nobody waits for the answer
                store.remove_mission(mission.name)
            else:
                self._note(mission)

    # ---- the Omni database ----

    def put_mission(self, mission: Mission) -> int:
        """As SimulationStore.put_mission; if there is no room, the missions that ended first make room."""
        with self._lock:
            while True:
                try:
                    version = self._store.put_mission(mission)
                    break
                except NoRoom:
                    if not self._forget_oldest(mission.name):
                        raise
            self._note(Mission(mission.name, version, mission.document))
            return version

    def missions(self) -> list[Mission]:
        """All missions as stored, sorted by name."""
        return sorted(self._store.missions(), key=lambda mission: mission.name)

    def stored(self, name: str) -> Mission:
        """A mission as stored. Raises UnknownMission."""
        found = self._store.mission(name)
        if found is None:
            raise UnknownMission(name)
        return found

    def may_put(self, robot: str, name: str, document: bytes) -> bool:
        """Whether a robot may store this document of a mission: if it leads the mission, or takes it over as one of its
        members."""
        after, before = decoded(document), None
        if stored := self._store.mission(name):
            before = decoded(stored.document)
            if before is None:
                return False
        if after is None or after.leader != robot:
            return False
        if before is None or before.leader == robot:
            return True
        return before.is_running and robot in before.successors() and after.term == before.term + 1

    def remove_mission(self, name: str) -> None:
        """Raises UnknownMission."""
        with self._lock:
            self._store.remove_mission(name)
            self._forget(name)

    # ---- mission control ----

    def since(self, version: int) -> list[MissionState]:
        """The missions that changed after a version, oldest change first; all of them if it is not one of ours."""
        with self._lock:
            changed = self._states.since(version if version <= self._version else 0)
        return sorted(changed.values(), key=lambda state: state.version)

    def mission(self, name: str) -> MissionState:
        """Raises UnknownMission."""
        state = self._states.get(name)
        if state is None:
            raise UnknownMission(name)
        return state

    def report(self, name: str) -> str:
        """The report of a mission as JSON; of one whose leader has left none, what the record says. Raises
        UnknownMission."""
        with self._lock:  # else the document could be a later one, or none that is listed
            content = self.mission(name).content
            stored = self._store.mission(name)
        report = MissionContent.decode(stored.document).report if stored else None
        return msgspec.json.encode(content.brief_report(name) if report is None else report).decode()

    def offer(self, name: str, content: MissionContent) -> None:
        """Store a mission that `content.leader` is asked to lead next, in place of an earlier offer. Raises
        InvalidMission if there is no room, NoLeader if another robot has accepted it."""
        content = msgspec.structs.replace(content, is_offered=True)
        with self._lock:
            stored = self._store.mission(name)
            if stored and not self._is_offered(name):
                raise NoLeader(f"mission {name[:80]!r} has a leader")
            self.put_mission(Mission(name, stored.version if stored else 0, content.encode()))

    def begin(self, name: str, content: MissionContent) -> None:
        """Store that `content.leader` leads a mission, a new one or one that it was offered, unless that robot has done
        so. Raises InvalidMission if there is no room."""
        with self._lock:
            stored = self._store.mission(name)
            if stored is None or self._is_offered(name):
                self.put_mission(Mission(name, stored.version if stored else 0, content.encode()))

    def withdraw(self, name: str) -> bool:
        """Remove a mission that is offered, so that no robot can accept it any more. False if one has."""
        with self._lock:
            if not self._is_offered(name):
                return self._store.mission(name) is None
            self.remove_mission(name)
            return True

    def give(self, state: MissionState, robot: str, reason: str) -> MissionState | None:
        """Let another robot lead a mission, unless it has changed since `state`; returns its state, None if it has."""
        return self._change(state, lambda now: state.content.taken_over(robot, reason, now))

    def fail(self, state: MissionState, reason: str) -> None:
        """End a mission whose leader is gone, unless it has changed since `state`. A leader that comes back stores what
        is true."""
        self._change(state, lambda now: state.content.ended_as(MissionResult.FAILED, reason, now))

    def _change(self, state: MissionState, changed: Callable[[float], MissionContent]) -> MissionState | None:
        """Change a mission, unless it has changed since `state`; returns its state, None if it has. changed: gets the
        time by the clock of the mission's leader, which stored `state` right after its latest time [s]."""
        with self._lock:
            stored = self._store.mission(state.name)
            if stored is None or self._states.get(state.name) is not state:
                return None
            now = state.content.latest + self._clock() - self._noted_at[state.name]
            self.put_mission(Mission(state.name, stored.version, changed(now).encode()))
            return self._states.get(state.name)

    def running(self) -> list[MissionState]:
        """The missions that have not ended."""
        with self._lock:
            return [state for state in self._states.values() if state.content.is_running]

    # ---- implementation; the lock is held ----

    def _is_offered(self, name: str) -> bool:
        stored = self._store.mission(name)
        content = decoded(stored.document) if stored else None
        return content is not None and content.is_offered

    def _note(self, mission: Mission) -> None:
        content = decoded(mission.document)
        if content is None or content.is_offered:
            self._forget(mission.name)
            return
        self._version += 1
        self._noted_at[mission.name] = self._clock()
        # In one step: `mission` reads without the lock, which is held while the disk is written.
        self._states.put(mission.name, MissionState(mission.name, self._version, content.summary), self._version)

    def _forget(self, name: str) -> None:
        self._states.remove(name, self._version)
        self._noted_at.pop(name, None)

    def _forget_oldest(self, except_for: str) -> bool:
        """Remove the mission that ended first; whether there was one."""
        ended = [state for state in self._states.values() if not state.content.is_running and state.name != except_for]
        if not ended:
            return False
        oldest = min(ended, key=lambda state: state.version)
        _log.info("mission %s is removed to make room", oldest.name)
        self.remove_mission(oldest.name)
        return True

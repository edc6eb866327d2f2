"""Mission control: starts and aborts missions through their leaders, and notices leaders that are gone."""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidMission, NoLeader, UnknownMission
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.mission_record import MissionContent, MissionState, new_mission_name

#: A mission fails when its leader has been logged off, or has not led it, for this time [s].
GONE_LIMIT_S = 15.0
#: The same for a leader that is logged on, but does not answer [s].
SILENT_LIMIT_S = 60.0
#: Calls to leaders at the same time, so that robots that hang don't occupy all threads of the server.
MAX_CALLS = 2
#: Time for which an abort is retried [s]: a leader that has just accepted a mission leads it a moment later.
ABORT_RETRY_S, ABORT_PAUSE_S = 1.0, 0.1

_log = logging.getLogger(__name__)


class Leaders(Protocol):
    """The robots, as mission control calls them. All methods raise NotReachable within a few seconds."""

    def start(self, leader: str, mission: str, icon: str) -> None:
        """Let a robot lead a mission. Raises InvalidProgram, IllegalOrder."""

    def abort(self, leader: str, mission: str) -> None:
        """Abort a mission. Raises UnknownMission if the robot does not lead it."""

    def mission_of(self, leader: str) -> str:
        """The mission that a robot leads or takes part in; empty for none."""


class MissionControl:
    """Mission control of a building. Thread-safe."""

    def __init__(self, missions: MissionDirectory, leaders: Leaders) -> None:
        self.missions, self._leaders = missions, leaders
        self._calls = threading.BoundedSemaphore(MAX_CALLS)

    def start(self, leader: str, icon: str) -> str:
        """Let a robot lead the mission of a cooperative icon in JSON; return the mission's name. Raises NoLeader;
        InvalidProgram, IllegalOrder as the robot."""
        name, begun = new_mission_name(leader), time.time()
        with self._calling():
            self._leaders.start(leader, name, icon)
        with contextlib.suppress(InvalidMission):  # no room: the mission runs, as its leader's own record would show
            self.missions.begin(name, _content(leader, icon, begun))
        return name

    def abort(self, name: str) -> None:
        """Abort a mission; returns when the leader has accepted it. Raises UnknownMission; NoLeader if it has ended, or
        its leader does not answer or lead it any more."""
        deadline = time.monotonic() + ABORT_RETRY_S
        while True:
            content = self.missions.mission(name).content
            if not content.is_running:
                reason = f": {content.reason}" if content.reason else ""
                raise NoLeader(f"mission {name[:80]!r} has ended already, {content.result.value}{reason}")
            try:
                with self._calling():
                    return self._leaders.abort(content.leader, name)
            except UnknownMission:
                if time.monotonic() > deadline:
                    raise NoLeader(f"robot {content.leader} does not lead mission {name[:80]!r} any more") from None
            time.sleep(ABORT_PAUSE_S)

    @contextlib.contextmanager
    def _calling(self) -> Iterator[None]:
        if not self._calls.acquire(blocking=False):
            raise NoLeader(f"{MAX_CALLS} robots are being asked at present, the limit; try again in a few seconds")
        try:
            yield
        except NotReachable as error:
            raise NoLeader(str(error)) from None
        finally:
            self._calls.release()


class _Doubt(NamedTuple):
    """Since when a mission seems to have no leader [s, monotonic], the reason, and the limit [s]."""

    since: float
    reason: str
    limit_s: float


class LeaderWatch:
    """Ends the records of missions whose leaders are gone. `check` is called in one thread, every few seconds; `close`,
    from another, ends a check after the call in progress.

    is_logged_on: whether a robot has a session of the simulation server. clock: monotonic [s]."""

    def __init__(
        self,
        missions: MissionDirectory,
        leaders: Leaders,
        is_logged_on: Callable[[str], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._missions, self._leaders = missions, leaders
        self._is_logged_on, self._clock = is_logged_on, clock
        self._doubts: dict[str, _Doubt] = {}
        self._is_closed = False

    def check(self) -> None:
        """Ask the leaders of the running missions, each once, and fail the missions that have had none for too long."""
        with _logged("old missions are not removed"):
            self._missions.forget_old()
        running = self._missions.running()
        led: dict[str, str | None] = {}
        for leader in {state.content.leader: None for state in running}:
            if self._is_closed:
                return
            led[leader] = self._led_by(leader)
        doubts: dict[str, _Doubt] = {}
        for state in running:
            reason, limit_s = self._problem(state, led[state.content.leader])
            if not reason:
                continue
            now = self._clock()
            before = self._doubts.get(state.name)
            doubt = _Doubt(before.since if before else now, reason, limit_s)
            if now - doubt.since >= limit_s:
                with _logged(f"mission {state.name} can't be ended"):
                    self._missions.fail(state, f"{reason} for {now - doubt.since:.0f} s")
            else:
                doubts[state.name] = doubt
        self._doubts = doubts

    def close(self) -> None:
        """Ask no further leaders."""
        self._is_closed = True

    def _led_by(self, leader: str) -> str | None:
        """The mission that a robot leads or takes part in, empty for none; None if the robot does not answer."""
        try:
            return self._leaders.mission_of(leader)
        except NotReachable:
            return None

    def _problem(self, state: MissionState, led: str | None) -> tuple[str, float]:
        """Why a mission seems to have no leader, empty if it has one; and for how long that is accepted [s]. led: what
        its leader leads."""
        leader = state.content.leader
        if led == state.name:
            return "", 0.0
        if led is not None:
            return f"its leader {leader} did not lead it any more", GONE_LIMIT_S
        if self._is_logged_on(leader):
            return f"its leader {leader} did not answer", SILENT_LIMIT_S
        return f"its leader {leader} was gone", GONE_LIMIT_S


@contextlib.contextmanager
def _logged(failure: str) -> Iterator[None]:
    """What fails inside is logged, and the caller goes on."""
    try:
        yield
    except RoboCorbaError as error:
        _log.warning("%s: %s", failure, error)


def _content(leader: str, icon: str, begun: float) -> MissionContent:
    """The first record of a mission, whose icon its leader has accepted."""
    try:
        members: Any = json.loads(icon)
    except (ValueError, RecursionError):
        members = {}
    members = members if isinstance(members, dict) else {}
    kind, about = members.get("icon", ""), members.get("table", members.get("object", ""))
    return MissionContent(kind=str(kind), about=str(about), leader=leader, begun=begun)

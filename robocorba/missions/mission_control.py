"""Mission control: starts and aborts missions through their leaders, and looks after those whose leaders are gone."""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

import msgspec

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder, InvalidProgram
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidMission, NoLeader, UnknownMission
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.mission_record import MissionContent, MissionState, new_mission_name

#: When its leader has been logged off, or has not led it, for this time, a mission is given to another robot [s]. Its
#: members take it over sooner, if it has any.
HAND_OVER_S = 20.0
#: After this time it fails [s].
GONE_LIMIT_S = 60.0
#: Maximum number of robots that are asked to lead a mission.
MAX_ASKED = 5
#: Calls to leaders at the same time, so that robots that hang don't occupy all threads of the server.
MAX_CALLS = 2
#: Time for which an abort is retried [s]: a leader that has just accepted a mission leads it a moment later.
ABORT_RETRY_S, ABORT_PAUSE_S = 1.0, 0.1

_log = logging.getLogger(__name__)


class Leaders(Protocol):
    """The robots, as mission control calls them. All methods raise NotReachable within a few seconds."""

    def start(self, leader: str, mission: str, icon: str, term: int) -> None:
        """Let a robot lead a mission in this term; it refuses if the record has another one by then. Raises
        InvalidProgram, IllegalOrder."""

    def abort(self, leader: str, mission: str) -> None:
        """Abort a mission. Raises UnknownMission if the robot does not lead it."""

    def mission_of(self, leader: str) -> str:
        """The mission that a robot leads or takes part in; empty for none."""


class MissionControl:
    """Mission control of a building. Thread-safe. nearest: the names of the robots, those near to an object first."""

    def __init__(
        self, missions: MissionDirectory, leaders: Leaders, nearest: Callable[[str], list[str]] = lambda about: []
    ) -> None:
        self.missions, self._leaders, self._nearest = missions, leaders, nearest
        self._calls = threading.BoundedSemaphore(MAX_CALLS)

    def start(self, leader: str, icon: str) -> str:
        """Let a robot lead the mission of a cooperative icon in JSON, without a name the nearest free one; return the
        mission's name. Raises NoLeader; InvalidProgram, IllegalOrder as the robot."""
        content = _content(leader, icon, time.time())
        name = new_mission_name(leader or content.about)
        with self._calling():
            try:
                if leader:
                    self._offer(name, content, icon)
                else:
                    self._offer_to_nearest(name, content, icon)
            except RoboCorbaError:
                if self.missions.withdraw(name):
                    raise
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

    def _offer(self, name: str, content: MissionContent, icon: str) -> None:
        """Let `content.leader` lead a mission. What it was asked is in the record before, so that a robot that answers
        too late can't lead it. Raises NoLeader, InvalidProgram, IllegalOrder, NotReachable."""
        try:
            self.missions.offer(name, content)
        except InvalidMission as error:
            raise NoLeader(f"it can't be recorded: {error}") from None
        self._leaders.start(content.leader, name, icon, content.term)
        self.missions.begin(name, content)

    def _offer_to_nearest(self, name: str, content: MissionContent, icon: str) -> None:
        """Let the robot nearest to the mission's object lead it that can. Raises NoLeader; InvalidProgram if all refuse
        the icon, not only one without arms."""
        errors: dict[str, RoboCorbaError] = {}
        content = msgspec.structs.replace(content, term=0)
        for robot in self._nearest(content.about)[:MAX_ASKED]:
            content = content.offered_to(robot)
            try:
                return self._offer(name, content, icon)
            except (IllegalOrder, InvalidProgram, NotReachable) as error:
                errors[robot] = error
        if errors and all(isinstance(error, InvalidProgram) for error in errors.values()):
            raise next(iter(errors.values()))
        raise NoLeader("no robot can lead it" + "".join(f"; {robot}: {error}" for robot, error in errors.items()))

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
    """Since when a mission seems to have no leader in its term [s, monotonic]. is_offered: whether other robots were
    asked to lead it."""

    since: float
    term: int
    is_offered: bool = False


class LeaderWatch:
    """Gives missions whose leaders are gone to other robots, or ends their records. `check` is called in one thread,
    every few seconds; `close`, from another, ends a check after the call in progress.

    is_logged_on: whether a robot has a session of the simulation server. nearest: see MissionControl. clock: monotonic
    [s]."""

    def __init__(
        self,
        missions: MissionDirectory,
        leaders: Leaders,
        is_logged_on: Callable[[str], bool],
        clock: Callable[[], float] = time.monotonic,
        nearest: Callable[[str], list[str]] = lambda about: [],
    ) -> None:
        self._missions, self._leaders = missions, leaders
        self._is_logged_on, self._clock, self._nearest = is_logged_on, clock, nearest
        self._doubts: dict[str, _Doubt] = {}
        self._is_closed = False

    def check(self) -> None:
        """Ask the leaders of the running missions, each once; give missions that have none to others, or fail them."""
        running = self._missions.running()
        led: dict[str, str | None] = {}
        for leader in {state.content.leader: None for state in running}:
            if self._is_closed:
                return
            led[leader] = self._led_by(leader)
        doubts: dict[str, _Doubt] = {}
        for state in running:
            reason = self._problem(state, led[state.content.leader])
            if not reason:
                continue
            now, term = self._clock(), state.content.term
            doubt = self._doubts.get(state.name)
            if doubt is None or doubt.term != term:
                doubt = _Doubt(now, term)
            if now - doubt.since >= HAND_OVER_S and not doubt.is_offered:
                with _logged(f"mission {state.name} can't be given to another robot"):
                    self._offer(state)
                    term = self._missions.mission(state.name).content.term
                doubt = _Doubt(doubt.since, term, is_offered=True)
            if now - doubt.since >= GONE_LIMIT_S:
                with _logged(f"mission {state.name} can't be ended"):
                    self._missions.fail(state, f"{reason} for {now - doubt.since:.0f} s")
            else:
                doubts[state.name] = doubt
        self._doubts = doubts

    def close(self) -> None:
        """Ask no further leaders."""
        self._is_closed = True

    def _offer(self, state: MissionState) -> None:
        """Let the nearest of the other robots lead a mission that can."""
        gone = may_lead = state.content.leader
        icon = state.content.icon
        others = [robot for robot in self._nearest(state.content.about) if robot != gone]
        for robot in others[:MAX_ASKED] if icon else ():
            # Just before: it may have come back, or have accepted without its answer being received.
            if self._is_closed or (may_lead and self._led_by(may_lead) == state.name):
                return
            given = self._missions.give(state, robot, f"{gone} was gone")
            if given is None:
                return
            state = given
            try:
                self._leaders.start(robot, state.name, json.dumps(icon), state.content.term)
            except RoboCorbaError as error:
                _log.info("mission %s: its leader %s is gone, and %s", state.name, gone, error)
                may_lead = robot if isinstance(error, NotReachable) else ""  # one that refuses may take part in it
            else:
                _log.warning("mission %s: its leader %s is gone; %s leads it now", state.name, gone, robot)
                return

    def _led_by(self, leader: str) -> str | None:
        """The mission that a robot leads or takes part in, empty for none; None if the robot does not answer."""
        try:
            return self._leaders.mission_of(leader)
        except NotReachable:
            return None

    def _problem(self, state: MissionState, led: str | None) -> str:
        """Why a mission seems to have no leader, empty if it has one. led: what its leader leads."""
        leader = state.content.leader
        if led == state.name:
            return ""
        if led is not None:
            return f"its leader {leader} did not lead it any more"
        return f"its leader {leader} " + ("did not answer" if self._is_logged_on(leader) else "was gone")


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
    return MissionContent(kind=str(kind), about=str(about), leader=leader, icon=members, begun=begun)

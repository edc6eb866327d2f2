"""Leaders of a mission follow each other, whatever robots hang, go on late, die or lose an answer: in each term one
robot leads at most, and a leader that leads and answers is never displaced.

Mission control, its watch, the directory of missions and the robots' claims are real; the model knows of each robot
only what happens to it, what it leads, and which requests wait in its socket."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder, MissionFailed, MissionTakenOver
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.missions.mission_control import LeaderWatch, MissionControl
from robocorba.missions.recorder import MissionRecorder, claimed
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.mission_record import MemberRecord, MissionContent, MissionResult
from robocorba.simulation.store import Mission, SimulationStore
from tests.missions.places import WatchedDirectory

ROBOTS = "ABC"
ICON = {"icon": "move_table", "table": "desk"}
ROBOT = st.sampled_from(ROBOTS)


class Robot:
    """is_answering: it is not hung or dead. led: the record of the mission that it leads, and its name."""

    def __init__(self, name: str, records: MissionDirectory) -> None:
        self.name, self.recorder = name, MissionRecorder(Records(records))
        self.is_answering, self.is_reply_lost, self.is_slow = True, False, False
        self.led: tuple[str, MissionContent] | None = None
        #: Requests that wait in its socket, or in the thread of a program that has begun.
        self.waiting: list[Callable[[], None]] = []

    def leads(self, mission: str) -> bool:
        return self.led is not None and self.led[0] == mission


class Records:
    """The Omni database, as robots call it."""

    def __init__(self, directory: MissionDirectory) -> None:
        self._directory = directory

    def mission(self, name: str) -> Mission:
        return self._directory.stored(name)

    def put_mission(self, mission: Mission) -> int:
        return self._directory.put_mission(mission)


class Succession(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.closing = contextlib.ExitStack()
        folder = self.closing.enter_context(tempfile.TemporaryDirectory())
        self.store = self.closing.enter_context(SimulationStore(Path(folder) / "simulation.sqlite"))
        self.now = 0.0
        self.directory = WatchedDirectory(self.store, lambda: 1e9 + self.now, self.note_change)
        self.robots = {name: Robot(name, self.directory) for name in ROBOTS}
        self.order = list(ROBOTS)
        self.control = MissionControl(self.directory, self, lambda about: self.order)
        self.watch = LeaderWatch(self.directory, self, lambda robot: True, lambda: self.now, lambda about: self.order)
        #: Who has led a mission in each term, as far as it made an attempt.
        self.led_in: dict[tuple[str, int], set[str]] = {}
        self.displaced = ""

    def teardown(self) -> None:
        self.closing.close()

    # ---- robots, as mission control and other robots call them ----

    def start(self, leader: str, mission: str, icon: str, term: int) -> None:
        robot = self.robots[leader]
        if not robot.is_answering:
            robot.waiting.append(lambda: self.claim(robot, mission, term))
            raise NotReachable(f"{leader} hangs")
        if robot.led:
            raise IllegalOrder("run a program", "runs a program")
        if robot.is_slow:  # its program has begun, and will claim the mission later
            robot.waiting.append(lambda: self.claim(robot, mission, term))
        else:
            self.claim(robot, mission, term)
        if robot.is_reply_lost:
            raise NotReachable(f"the answer of {leader} was lost")

    def abort(self, leader: str, mission: str) -> None:
        raise UnknownMission(mission)

    def mission_of(self, leader: str) -> str:
        robot = self.robots[leader]
        if not robot.is_answering:
            raise NotReachable(f"{leader} hangs")
        return robot.led[0] if robot.led else ""

    def claim(self, robot: Robot, mission: str, term: int) -> None:
        """What a robot does in the end that is asked to lead a mission, or takes it over."""
        if robot.led:
            return
        new = MissionContent(kind="move_table", about="desk", leader=robot.name, icon=ICON, begun=1e9 + self.now)

        def leads(leader: str, name: str) -> bool:
            other = self.robots[leader]
            return other.is_answering and other.leads(name)

        try:
            content = claimed(Records(self.directory), mission, new, term, leads)
        except (MissionFailed, MissionTakenOver):
            return
        assert content.term - term in (0, 1), "the request was too late"
        members = tuple(MemberRecord(name, "helper") for name in ROBOTS)
        robot.led = mission, MissionContent(**{**_fields(content), "members": members})

    # ---- what happens ----

    @initialize()
    def a_mission_is_started(self) -> None:
        self.control.start("A", json.dumps(ICON))
        self.write("A")

    @rule(leader=st.sampled_from(["", *ROBOTS]), order=st.permutations(ROBOTS))
    def another_mission_is_started(self, leader: str, order: list[str]) -> None:
        self.order = order
        before = {mission.name for mission in self.store.missions()}
        try:
            self.control.start(leader, json.dumps(ICON))
        except RoboCorbaError:
            assert {mission.name for mission in self.store.missions()} <= before
            for robot in self.robots.values():
                assert robot.led is None or robot.led[0] in before, "it leads what the user was refused"

    @rule(robot=ROBOT)
    def a_robot_hangs(self, robot: str) -> None:
        self.robots[robot].is_answering = False

    @rule(robot=ROBOT, is_slow=st.booleans(), is_reply_lost=st.booleans())
    def a_robot_answers(self, robot: str, is_slow: bool, is_reply_lost: bool) -> None:
        """Also one that hung; what waits in its socket is done later."""
        found = self.robots[robot]
        found.is_answering, found.is_slow, found.is_reply_lost = True, is_slow, is_reply_lost

    @precondition(lambda self: self.late())
    @rule(number=st.integers(0, 9))
    def a_request_is_done_late(self, number: int) -> None:
        late = self.late()
        late[number % len(late)].waiting.pop(number // len(late) % len(late[number % len(late)].waiting))()

    def late(self) -> list[Robot]:
        """Robots that answer, and have requests that wait."""
        return [robot for robot in self.robots.values() if robot.is_answering and robot.waiting]

    @rule(robot=ROBOT)
    def a_robot_dies(self, robot: str) -> None:
        """And is started again: it knows nothing."""
        self.robots[robot] = Robot(robot, self.directory)

    @rule(seconds=st.sampled_from([3.0, 10.0, 21.0]), order=st.permutations(ROBOTS))
    def mission_control_looks(self, seconds: float, order: list[str]) -> None:
        self.order = order
        for _ in range(2):
            self.watch.check()
            self.now += seconds

    @rule(robot=ROBOT)
    def a_member_finds_its_leader_silent(self, robot: str) -> None:
        """It reads the record now, and claims the mission later."""
        found = self.robots[robot]
        for state in self.directory.running():
            if found.is_answering and robot in state.content.successors():
                mission, term = state.name, state.content.term
                found.waiting.append(lambda mission=mission, term=term: self.claim(found, mission, term))  # type: ignore[misc]

    @precondition(lambda self: any(robot.led for robot in self.robots.values()))
    @rule(number=st.integers(0, 9), is_end=st.integers(0, 3).map(lambda number: number == 0))
    def a_leader_writes(self, number: int, is_end: bool) -> None:
        """A leader begins an attempt, for which it writes its record, or ends the mission."""
        leading = [name for name, robot in self.robots.items() if robot.led]
        self.write(leading[number % len(leading)], is_end)

    def write(self, robot: str, is_end: bool = False) -> None:
        found = self.robots[robot]
        assert found.led
        name, content = found.led
        if is_end:
            content = content.ended_as(MissionResult.DONE, "", 1e9 + self.now)
        try:
            found.recorder.write(name, content)
        except MissionTakenOver:
            found.led = None
            return
        self.led_in.setdefault((name, content.term), set()).add(robot)
        if is_end:
            found.led = None

    @precondition(lambda self: not any(robot.waiting for robot in self.robots.values()))
    @rule()
    def the_server_is_started_again(self) -> None:
        self.directory = WatchedDirectory(self.store, lambda: 1e9 + self.now, self.note_change)
        assert not any(MissionContent.decode(each.document).is_offered for each in self.store.missions())
        self.control = MissionControl(self.directory, self, lambda about: self.order)
        self.watch = LeaderWatch(self.directory, self, lambda robot: True, lambda: self.now, lambda about: self.order)
        for robot in self.robots.values():
            robot.recorder = MissionRecorder(Records(self.directory))

    # ---- what must hold ----

    def note_change(self, name: str, before: MissionContent, after: MissionContent) -> None:
        """A leader must not be displaced while it leads and answers."""
        robot = self.robots[before.leader]
        is_kept = (after.leader, after.term) == (
            before.leader,
            before.term,
        ) and after.result is not MissionResult.FAILED
        if (
            robot.is_answering
            and robot.led
            and robot.led[0] == name
            and robot.led[1].term == before.term
            and not is_kept
        ):
            self.displaced = f"{name}: {before.leader} in term {before.term} by {after}"

    @invariant()
    def nobody_is_displaced_that_leads_and_answers(self) -> None:
        assert not self.displaced

    @invariant()
    def one_robot_at_most_leads_in_a_term(self) -> None:
        assert all(len(robots) == 1 for robots in self.led_in.values()), self.led_in


def _fields(content: MissionContent) -> dict[str, object]:
    return {name: getattr(content, name) for name in content.__struct_fields__}


TestSuccession = Succession.TestCase
TestSuccession.settings = settings(max_examples=35, stateful_step_count=30, deadline=None)

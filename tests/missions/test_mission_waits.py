"""Leaders that are silent, and who or what is in the way of a mission: it waits, goes on, or ends for all."""

from __future__ import annotations

import math
import threading
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

import pytest
import shapely
from shapely import Point
from shapely.geometry.base import BaseGeometry

from robocorba.control.agent_state import AgentCondition
from robocorba.errors.robots import InTheWay, MissionTakenOver
from robocorba.errors.services import NotReachable
from robocorba.missions import way_ahead
from robocorba.missions.carry_progress import CATCH_UP_RATE
from robocorba.missions.lookout import Seen
from robocorba.missions.report import MissionReport
from robocorba.missions.subplan import Carry, CooperativePlan, Idle
from robocorba.missions.trajectory import Trajectory
from robocorba.planning.request import Place as Spot
from robocorba.programs.graphic_programming import ProgramBuilder
from tests.control.places import eventually
from tests.missions.crews import LEADING, RECOVERING, ROBOTS, free, leading, near
from tests.missions.crews import crew as crew
from tests.missions.crews import patient_crew as patient_crew
from tests.missions.crews import place as place
from tests.missions.places import Crew, Given
from tests.waits import work_for

pytestmark = pytest.mark.slow


def test_a_leader_of_which_another_has_taken_over_gives_up(crew: Crew) -> None:
    begun = []

    def begin(attempt: int) -> None:
        begun.append(attempt)
        if len(begun) == 2:
            raise MissionTakenOver("B", 2)

    failing = Given([Idle()], [near("B", 0.6, limit_s=0.01)])
    report = crew.leader("A", RECOVERING, begin_attempt=begin, attempts=4).lead("test", lambda: failing)
    assert report.reason.startswith("B has taken the mission over, in term 2; before: ")
    assert begun == [5, 6]
    eventually(lambda: free(crew), "all are free again")


def test_members_obey_the_leader_of_the_latest_term_only(crew: Crew) -> None:
    """C leads the same mission in a later term: B leaves A, and A finds nobody any more."""
    first = crew.leader("A", LEADING, mission="same")
    reports: list[MissionReport] = []
    given = Given([Idle()], [near("B", 1.5, 60.0)])
    thread = threading.Thread(target=lambda: reports.append(first.lead("test", lambda: given)))
    thread.start()
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    second = crew.leader("C", LEADING, mission="same", term=2, attempts=7)
    later = Given([Idle()], [Idle()])
    later.required = frozenset({"B"})
    report = second.lead("test", lambda: later)
    assert (report.result, report.reason) == ("done", "")
    thread.join(60.0)
    assert reports[0].result == "failed"
    again = crew.leader("A", LEADING, mission="same").lead("test", lambda: Given([Idle()], [Idle()]))
    assert again.reason == "1 helpers are needed; no robot offered to help"


def test_a_member_whose_leader_is_silent_may_take_over(crew: Crew) -> None:
    thread, _ = leading(crew, Given([Idle(), Idle()], [near("B", 1.5, 60.0), Idle()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    assert crew.orphaned == []
    crew.bus.disconnected = {"A"}
    eventually(lambda: crew.orphaned, "B is orphaned")
    assert [(robot, term) for robot, _, term in crew.orphaned] == [("B", 1)]
    thread.join(60.0)


def test_a_member_stops_while_its_leader_is_silent(patient_crew: Crew) -> None:
    crew, policy = patient_crew, replace(LEADING, member_timeout_s=60.0)
    thread, reports = leading(crew, Given([Idle()], [near("B", 1.5, 60.0)]), policy=policy)
    robot = crew.agents["B"]
    eventually(lambda: robot.state.actor.velocity[0] > 0.1, "moving")
    crew.bus.disconnected = {"A"}
    eventually(lambda: robot.state.condition is AgentCondition.PAUSED, "it waits for its leader")
    eventually(lambda: abs(math.hypot(*robot.state.actor.velocity[:2])) < 0.01, "and stands")
    crew.bus.disconnected = set()
    thread.join(60.0)
    assert (reports[0].result, reports[0].reason) == ("done", "")
    assert robot.place.x == pytest.approx(ROBOTS["B"].x + 1.5, abs=0.02)


# ---- the way is cleared ----


class InTheirWay(Given):
    """Needs the place of C first."""

    def __init__(self, aside: tuple[str, float, float] | None) -> None:
        super().__init__([near("A", 0.2)], [near("B", 0.2)])
        self._aside, self.staying = aside, list[set[str]]()

    def plan(
        self, mission: str, leader: str, robots: dict[str, Spot], staying: Collection[str] = ()
    ) -> CooperativePlan:
        self.staying.append(set(staying))
        if len(self.staying) == 1:
            raise InTheWay({"C": self._aside})
        return super().plan(mission, leader, {name: at for name, at in robots.items() if name != "C"}, staying)


def test_a_free_robot_steps_aside(crew: Crew) -> None:
    planner = InTheirWay(("L1", 1.6, 7.5))
    report = crew.leader("A").lead("test", lambda: planner)
    assert (report.result, report.reason) == ("done", "")
    assert planner.staying == [set(), set()]
    at = crew.agents["C"].place
    assert (at.x, at.y) == pytest.approx((1.6, 7.5), abs=0.02)
    assert report.phases[0].name == "clearing the way: C"
    assert crew.agents["C"].state.program.name.startswith("way for mission")
    eventually(lambda: free(crew), "all are free again")


def test_robots_that_cannot_step_aside_are_planned_around(crew: Crew) -> None:
    planner = InTheirWay(None)
    report = crew.leader("A").lead("test", lambda: planner)
    assert (report.result, report.reason) == ("done", "")
    assert planner.staying == [set(), {"C"}]


def test_a_robot_that_is_busy_stays(crew: Crew) -> None:
    builder = ProgramBuilder("long")
    builder.wait(60.0)
    crew.agents["C"].load(builder.program())
    crew.agents["C"].run()
    planner = InTheirWay(("L1", 1.6, 7.5))
    report = crew.leader("A").lead("test", lambda: planner)
    assert (report.result, report.reason) == ("done", "")
    assert planner.staying == [set(), {"C"}]
    crew.agents["C"].abort()
    eventually(lambda: free(crew), "all are free again")


class Carried(Given):
    """Two robots carry something 0.8 m wide eastwards; C steps aside to a place beside it."""

    def __init__(self) -> None:
        rows = Trajectory([(7.0, 3.0, 0.0), (8.6, 3.0, 0.0)]).to_rows()
        super().__init__([Carry(rows=rows, place=(0.0, -1.0, 0.0))], [Carry(rows=rows, place=(0.0, 1.0, 0.0))])

    @property
    def footprint(self) -> BaseGeometry:
        return shapely.box(-0.4, -1.3, 0.4, 1.3)

    def plan(
        self, mission: str, leader: str, robots: dict[str, Spot], staying: Collection[str] = ()
    ) -> CooperativePlan:
        return super().plan(mission, leader, {name: at for name, at in robots.items() if name != "C"}, staying)

    def aside(self, robot: str) -> Spot | None:
        return Spot("L1", 1.6, 7.5)


def test_a_carry_waits_for_what_is_in_its_way(crew: Crew) -> None:
    there = [Seen("C", True, Point(8.4, 3.0).buffer(0.3), 0.0, 0.0)]

    def look() -> list[Seen]:
        at = crew.agents["C"].place
        return there if math.dist((at.x, at.y), (1.6, 7.5)) > 0.05 else []

    report = crew.leader("A", look=look).lead("test", Carried)
    assert (report.result, report.reason) == ("done", "")
    assert [phase.name for phase in report.phases] == ["phase 0", "waiting: C is in the way", "phase 0"]
    for name, y in (("A", 2.0), ("B", 4.0)):
        at = crew.agents[name].place
        assert (at.x, at.y) == pytest.approx((8.6, y), abs=0.02)
    before, waiting, after = report.phases
    assert before.began < waiting.began < after.began
    assert set(before.done) == set(waiting.done) == set(after.done) == {"A", "B"}


def test_a_carry_that_can_not_see_its_way_says_so_in_one_phase(crew: Crew) -> None:
    lags = iter(f"the data pool lags by {lag:.2f} s" for lag in (0.4, 0.5, 0.6, 0.7))

    def look() -> list[Seen]:
        for lag in lags:
            raise NotReachable(lag)
        return []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(way_ahead, "UNKNOWN_S", 0.0)
        report = crew.leader("A", look=look).lead("test", Carried)
    assert (report.result, report.reason) == ("done", "")
    names = [phase.name for phase in report.phases]
    assert [name for name in names if name != "phase 0"] == ["waiting: what is in the way is unknown"]


def test_what_stays_in_the_way_ends_the_attempt(crew: Crew) -> None:
    chair = [Seen("chair", False, Point(8.4, 3.0).buffer(0.3), 0.0, 0.0)]
    policy = replace(LEADING, way_timeout_s=1.0)
    report = crew.leader("A", policy, look=lambda: chair).lead("test", Carried)
    assert report.result == "failed"
    assert report.reason == "carrying: chair is in the way at (8.40, 3.00)"
    assert crew.agents["A"].place.x < 8.1 - 0.4
    eventually(lambda: free(crew), "all are free again")


@pytest.mark.parametrize("is_cut_off", [False, True])
def test_a_carry_goes_on_from_where_it_stood_while_its_leader_was_silent(patient_crew: Crew, is_cut_off: bool) -> None:
    """Its process stands still for 2 s, or its messages are lost for that time; no setpoint jumps."""
    crew, is_over = patient_crew, threading.Event()

    def look() -> list[Seen]:
        if crew.agents["A"].place.x > 7.3 and not is_over.is_set():
            is_over.set()
            if is_cut_off:
                crew.bus.disconnected = {"A"}
                threading.Timer(2.0, lambda: setattr(crew.bus, "disconnected", set())).start()
            else:
                work_for(2.0)
        return []

    report = crew.leader("A", replace(LEADING, member_timeout_s=60.0), look=look).lead("test", Carried)
    assert (report.result, report.reason) == ("done", "")
    for name in "AB":
        ticks = report.measurements[name].ticks
        steps = [(later[0] - former[0], later[1] - former[1]) for former, later in pairwise(ticks)]
        assert max(moved_s - CATCH_UP_RATE * passed_s for passed_s, moved_s in steps) < 0.01
        stood_s = sum(passed_s for passed_s, moved_s in steps if moved_s < 0.1 * passed_s)
        assert stood_s > 1.0

"""Leaders and members in one process: agreement, synchronized steps, failures, and what is in the way."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import chain, pairwise, repeat
from typing import ClassVar

import pytest
import shapely
from shapely import Point
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import InTheWay, MissionFailed
from robocorba.errors.services import NotReachable
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import Pose
from robocorba.missions.carry_progress import CATCH_UP_RATE
from robocorba.missions.cooperative_planner import ReserveOneOf
from robocorba.missions.leader_areas import LeaderAreas
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.lookout import Look, Seen
from robocorba.missions.member import MemberPolicy
from robocorba.missions.recorder import LedMission
from robocorba.missions.report import MissionReport
from robocorba.missions.subplan import Approach, Carry, CooperativePlan, Idle
from robocorba.missions.trajectory import Trajectory
from robocorba.planning.request import Place as Spot
from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.collision_avoidance.policy import GivingWayPolicy
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from tests.missions.places import Crew, Given
from tests.robot.places import Place, eventually
from tests.waits import patient

pytestmark = pytest.mark.slow

ROBOTS = {"A": Pose("L1", 7.0, 2.0), "B": Pose("L1", 7.0, 4.0), "C": Pose("L1", 1.0, 8.0)}
#: Shorter than usual, as the tests wait for them.
LEADING = patient(
    LeaderPolicy(
        agreement_timeout_s=6.0,
        max_retry_pause_s=0.5,
        offer_timeout_s=1.0,
        surplus_offer_timeout_s=0.3,
        member_timeout_s=1.5,
        step_grace_s=1.0,
        end_timeout_s=12.0,
        max_recoveries=0,
    )
)
RECOVERING = replace(LEADING, max_recoveries=2, recovery_timeout_s=15.0)
#: The arms stay where they begin.
TAKING_PART = patient(
    MemberPolicy(leader_timeout_s=1.5, end_order_timeout_s=3.0, final_state_s=0.5, driving_posture="home")
)
#: Missions that end after a minute of silence.
PATIENT_PART = MemberPolicy(leader_timeout_s=60.0, driving_posture="home")
PATIENT = replace(LEADING, member_timeout_s=60.0)
GIVING_WAY = GivingWayPolicy(max_search_s=2.0, blocked_by_parked_s=0.2, blocked_by_later_s=1.0)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("place"))
    yield place
    place.close()


@pytest.fixture
def crew(place: Place, request: pytest.FixtureRequest) -> Iterator[Crew]:
    """param: the policy of members."""
    crew = Crew(place, ROBOTS, LEADING, getattr(request, "param", TAKING_PART), GIVING_WAY)
    yield crew
    crew.bus.disconnected = set()
    crew.close()


def near(name: str, dx: float, limit_s: float = 30.0) -> Approach:
    at = ROBOTS[name]
    return Approach(x=at.x + dx, y=at.y, heading=0.0, limit_s=limit_s)


def leading(
    crew: Crew, *planners: Given, name: str = "A", policy: LeaderPolicy = LEADING, led: type[LedMission] = LedMission
) -> tuple[threading.Thread, list[MissionReport]]:
    """A mission in a thread of its own. planners: of its attempts, in turn."""
    reports: list[MissionReport] = []
    leader, left = crew.leader(name, policy, led=led), iter(planners)
    thread = threading.Thread(target=lambda: reports.append(leader.lead("test", lambda: next(left))))
    thread.start()
    return thread, reports


def occupy(crew: Crew, *names: str) -> None:
    """Let robots run a program."""
    for name in names:
        crew.agents[name].load(ProgramBuilder("busy").wait(60).program())
        crew.agents[name].run()


def done(crew: Crew, planner: Given, policy: LeaderPolicy = LEADING, look: Look = lambda: ()) -> MissionReport:
    """The report of a mission that A leads to its end."""
    report = crew.leader("A", policy, look).lead("test", lambda: planner)
    assert (report.result, report.reason) == ("done", "")
    return report


def are_free(crew: Crew) -> None:
    eventually(lambda: all(agent.is_free for agent in crew.agents.values()), "all are free again")


def has_come_to(crew: Crew, name: str, x: float, y: float) -> None:
    assert crew.agents[name].place[1:3] == pytest.approx((x, y), abs=0.02)


def test_steps_are_synchronized_and_reported(crew: Crew) -> None:
    planner = Given([near("A", 0.2), Idle()], [near("B", 0.1), Idle()], [Idle(), Idle()])
    report = done(crew, planner)
    first, second = report.phases
    assert set(first.started) == set(second.done) == {"A", "B", "C"}
    assert min(second.started.values()) >= max(first.done.values())
    assert set(report.measurements) == {"A", "B", "C"}
    found = report.as_json()
    assert found["robots"] == {"A": "leader", "B": "helper", "C": "helper"}
    assert found["phases"][0]["waited_for"] == "A"
    assert found["latency_ms"]["bus"]["count"] > 10
    are_free(crew)
    assert crew.agents["B"].state.program.result is ProgramResult.DONE


def test_busy_robots_are_waited_for_and_those_that_do_not_exist_are_not(crew: Crew) -> None:
    occupy(crew, "B")
    for helpers in (2, 3):
        begun = time.monotonic()
        report = crew.leader("A").lead("test", lambda helpers=helpers: Given(*[[Idle()]] * (1 + helpers)))
        assert report.result == "failed"
        assert report.reason == f"{helpers} helpers are needed; C offered to help; B runs a program"
        assert (time.monotonic() - begun > LEADING.agreement_timeout_s) is (helpers == 2)
    crew.agents["B"].abort()
    assert crew.agents["A"].place == pytest.approx(ROBOTS["A"])


def test_the_nearest_robots_are_the_candidates(crew: Crew) -> None:
    near_c = Given([Idle()], [Idle()])
    near_c.meeting_point = Spot(*ROBOTS["C"][:3])
    report = done(crew, near_c, replace(LEADING, spare_candidates=0))
    assert set(report.measurements) == {"A", "C"}


def test_leaders_that_need_the_same_robot_get_it_in_turn(crew: Crew) -> None:
    """Both need C and no other robot is free: the second leader waits until the first mission has ended."""
    occupy(crew, "A", "B")
    ways = (("A", 0.2), ("B", -0.2))
    started = [leading(crew, *[Given([Idle()], [near("C", dx)])] * 20, name=name) for name, dx in ways]
    for thread, _ in started:
        thread.join(60.0)
    reports = [found for _, (found,) in started]
    assert [(report.result, report.reason) for report in reports] == [("done", "")] * 2
    first, second = sorted(reports, key=lambda report: report.phases[0].began)
    assert {subplan.robot for report in reports if report.plan for subplan in report.plan.subplans} == {"A", "B", "C"}
    assert second.phases[0].started["C"] > first.phases[-1].done["C"]


class Reserving(Given):
    """It needs the whole floor."""

    AREA: FloorArea = ("L1", ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)))

    def reserve(self, reserve: ReserveOneOf, staying: Collection[str] = ()) -> None:
        reserve([[self.AREA]], 60.0)


class Phases(LedMission):
    """names: of the phases of the latest mission."""

    names: ClassVar[list[str]] = []

    def update(self, plan: CooperativePlan | None, is_ending: bool = False) -> None:
        super().update(plan, is_ending)
        self.names[:] = [phase.name for phase in self.phases]


def test_a_mission_that_waits_for_its_areas_keeps_no_robot_from_others(crew: Crew) -> None:
    """B has what A's mission needs, and both need C: B's gets C, though A was the first one."""
    occupy(crew, "A", "B")
    areas = LeaderAreas(crew.agents["B"].robot.session)
    assert areas.request([[Reserving.AREA]], 60.0) == 0
    planners = [Reserving([Idle()], [near("C", 0.2)]) for _ in range(2)]
    first, reports = leading(crew, *planners, led=Phases)
    eventually(lambda: Phases.names == ["waiting for areas"], 60.0)
    helped, others = leading(crew, Reserving([Idle()], [near("C", -0.2)]), name="B")
    helped.join(60.0)
    assert (others[0].result, others[0].reason) == ("done", "")
    first.join(60.0)  # the other mission has given its areas back
    assert (reports[0].result, reports[0].reason) == ("done", "")
    assert Phases.names == ["waiting for areas", "asking", "phase 0"]
    assert crew.agents["A"].robot.session.reservation() is None


def test_a_mission_that_waits_for_its_areas_can_be_aborted(crew: Crew) -> None:
    blocking = LeaderAreas(crew.agents["B"].robot.session)
    blocking.request([[Reserving.AREA]], 60.0)
    thread, reports = leading(crew, Reserving([Idle()], [Idle()]), led=Phases)
    eventually(lambda: Phases.names == ["waiting for areas"], 60.0)
    crew.agents["A"].robot.execution.abort()
    thread.join(60.0)
    assert (reports[0].result, reports[0].reason) == ("failed", "it was aborted")
    assert crew.agents["A"].robot.session.reservation() is None
    blocking.release()


# ---- after a fault ----


def test_it_is_not_tried_again_after_an_emergency_stop(crew: Crew) -> None:
    thread, reports = leading(crew, Given([Idle()], [near("B", 1.5)]), policy=RECOVERING)
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.agents["B"].stop()
    thread.join(60.0)
    assert reports[0].faults == ()
    assert reports[0].reason.startswith("phase 0: B at L1 (")
    assert reports[0].reason.endswith("emergency stop")
    eventually(lambda: crew.agents["A"].is_free, "the others are free")


def test_attempts_and_steps_are_bounded_and_a_leader_waits_for_servers_that_are_away(crew: Crew) -> None:
    failing = Given([Idle()], [near("B", 0.6, limit_s=0.01)])
    report = crew.leader("A", RECOVERING).lead("test", lambda: failing)
    assert report.result == "failed"
    assert len(report.faults) == RECOVERING.max_recoveries
    assert report.reason.endswith(f", at attempt {len(report.faults) + 1}")  # all were of one kind
    assert "phase 0 took longer than 0.01 s" in report.faults[0]
    are_free(crew)
    failing, then = Given([Idle()], [near("B", 0.6, limit_s=0.01)]), Given([Idle()], [Idle()])
    answers = iter([failing, NotReachable("the map editor does not answer"), then])
    others: Iterator[Given | Exception] = chain([failing], repeat(MissionFailed("impossible")))

    def make(answers: Iterator[Given | Exception] = answers) -> Given:
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    assert crew.leader("A", RECOVERING).lead("test", make).result == "done"
    report = crew.leader("A", RECOVERING).lead("test", lambda: make(others))
    assert report.reason == f"impossible, at attempt 2; before: {'; '.join(report.faults)}"


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
    report = done(crew, planner)
    assert planner.staying == [set(), set()]
    has_come_to(crew, "C", 1.6, 7.5)
    assert report.phases[0].name == "clearing the way: C"
    assert crew.agents["C"].state.program.name.startswith("way for mission")
    are_free(crew)


@pytest.mark.parametrize("is_busy", [False, True])
def test_the_mission_is_planned_around_a_robot_that_is_busy_or_has_no_room(crew: Crew, is_busy: bool) -> None:
    if is_busy:
        occupy(crew, "C")
    planner = InTheirWay(("L1", 1.6, 7.5) if is_busy else None)
    done(crew, planner)
    assert planner.staying == [set(), {"C"}]
    crew.agents["C"].abort()
    are_free(crew)


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


def test_carriers_move_simultaneously_and_wait_for_what_is_in_their_way(crew: Crew) -> None:
    there = [Seen("C", True, Point(8.4, 3.0).buffer(0.3), 0.0, 0.0)]
    shown: set[str] = set()

    def look() -> list[Seen]:
        shown.add(crew.agents["B"].display.text)
        at = crew.agents["C"].place
        return there if math.dist((at.x, at.y), (1.6, 7.5)) > 0.05 else []

    report = done(crew, Carried(), look=look)
    assert [phase.name for phase in report.phases] == ["phase 0", "waiting: C is in the way", "phase 0"]
    has_come_to(crew, "A", 8.6, 2.0)
    has_come_to(crew, "B", 8.6, 4.0)
    skew = report.as_json()["tick_skew_ms"]
    assert skew["count"] > 50 and skew["max"] < 100
    before, waiting, after = report.phases
    assert before.began < waiting.began < after.began
    assert set(before.done) == set(waiting.done) == set(after.done) == {"A", "B"}
    assert "waiting for a free way: C is in the way" in shown, shown


def test_a_carry_that_can_not_see_its_way_says_so_in_one_phase(crew: Crew) -> None:
    lags = iter(f"the data pool lags by {lag:.2f} s" for lag in (0.4, 0.5, 0.6, 0.7))

    def look() -> list[Seen]:
        for lag in lags:
            raise NotReachable(lag)
        return []

    report = done(crew, Carried(), replace(LEADING, unknown_timeout_s=0.0), look=look)
    names = [phase.name for phase in report.phases]
    assert [name for name in names if name != "phase 0"] == ["waiting: what is in the way is unknown"]


def test_what_stays_in_the_way_ends_the_attempt(crew: Crew) -> None:
    chair = [Seen("chair", False, Point(8.4, 3.0).buffer(0.3), 0.0, 0.0)]
    policy = replace(LEADING, way_timeout_s=1.0)
    report = crew.leader("A", policy, look=lambda: chair).lead("test", Carried)
    assert report.result == "failed"
    assert report.reason == "carrying: chair is in the way at (8.40, 3.00)"
    assert crew.agents["A"].place.x < 8.1 - 0.4
    are_free(crew)


@pytest.mark.parametrize("crew", [PATIENT_PART], indirect=True)
def test_a_carry_goes_on_from_where_it_stood_while_its_leader_was_silent(crew: Crew) -> None:
    """Its messages are lost for 2 s; no setpoint jumps."""
    is_over = threading.Event()

    def look() -> list[Seen]:
        if crew.agents["A"].place.x > 7.3 and not is_over.is_set():
            is_over.set()
            crew.bus.disconnected = {"A"}
            threading.Timer(2.0, lambda: setattr(crew.bus, "disconnected", set())).start()
        return []

    report = done(crew, Carried(), PATIENT, look=look)
    for name in "AB":
        ticks = report.measurements[name].ticks
        steps = [(later[0] - former[0], later[1] - former[1]) for former, later in pairwise(ticks)]
        assert max(moved_s - CATCH_UP_RATE * passed_s for passed_s, moved_s in steps) < 0.01
        stood_s = sum(passed_s for passed_s, moved_s in steps if moved_s < 0.1 * passed_s)
        assert stood_s > 1.0

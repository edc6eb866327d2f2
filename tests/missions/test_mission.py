"""Leaders and members in one process: agreement, synchronized steps, and failures of missions."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Sequence
from dataclasses import replace

import pytest

from robocorba.control.agent_state import ProgramResult
from robocorba.errors.robots import GoalReached
from robocorba.errors.services import NotReachable
from robocorba.maps.polygons import FloorArea
from robocorba.missions.cooperative_planner import ReserveOneOf
from robocorba.missions.leader_areas import LeaderAreas
from robocorba.missions.report import PhaseTimes
from robocorba.missions.subplan import Approach, Carry, CooperativePlan, Gather, Idle
from robocorba.missions.trajectory import Trajectory
from robocorba.planning.request import Place as Spot
from robocorba.programs.graphic_programming import ProgramBuilder
from tests.control.places import eventually
from tests.missions.crews import FAR, LEADING, RECOVERING, ROBOTS, free, leading, near
from tests.missions.crews import crew as crew
from tests.missions.crews import place as place
from tests.missions.places import Crew, Given

pytestmark = pytest.mark.slow


def test_steps_are_synchronized(crew: Crew) -> None:
    report = crew.leader("A").lead(
        "test", lambda: Given([near("A", 0.2), Idle()], [near("B", 0.1), Idle()], [Idle(), Idle()])
    )
    assert (report.result, report.reason) == ("done", "")
    assert [phase.name for phase in report.phases] == ["phase 0", "phase 1"]
    first, second = report.phases
    assert set(first.started) == set(second.done) == {"A", "B", "C"}
    assert min(second.started.values()) >= max(first.done.values())
    assert set(report.measurements) == {"A", "B", "C"}
    found = report.as_json()
    assert found["robots"] == {"A": "leader", "B": "helper", "C": "helper"}
    assert found["phases"][0]["waited_for"] == "A"
    assert found["latency_ms"]["bus"]["count"] > 10
    eventually(lambda: free(crew), "all are free again")
    assert crew.agents["B"].state.program.result is ProgramResult.DONE
    again = crew.leader("B").lead("test", lambda: Given([Idle()], [Idle()]))
    assert again.result == "done"


def test_progress_is_reported(crew: Crew) -> None:
    seen: list[tuple[tuple[str, int], ...]] = []
    endings: list[bool] = []

    def note(plan: CooperativePlan, phases: Sequence[PhaseTimes], is_ending: bool) -> None:
        seen.append(tuple((phase.name, len(phase.done)) for phase in phases))
        endings.append(is_ending)

    given = Given([Idle(), Idle()], [Idle(), near("B", 0.1)])
    report = crew.leader("A", on_progress=note).lead("test", lambda: given)
    assert (report.result, report.reason) == ("done", "")
    assert seen[0] == ()
    assert seen[-1] == (("phase 0", 2), ("phase 1", 2))
    assert (("phase 0", 2), ("phase 1", 1)) in seen
    assert not any(endings)
    eventually(lambda: free(crew), "all are free again")
    crew.agents["B"].robot.execution.reset(False)
    failing = Given([Idle()], [near("B", 0.6, limit_s=0.01)])
    assert crew.leader("A", on_progress=note).lead("test", lambda: failing).result == "failed"
    assert endings[-1]


def test_carriers_move_simultaneously(crew: Crew) -> None:
    rows = Trajectory([(7.0, 3.0, 0.0), (7.4, 3.0, 0.0)]).to_rows()
    own = Carry(rows=rows, place=(0.0, -1.0, 0.0))
    other = Carry(rows=rows, place=(0.0, 1.0, 0.0))
    report = crew.leader("A").lead("test", lambda: Given([own], [other]))
    assert (report.result, report.reason) == ("done", "")
    for name, y in (("A", 2.0), ("B", 4.0)):
        at = crew.agents[name].place
        assert (at.x, at.y) == pytest.approx((7.4, y), abs=0.02)
    skew = report.as_json()["tick_skew_ms"]
    assert skew["count"] > 50
    assert skew["max"] < 100


def test_a_gathering_robot_drives_around_a_stationary_one(crew: Crew) -> None:
    crew.agents["A"].cap_speed(1.0)
    beyond = Gather(floor="L1", x=7.0, y=4.9, heading=0.0)  # beyond B, which is stationary
    report = crew.leader("A").lead("test", lambda: Given([beyond], [Idle()]))
    assert (report.result, report.reason) == ("done", "")
    assert crew.agents["A"].place[:3] == pytest.approx(("L1", 7.0, 4.9), abs=0.02)
    assert crew.agents["B"].place == pytest.approx(ROBOTS["B"])
    assert crew.place.agent.collisions == 0


def test_a_blocked_robot_retries(crew: Crew) -> None:
    crew.agents["A"].cap_speed(1.0)
    beside = Gather(floor="L1", x=7.0, y=4.3, heading=0.0)  # B's place, until it leaves
    report = crew.leader("A").lead("test", lambda: Given([beside], [near("B", 1.2)]))
    assert (report.result, report.reason) == ("done", "")


def test_a_busy_robot_is_not_assigned(crew: Crew) -> None:
    crew.agents["B"].load(ProgramBuilder("busy").wait(60).program())
    crew.agents["B"].run()
    begun = time.monotonic()
    report = crew.leader("A").lead("test", lambda: Given([Idle()], [Idle()], [Idle()]))
    assert report.result == "failed"
    assert report.reason == "2 helpers are needed; C offered to help; B runs a program"
    assert time.monotonic() - begun > LEADING.agreement_timeout_s
    crew.agents["B"].abort()
    assert crew.agents["A"].place == pytest.approx(ROBOTS["A"])


def test_the_leader_does_not_wait_for_robots_that_do_not_exist(crew: Crew) -> None:
    begun = time.monotonic()
    report = crew.leader("A").lead("test", lambda: Given([Idle()], [Idle()], [Idle()], [Idle()]))
    assert report.reason == "3 helpers are needed; B, C offered to help"
    assert time.monotonic() - begun < LEADING.agreement_timeout_s


def test_the_nearest_robots_are_the_candidates(crew: Crew) -> None:
    near_c = Given([Idle()], [Idle()])
    near_c.meeting_point = Spot(*ROBOTS["C"][:3])
    report = crew.leader("A", replace(LEADING, spare_candidates=0)).lead("test", lambda: near_c)
    assert report.result == "done"
    assert set(report.measurements) == {"A", "C"}


def test_leaders_that_need_the_same_robot_get_it_in_turn(crew: Crew) -> None:
    """Both need C and no other robot is free: the second leader waits until the first mission has ended."""
    for name in "AB":
        crew.agents[name].load(ProgramBuilder("leads").wait(60).program())
        crew.agents[name].run()
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

    def reserve(self, reserve: ReserveOneOf, staying: Collection[str] = ()) -> bool:
        return reserve([[self.AREA]], 60.0).waited


def test_a_mission_that_waits_for_its_areas_keeps_no_robot_from_others(crew: Crew) -> None:
    """B has what A's mission needs, and both need C: B's gets C, though A was the first one."""
    for name in "AB":
        crew.agents[name].load(ProgramBuilder("leads").wait(60).program())
        crew.agents[name].run()
    areas = LeaderAreas(crew.agents["B"].robot.session)
    assert areas.request([[Reserving.AREA]], 60.0) == 0
    planners = [Reserving([Idle()], [near("C", 0.2)]) for _ in range(2)]
    phases: list[str] = []

    def note(plan: CooperativePlan | None, times: Sequence[PhaseTimes], is_ending: bool) -> None:
        phases[:] = [phase.name for phase in times]

    first, reports = leading(crew, *planners, on_progress=note)
    eventually(lambda: phases == ["waiting for areas"], 60.0)
    helped, others = leading(crew, Reserving([Idle()], [near("C", -0.2)]), name="B")
    helped.join(60.0)
    assert (others[0].result, others[0].reason) == ("done", "")
    first.join(60.0)  # the other mission has given its areas back
    assert (reports[0].result, reports[0].reason) == ("done", "")
    assert phases == ["waiting for areas", "asking", "phase 0"]
    assert crew.agents["A"].robot.session.reservation() is None


def test_a_mission_that_waits_for_its_areas_can_be_aborted(crew: Crew) -> None:
    blocking = LeaderAreas(crew.agents["B"].robot.session)
    blocking.request([[Reserving.AREA]], 60.0)
    planner, phases = Reserving([Idle()], [Idle()]), list[str]()
    thread, reports = leading(crew, planner, on_progress=lambda plan, times, ending: phases.append(times[-1].name))
    eventually(lambda: phases == ["waiting for areas"], 60.0)
    crew.agents["A"].robot.execution.abort()
    thread.join(60.0)
    assert (reports[0].result, reports[0].reason) == ("failed", "it was aborted")
    assert crew.agents["A"].robot.session.reservation() is None
    blocking.release()


def test_a_failed_step_ends_the_mission_for_all(crew: Crew) -> None:
    blocked = Approach(x=5.0, y=4.6, heading=0.0)  # through the elevator's wall
    report = crew.leader("A").lead("test", lambda: Given([near("A", 0.3), Idle()], [blocked, Idle()]))
    assert report.result == "failed"
    assert report.reason.startswith("phase 0: B at L1 (6.")
    eventually(lambda: free(crew), "all are free again")


def test_an_emergency_stop_of_a_member_ends_the_mission(crew: Crew) -> None:
    thread, reports = leading(crew, Given([Idle(), Idle()], [near("B", 1.5), Idle()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.agents["B"].stop()
    thread.join(60.0)
    assert reports[0].result == "failed"
    assert reports[0].reason.startswith("phase 0: B at L1 (")
    assert reports[0].reason.endswith("emergency stop")
    eventually(lambda: crew.agents["A"].is_free, "the others are free")


def test_a_disconnected_helper_ends_the_mission_for_all(crew: Crew) -> None:
    thread, reports = leading(crew, Given([FAR, Idle()], [near("B", 1.5, 60.0), Idle()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.bus.disconnected = {"B"}
    thread.join(60.0)
    assert reports[0].reason == "phase 0: B is silent"
    eventually(lambda: free(crew), "all have ended, each for itself")
    assert crew.agents["B"].state.program.reason in ("the leader A is silent", "it was aborted")
    assert all(abs(math.hypot(*agent.state.actor.velocity)) < 0.01 for agent in crew.agents.values())


def test_members_stop_without_their_leader(crew: Crew) -> None:
    thread, _ = leading(crew, Given([Idle(), Idle()], [near("B", 1.5, 60.0), Idle()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.bus.disconnected = {"A"}
    eventually(lambda: crew.agents["B"].is_free, "B has ended")
    assert crew.agents["B"].state.program.reason == "the leader A is silent"
    thread.join(60.0)


def test_a_step_that_exceeds_its_limit_ends_the_mission(crew: Crew) -> None:
    begun = time.monotonic()
    report = crew.leader("A").lead(
        "test", lambda: Given([Idle()], [Gather(floor="L1", x=9.0, y=9.0, heading=0.0, limit_s=1.0)])
    )
    assert "phase 0 took longer than 1 s" in report.reason
    assert time.monotonic() - begun < 30.0
    eventually(lambda: free(crew), "all are free again")


def test_an_interrupted_leader_ends_the_mission(crew: Crew) -> None:
    thread, reports = leading(crew, Given([Idle(), Idle()], [near("B", 1.5, 60.0), Idle()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.agents["A"].robot.execution.abort("enough")
    thread.join(60.0)
    assert "enough" in reports[0].reason
    eventually(lambda: free(crew), "all are free again")


# ---- after a fault ----


def test_a_silent_helper_is_replaced(crew: Crew) -> None:
    planners = (
        Given([Idle(), Idle()], [near("B", 1.5, 60.0), Idle()]),
        Given([Idle(), Idle()], [near("C", 0.1), Idle()]),
    )
    thread, reports = leading(crew, *planners, policy=RECOVERING)
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.bus.disconnected = {"B"}
    thread.join(120.0)
    (report,) = reports
    assert (report.result, report.reason) == ("done", "")
    assert report.faults == ("phase 0: B is silent",)
    assert report.plan and {subplan.robot for subplan in report.plan.subplans} == {"A", "C"}
    assert [phase.name for phase in report.phases] == ["phase 0", "recovering", "phase 0", "phase 1"]
    assert report.as_json()["faults"] == ["phase 0: B is silent"]


def test_a_failed_step_is_tried_again_from_where_all_are(crew: Crew) -> None:
    planners = [Given([Idle()], [near("B", 0.6, limit_s=0.01)]), Given([Idle()], [near("B", 0.1)])]
    made = iter(planners)
    report = crew.leader("A", RECOVERING).lead("test", lambda: next(made))
    assert report.result == "done"
    assert len(report.faults) == 1


def test_attempts_are_bounded(crew: Crew) -> None:
    failing = Given([Idle()], [near("B", 0.6, limit_s=0.01)])
    report = crew.leader("A", RECOVERING).lead("test", lambda: failing)
    assert report.result == "failed"
    assert len(report.faults) == RECOVERING.max_recoveries
    assert report.reason.endswith(f"; before: {'; '.join(report.faults)}")
    eventually(lambda: free(crew), "all are free again")


def test_it_is_not_tried_again_after_an_emergency_stop(crew: Crew) -> None:
    thread, reports = leading(crew, Given([Idle()], [near("B", 1.5)]), policy=RECOVERING)
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.agents["B"].stop()
    thread.join(60.0)
    assert reports[0].faults == ()
    assert reports[0].reason.endswith("emergency stop")


def test_a_leader_waits_for_servers_that_are_away_after_a_fault(crew: Crew) -> None:
    failing, then = Given([Idle()], [near("B", 0.6, limit_s=0.01)]), Given([Idle()], [Idle()])
    answers = iter([failing, NotReachable("the map editor does not answer"), then])

    def make() -> Given:
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    assert crew.leader("A", RECOVERING).lead("test", make).result == "done"


def test_what_has_reached_its_goal_before_a_fault_needs_no_further_attempt(crew: Crew) -> None:
    planners = iter([Given([Idle()], [near("B", 0.6, limit_s=0.01)])])

    def make() -> Given:
        for planner in planners:
            return planner
        raise GoalReached("the desk is at its goal")

    report = crew.leader("A", RECOVERING).lead("test", make)
    assert (report.result, report.reason) == ("done", "")
    assert [phase.name for phase in report.phases] == ["phase 0", "recovering"]
    eventually(lambda: free(crew), "all are free again")

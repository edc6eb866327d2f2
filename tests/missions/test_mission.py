"""Leaders and members in one process: agreement, steps in time, and ways in which a mission can come to nothing."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from robocorba.collision_avoidance import giving_way
from robocorba.control import base
from robocorba.control.runner import ProgramResult
from robocorba.kinematics.tasks import POSTURES
from robocorba.missions import leader, member, mission_agent
from robocorba.missions.leader import MissionReport
from robocorba.missions.record import as_json
from robocorba.missions.subplan import Approach, Carry, Gather, Wait
from robocorba.missions.trajectory import Trajectory
from robocorba.motion import driving
from robocorba.planning.request import Place as Spot
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.simulation.registry import Pose
from tests.control.places import Place, eventually
from tests.missions.places import Bus, Crew, Given

ROBOTS = {"A": Pose("L1", 7.0, 2.0), "B": Pose("L1", 7.0, 4.0), "C": Pose("L1", 1.0, 8.0)}
FAR = Approach(x=9.0, y=2.0, heading=0.0)
#: What the tests wait for is as it is, but shorter, s.
SHORTER = {
    leader: {
        "AGREEMENT_TIMEOUT_S": 6.0,
        "MAX_RETRY_PAUSE_S": 0.5,
        "OFFER_TIMEOUT_S": 1.0,
        "SURPLUS_OFFER_TIMEOUT_S": 0.3,
        "MEMBER_TIMEOUT_S": 1.5,
        "STEP_GRACE_S": 1.0,
        "END_TIMEOUT_S": 12.0,
    },
    member: {"LEADER_TIMEOUT_S": 1.5, "END_ORDER_TIMEOUT_S": 3.0},
    mission_agent: {"FINAL_STATE_S": 0.5},
    base: {"MAX_PAUSE_S": 2.0},
    giving_way: {"BLOCKED_BY_PARKED_S": 0.2, "BLOCKED_BY_LATER_S": 1.0},
    driving: {"STUCK_S": 1.0},
}


@pytest.fixture(autouse=True)
def shorter(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, constants in SHORTER.items():
        for name, seconds in constants.items():
            assert hasattr(module, name)
            monkeypatch.setattr(module, name, seconds)
    monkeypatch.setitem(POSTURES, "tuck", np.zeros(len(POSTURES["tuck"])))  # arms are where they begin


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("place"))
    yield place
    place.close()


@pytest.fixture
def crew(place: Place) -> Iterator[Crew]:
    crew = Crew(place, Bus(), ROBOTS)
    yield crew
    crew.bus.cut = set()
    crew.close()


def near(name: str, dx: float, limit_s: float = 30.0) -> Approach:
    at = ROBOTS[name]
    return Approach(x=at.x + dx, y=at.y, heading=0.0, limit_s=limit_s)


def leading(crew: Crew, expansion: Given, name: str = "A") -> tuple[threading.Thread, list[MissionReport]]:
    reports: list[MissionReport] = []
    leader = crew.leader(name)
    thread = threading.Thread(target=lambda: reports.append(leader.lead("test", expansion)))
    thread.start()
    return thread, reports


def free(crew: Crew) -> bool:
    return all(agent.is_free for agent in crew.agents.values())


def test_all_steps_are_done_together(crew: Crew) -> None:
    report = crew.leader("A").lead("test", Given([near("A", 0.2), Wait()], [near("B", 0.1), Wait()], [Wait(), Wait()]))
    assert (report.result, report.reason) == ("done", "")
    assert [phase.name for phase in report.phases] == ["phase 0", "phase 1"]
    first, second = report.phases
    assert set(first.started) == set(second.done) == {"A", "B", "C"}
    assert min(second.started.values()) >= max(first.done.values())
    assert set(report.records) == {"A", "B", "C"}
    found = as_json(report)
    assert found["robots"] == {"A": "leader", "B": "helper", "C": "helper"}
    assert found["phases"][0]["waited_for"] == "A"
    assert found["latency_ms"]["bus"]["count"] > 10
    eventually(lambda: free(crew), "all are free again")
    assert crew.agents["B"].state.program.result is ProgramResult.DONE
    again = crew.leader("B").lead("test", Given([Wait()], [Wait()]))
    assert again.result == "done"


def test_carriers_follow_one_rhythm(crew: Crew) -> None:
    rows = Trajectory([(7.0, 3.0, 0.0), (7.4, 3.0, 0.0)]).to_rows()
    own = Carry(rows=rows, place=(0.0, -1.0, 0.0))
    other = Carry(rows=rows, place=(0.0, 1.0, 0.0))
    report = crew.leader("A").lead("test", Given([own], [other]))
    assert (report.result, report.reason) == ("done", "")
    for name, y in (("A", 2.0), ("B", 4.0)):
        at = crew.agents[name].place
        assert (at.x, at.y) == pytest.approx((7.4, y), abs=0.02)
    skew = as_json(report)["tick_skew_ms"]
    assert skew["count"] > 50
    assert skew["max"] < 100


def test_who_gathers_goes_around_who_stands(crew: Crew) -> None:
    crew.agents["A"].cap_speed(1.0)
    beyond = Gather(floor="L1", x=7.0, y=4.9, heading=0.0)  # of B, who stands
    report = crew.leader("A").lead("test", Given([beyond], [Wait()]))
    assert (report.result, report.reason) == ("done", "")
    assert crew.agents["A"].place[:3] == pytest.approx(("L1", 7.0, 4.9), abs=0.02)
    assert crew.agents["B"].place == pytest.approx(ROBOTS["B"])
    assert crew.place.agent.collisions == 0


def test_who_gets_stuck_tries_again(crew: Crew) -> None:
    crew.agents["A"].cap_speed(1.0)
    beside = Gather(floor="L1", x=7.0, y=4.3, heading=0.0)  # where B stands, until it leaves
    report = crew.leader("A").lead("test", Given([beside], [near("B", 1.2)]))
    assert (report.result, report.reason) == ("done", "")


def test_nobody_is_booked_twice(crew: Crew) -> None:
    crew.agents["B"].load(ProgramBuilder("busy").wait(60).program())
    crew.agents["B"].run()
    begun = time.monotonic()
    report = crew.leader("A").lead("test", Given([Wait()], [Wait()], [Wait()]))
    assert report.result == "failed"
    assert report.reason == "2 helpers are needed; C offered to help; B runs a program"
    assert time.monotonic() - begun > leader.AGREEMENT_TIMEOUT_S
    crew.agents["B"].abort()
    assert crew.agents["A"].place == pytest.approx(ROBOTS["A"])


def test_who_is_not_there_is_not_waited_for(crew: Crew) -> None:
    begun = time.monotonic()
    report = crew.leader("A").lead("test", Given([Wait()], [Wait()], [Wait()], [Wait()]))
    assert report.reason == "3 helpers are needed; B, C offered to help"
    assert time.monotonic() - begun < leader.AGREEMENT_TIMEOUT_S


def test_only_the_nearest_are_looked_at(crew: Crew, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leader, "SPARE_CANDIDATES", 0)
    near_c = Given([Wait()], [Wait()])
    near_c.meeting_point = Spot(*ROBOTS["C"][:3])
    report = crew.leader("A").lead("test", near_c)
    assert report.result == "done"
    assert set(report.records) == {"A", "C"}


def test_leaders_that_want_the_same_robots_have_them_in_turn(crew: Crew) -> None:
    """Both need C and nobody else is free: whoever comes second waits until the first mission has ended."""
    for name in "AB":
        crew.agents[name].load(ProgramBuilder("leads").wait(60).program())
        crew.agents[name].run()
    started = [leading(crew, Given([Wait()], [near("C", way)]), name) for name, way in (("A", 0.2), ("B", -0.2))]
    for thread, _ in started:
        thread.join(60.0)
    reports = [found for _, (found,) in started]
    assert [(report.result, report.reason) for report in reports] == [("done", "")] * 2
    first, second = sorted(reports, key=lambda report: report.phases[0].began)
    assert {subplan.robot for report in reports if report.plan for subplan in report.plan.subplans} == {"A", "B", "C"}
    assert second.phases[0].started["C"] > first.phases[-1].done["C"]


def test_a_step_that_fails_ends_it_for_all(crew: Crew) -> None:
    blocked = Approach(x=5.0, y=4.6, heading=0.0)  # through the elevator's wall
    report = crew.leader("A").lead("test", Given([near("A", 0.3), Wait()], [blocked, Wait()]))
    assert report.result == "failed"
    assert report.reason.startswith("phase 0: B at L1 (6.")
    eventually(lambda: free(crew), "all are free again")


def test_a_member_that_is_stopped_ends_it_with_the_reason(crew: Crew) -> None:
    thread, reports = leading(crew, Given([Wait(), Wait()], [near("B", 1.5), Wait()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.agents["B"].stop()
    thread.join(60.0)
    assert reports[0].result == "failed"
    assert reports[0].reason.startswith("phase 0: B at L1 (")
    assert reports[0].reason.endswith("emergency stop")
    eventually(lambda: crew.agents["A"].is_free, "the others are free")


def test_a_helper_without_network_ends_it_for_all(crew: Crew) -> None:
    thread, reports = leading(crew, Given([FAR, Wait()], [near("B", 1.5, 60.0), Wait()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.bus.cut = {"B"}
    thread.join(60.0)
    assert reports[0].reason == "phase 0: B is silent"
    eventually(lambda: free(crew), "all have ended, each for itself")
    assert crew.agents["B"].state.program.reason in ("the leader A is silent", "somebody ended it")
    assert all(abs(math.hypot(*agent.state.actor.velocity)) < 0.01 for agent in crew.agents.values())


def test_a_leader_that_is_gone_leaves_nobody_driving(crew: Crew) -> None:
    thread, _ = leading(crew, Given([Wait(), Wait()], [near("B", 1.5, 60.0), Wait()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.bus.cut = {"A"}
    eventually(lambda: crew.agents["B"].is_free, "B has ended")
    assert crew.agents["B"].state.program.reason == "the leader A is silent"
    thread.join(60.0)


def test_a_step_that_takes_too_long_is_named(crew: Crew) -> None:
    begun = time.monotonic()
    report = crew.leader("A").lead(
        "test", Given([Wait()], [Gather(floor="L1", x=9.0, y=9.0, heading=0.0, limit_s=1.0)])
    )
    assert "phase 0 took longer than 1 s" in report.reason
    assert time.monotonic() - begun < 30.0
    eventually(lambda: free(crew), "all are free again")


def test_a_leader_that_is_interrupted_ends_it(crew: Crew) -> None:
    thread, reports = leading(crew, Given([Wait(), Wait()], [near("B", 1.5, 60.0), Wait()]))
    eventually(lambda: crew.agents["B"].state.actor.velocity[0] > 0.1, "moving")
    crew.agents["A"].robot.execution.abort("enough")
    thread.join(60.0)
    assert "enough" in reports[0].reason
    eventually(lambda: free(crew), "all are free again")

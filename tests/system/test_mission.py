"""Missions of robot processes over sub-networks, and what becomes of them where somebody dies.

Robots are slow: what happens to a crew is one story, of which each step is asserted. That three robots carry the
paper's table is the demo's test."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any

import pytest

from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.corba.remote_data_pool import RemotePool
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.mission_record import MissionResult
from testkit.missions import MISSION_LIMIT_S, MissionSystem, RobotStart, missions, save_three_rooms
from testkit.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.slow(200), pytest.mark.full]

#: The phases of a mission from when hands grip.
TAKEN_HOLD = ("gripping", "carrying", "putting down", "backing off")
#: Largest distance of what was carried from its goal [m].
NEAR_M = 0.05
#: Where the desk may stand; it is too heavy for one robot.
GOALS = ((3.8, 7.6), (2.2, 7.6))
CREW = {
    "E": RobotStart(0.7, 6.2, 0.0, "yard"),
    "F": RobotStart(4.6, 8.6, math.pi, "hall"),
    "G": RobotStart(5.2, 6.0, math.pi, "yard"),
    "H": RobotStart(0.7, 9.2, 0.0, "hall"),
}


class Crew:
    """Robots that carry the desk: one mission after the other, led by E."""

    def __init__(self, place: MissionSystem) -> None:
        self.place, self.robots = place, set(CREW)

    def carry(self) -> tuple[tuple[float, float], subprocess.Popen[str]]:
        """Begin to carry the desk to the goal that is farther, until it moves; the goal, and the user's command."""
        at = self.place.body("desk")
        x, y = goal = max(GOALS, key=lambda goal: math.dist(goal, at[:2]))
        user = self.place.mission("E", "desk", f"L1:{x},{y}")
        self.place.carrying("E", "desk", user)
        return goal, user

    def end(self, user: subprocess.Popen[str]) -> tuple[int, str]:
        """Its exit code and last line; then nobody holds anything, nobody moves, and all who live are free."""
        code, out, err = self.place.outcome(user)
        assert "Traceback" not in err, err
        eventually(lambda: all(map(self.place.is_free, self.robots)), what=f"{self.robots} are free")
        assert self.place.holding() == {}
        assert self.place.is_stationary((*self.robots, "desk"))
        assert 0.4 < self.place.body("desk").x < 5.6
        return code, (err or out).strip().splitlines()[-1]

    def kill(self, name: str) -> None:
        self.robots.remove(name)
        self.place.kill(name)

    def holding_without(self, leader: str, killed: str) -> frozenset[str]:
        """Who takes hold, once a leader has planned without a killed robot."""

        def holding() -> frozenset[str]:
            kept = self.place.kept(leader)
            robots = frozenset(part.robot for part in kept.plan.subplans) if kept else frozenset[str]()
            return robots if kept and killed not in robots and kept.phase in TAKEN_HOLD else frozenset()

        return eventually(holding, MISSION_LIMIT_S, "they take hold again")

    # ---- the story ----

    def outlive_the_leaders_channel_and_abort(self) -> None:
        """The carry waits for the channel, or begins again; then its user aborts it."""
        place, (_, user) = self.place, self.carry()
        before = place.kill_server("events_yard")
        eventually(lambda: place.is_back("events_yard", before), what="the channel is back")
        place.carrying("E", "desk", user)
        name = place.led_by("E")
        assert f"{name}: move table desk, running" in " ".join(place.command("anybody", "status", name).split())
        place.command("anybody", "abort", name)
        code, last_line = self.end(user)
        assert code == 1 and last_line.endswith("it was aborted")
        content = place.ended(name)
        assert (content.result, content.kind, content.about) == (MissionResult.ABORTED, "move_table", "desk")
        assert sorted(member.role for member in content.members) == ["helper", "leader"]
        names = [phase.name for phase in content.phases]
        assert (names[0], names[-1], "approaching" in names) == ("asking", "ending safely", True)
        assert all(phase.begun <= phase.ended for phase in content.phases)
        assert "has ended already, aborted" in place.refusal("anybody", "abort", name)

    def lead_on_without_a_helper_and_the_leader(self) -> None:
        """Both are killed while they carry; first another helper replaces the one, then that one leads."""
        place, (goal, user) = self.place, self.carry()
        collisions, name = place.collisions, place.led_by("E")
        killed = self.helper(name)
        self.kill(killed)
        assert len(self.holding_without("E", killed)) == 2
        place.carrying("E", "desk", user)
        helper = self.helper(name)
        self.kill("E")

        def successor() -> str:
            content = place.control.mission(name).content
            return content.leader if content.term > 1 else ""

        assert eventually(successor, MISSION_LIMIT_S, "another one leads") == helper
        assert self.holding_without(helper, "E") == self.robots
        code, last_line = self.end(user)
        assert (code, last_line.split("\t")[0]) == (0, "done"), last_line
        assert math.dist(place.body("desk")[:2], goal) < NEAR_M
        assert abs(math.degrees(math.remainder(place.body("desk").heading, math.tau))) < 3.0
        assert place.collisions == collisions
        self.check_report(name, place.report(helper), helper)

    def helper(self, mission: str) -> str:
        (found,) = (each.robot for each in self.place.control.mission(mission).content.members if each.robot != "E")
        return found

    def check_report(self, name: str, report: Any, helper: str) -> None:
        place, content = self.place, self.place.ended(name)
        status = place.command("anybody", "status", name)
        assert (content.result, content.reason, report["result"]) == (MissionResult.DONE, "", "done")
        assert (content.leader, content.term) == (helper, 2)
        assert report["faults"] == [f"E is silent, and {helper} can't carry on"]  # too heavy for one
        assert f"{helper} took over in term 2 after " in status and "E was silent" in status
        assert {member.robot for member in content.members} == self.robots
        assert {"yard", "hall"} <= set(report["latency_ms"])
        pool = RemotePool(place.orb, helper)
        plan = pool.plans()[-1]
        assert pool.plan(plan.name) == plan
        assert "wrote" in place.command(helper, "report", report["mission"])
        (page,) = (place.folder / helper).rglob("report.html")
        assert page.parent.name == report["mission"]
        assert "gripping" in page.read_text()
        assert (page.parent / "timeline.png").stat().st_size > 1000


@pytest.mark.timeout(8 * MISSION_LIMIT_S)
def test_a_crew_whose_robots_and_servers_are_killed(tmp_path: Path) -> None:
    """Its robots have the protective field."""
    with missions(tmp_path, save_three_rooms(tmp_path), "hall,yard") as place:
        place.start(CREW, "--protect", "on")
        crew = Crew(place)
        crew.outlive_the_leaders_channel_and_abort()
        crew.lead_on_without_a_helper_and_the_leader()
        stand_before_a_wall(place, min(crew.robots))
        keep_missions_over_a_kill(place)


def stand_before_a_wall(place: MissionSystem, name: str) -> None:
    collisions, robot = place.collisions, place.agent(name)
    robot.load(dumps(ProgramBuilder("into the wall").mbase_velocity(0.0, 0.38, 0.0, 60.0).program()))
    robot.run()
    eventually(lambda: robot.state().program.result is ProgramResult.FAILED, 120.0, "it stands before the wall")
    assert "sees something 0.0" in robot.state().program.reason
    assert place.collisions == collisions


def keep_missions_over_a_kill(place: MissionSystem) -> None:
    """Of the simulation server."""
    control = place.control
    eventually(
        lambda: not any(state.content.is_running for state in control.missions_since(0)), what="all ends are recorded"
    )
    before = {state.name: state.content for state in control.missions_since(0)}
    reports = {name: control.report(name) for name in before}
    since = max(state.version for state in control.missions_since(0))
    pid = place.kill_server("simulation")
    eventually(lambda: place.is_back("simulation", pid), what="the simulation server is back")
    again = eventually(lambda: place.missions_since(since), what="mission control answers")
    assert {state.name: state.content for state in again} == before
    assert {name: control.report(name) for name in before} == reports
    done = next(name for name, content in before.items() if content.result is MissionResult.DONE)
    assert reports[done]["phases"][-1]["name"] == "backing off"
    # A user who has only the running system gets the report as a page, too.
    assert "wrote" in place.command("anybody", "report", done)
    # Programs get all members of the records.
    (listed,) = (each for each in json.loads(place.command("anybody", "list", "--json")) if each["name"] == done)
    assert listed == json.loads(place.command("anybody", "status", done, "--json"))
    assert listed["icon"]["icon"] == "move_table"
    assert listed["attempts"] >= 1
    assert listed["report"] == reports[done]

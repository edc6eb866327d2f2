"""Missions of robot processes over sub-networks: the paper's table, and what becomes of it where somebody dies.

Robots are slow, and most of the time nobody computes: two crews do their missions at the same time, in rooms of their
own. What happens to a crew is one story, of which each step is asserted."""

from __future__ import annotations

import json
import math
import subprocess
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest

from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.corba.remote_data_pool import RemotePool
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.mission_record import MissionResult
from testkit.missions import FLOOR, MISSION_LIMIT_S, MissionSystem, RobotStart, Watch, missions, save_three_rooms
from testkit.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.slow(300), pytest.mark.full]

#: The phases of a mission from when hands grip.
TAKEN_HOLD = ("gripping", "carrying", "putting down", "backing off")
#: Largest distance of what was carried from its goal [m].
NEAR_M = 0.05
#: A table for three and a desk for two, and where either may stand.
GOALS = {"table": ((3.8, 2.6), (2.2, 2.6)), "desk": ((3.8, 7.6), (2.2, 7.6))}
TABLE_CREW = {
    "A": RobotStart(0.7, 1.0, 0.0, "lab"),
    "B": RobotStart(4.6, 3.6, math.pi, "lab"),
    "C": RobotStart(5.2, 1.0, math.pi, "hall"),
    "D": RobotStart(7.0, 2.6, math.pi, "hall"),
}
DESK_CREW = {
    "E": RobotStart(0.7, 6.2, 0.0, "yard"),
    "F": RobotStart(4.6, 8.6, math.pi, "hall"),
    "G": RobotStart(5.2, 6.0, math.pi, "yard"),
}


class Crew:
    """Robots that carry something: one mission after the other."""

    def __init__(self, place: MissionSystem, crew: dict[str, RobotStart], thing: str) -> None:
        self.place, self.crew, self.thing = place, set(crew), thing

    def carry(self, leader: str) -> tuple[tuple[float, float], subprocess.Popen[str]]:
        """Begin to carry the thing to the goal that is farther; the goal, and the user's command."""
        at = self.place.body(self.thing)
        x, y = goal = max(GOALS[self.thing], key=lambda goal: math.dist(goal, at[:2]))
        return goal, self.place.mission(leader, self.thing, f"L1:{x},{y}")

    def end(self, user: subprocess.Popen[str]) -> tuple[int, str]:
        """Its exit code and last line; then nobody holds anything, nobody moves, and all who live are free."""
        code, out, err = self.place.outcome(user)
        assert "Traceback" not in err, err
        eventually(lambda: all(map(self.place.is_free, self.crew)), what=f"{self.crew} are free")
        held = self.place.holding()
        assert self.crew.isdisjoint(held), held
        assert self.place.is_stationary((*self.crew, self.thing))
        assert 0.4 < self.place.body(self.thing).x < 5.6
        return code, (err or out).strip().splitlines()[-1]

    def arrive(self, user: subprocess.Popen[str], leader: str, goal: tuple[float, float]) -> Any:
        """The end of a mission that gets the thing to its goal; the leader's report."""
        code, last_line = self.end(user)
        assert (code, last_line.split("\t")[0]) == (0, "done"), last_line
        report = self.place.report(leader)
        assert (report["result"], report["reason"]) == ("done", "")
        assert math.dist(self.place.body(self.thing)[:2], goal) < NEAR_M
        return report

    def kill(self, name: str) -> None:
        self.crew.remove(name)
        self.place.kill(name)

    def holding_without(self, leader: str, killed: str) -> frozenset[str]:
        """Who takes hold, once a leader has planned without a killed robot."""

        def holding() -> frozenset[str]:
            kept = self.place.kept(leader)
            robots = frozenset(part.robot for part in kept.plan.subplans) if kept else frozenset[str]()
            return robots if kept and killed not in robots and kept.phase in TAKEN_HOLD else frozenset()

        return eventually(holding, MISSION_LIMIT_S, "they take hold again")

    # ---- the stories of both crews ----

    def carry_table(self) -> None:
        self.replace_a_killed_helper()
        self.carry_well()

    def carry_desk(self) -> None:
        self.outlive_the_leaders_channel()
        self.abort()
        self.lead_on_without_the_leader()

    def replace_a_killed_helper(self) -> None:
        """D carries from where the table was put down."""
        goal, user = self.carry("A")
        self.place.carrying("A", "table", user)
        self.kill("C")
        assert self.holding_without("A", "C") == {"A", "B", "D"}
        report = self.arrive(user, "A", goal)
        assert report["faults"] == ["carrying: C is silent"]
        assert set(report["robots"]) == {"A", "B", "D"}

    def carry_well(self) -> None:
        """Three robots of two sub-networks."""
        place = self.place
        collisions = place.collisions
        with Watch(place, "table") as watch:
            goal, user = self.carry("A")
            report = self.arrive(user, "A", goal)
        assert abs(math.degrees(math.remainder(place.body("table").heading, math.tau))) < 3.0
        assert place.collisions == collisions
        assert watch.farthest_m(("A", "B", "D")) < 0.02
        assert report["robots"] == {"A": "leader", "B": "helper", "D": "helper"}
        assert {"lab", "hall"} <= set(report["latency_ms"])
        # Those who would be in each other's way gather one after the other.
        names = [phase["name"] for phase in report["phases"] if not phase["name"].startswith("waiting: ")]
        assert [name for name, _ in groupby(names)] == [
            *("reserving", "gathering", "approaching", "gripping", "carrying", "putting down", "backing off")
        ]
        pool = RemotePool(place.orb, "A")
        plan = pool.plans()[-1]
        assert pool.plan(plan.name) == plan

        assert "wrote" in place.command("A", "report", report["mission"])
        (page,) = (place.folder / "A").rglob("report.html")
        assert page.parent.name == report["mission"]
        assert "gripping" in page.read_text()
        assert (page.parent / "timeline.png").stat().st_size > 1000

    def outlive_the_leaders_channel(self) -> None:
        """The carry waits for it, or begins again."""
        place, (goal, user) = self.place, self.carry("E")
        place.carrying("E", "desk", user)
        before = place.kill_server("events_yard")
        eventually(lambda: place.is_back("events_yard", before), what="the channel is back")
        self.arrive(user, "E", goal)

    def abort(self) -> None:
        place, (_, user) = self.place, self.carry("E")
        place.at_phase("E", "approaching", user)
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

    def lead_on_without_the_leader(self) -> None:
        """It is killed while it carries; its helper takes over, with another helper."""
        place, (goal, user) = self.place, self.carry("E")
        place.carrying("E", "desk", user)
        name = place.led_by("E")
        (helper,) = (member.robot for member in place.control.mission(name).content.members if member.robot != "E")
        self.kill("E")

        def successor() -> str:
            content = place.control.mission(name).content
            return content.leader if content.term > 1 else ""

        assert eventually(successor, MISSION_LIMIT_S, "another one leads") == helper
        assert self.holding_without(helper, "E") == {"F", "G"}
        report = self.arrive(user, helper, goal)
        status, content = place.command("anybody", "status", name), place.ended(name)
        assert (content.result, content.reason) == (MissionResult.DONE, "")
        assert (content.leader, content.term) == (helper, 2)
        assert report["faults"] == [f"E is silent, and {helper} can't carry on"]  # too heavy for one
        assert f"{helper} took over in term 2 after " in status and "E was silent" in status
        assert {member.robot for member in content.members} == {"F", "G"}


@pytest.mark.timeout(8 * MISSION_LIMIT_S)
def test_two_crews_whose_robots_and_servers_are_killed(tmp_path: Path) -> None:
    with missions(tmp_path, save_three_rooms(tmp_path), "lab,hall,yard") as place:
        place.start(TABLE_CREW, "--protect", "on")
        place.start(DESK_CREW)
        with ThreadPoolExecutor(2) as pool:
            table = pool.submit(Crew(place, TABLE_CREW, "table").carry_table)
            desk = pool.submit(Crew(place, DESK_CREW, "desk").carry_desk)
        table.result()
        desk.result()
        check_protective_field(place)
        keep_missions_over_a_kill(place)


def check_protective_field(place: MissionSystem) -> None:
    """The crew of the table has it: A and B swap places, and B does not drive into a wall."""
    collisions, b = place.collisions, place.agent("B")
    starts = {name: place.body(name)[:2] for name in "AB"}
    for name, other in ("AB", "BA"):
        place.agent(name).load(dumps(ProgramBuilder("swap").mbase_path(FLOOR, *starts[other]).program()))
    for name in "AB":
        place.agent(name).run()
    for name in "AB":
        agent = place.agent(name)
        eventually(lambda agent=agent: agent.state().program.result is not ProgramResult.NO_RESULT, 240.0, name)
        assert agent.state().program.result is ProgramResult.DONE, agent.state().program
    b.load(dumps(ProgramBuilder("into the wall").mbase_velocity(0.0, 0.38, 0.0, 60.0).program()))
    b.run()
    eventually(lambda: b.state().program.result is ProgramResult.FAILED, 120.0, "it stands before the wall")
    assert "sees something 0.0" in b.state().program.reason
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

"""Missions of robot processes over sub-networks: the paper's table, and what becomes of it where somebody dies.

Robots are slow, and most of the time nobody computes: two crews do their missions at the same time, in rooms of their
own. Each test waits for what it is about."""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import groupby
from typing import Any, NamedTuple

import pytest

from robocorba.simulation.mission_record import MissionContent, MissionResult
from robocorba.testing.missions import (
    MissionSystem,
    RobotStart,
    Watch,
    missions,
    save_three_rooms,
)
from robocorba.testing.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(400)]

#: A table for three and a desk for two, and where either may stand.
GOALS = {"table": ((3.8, 2.6), (2.2, 2.6)), "desk": ((3.8, 7.6), (2.2, 7.6))}
TABLE_CREW = {
    "A": RobotStart(0.7, 1.0, 0.0, "lab"),
    "B": RobotStart(4.6, 3.6, math.pi, "lab"),
    "C": RobotStart(5.2, 1.0, math.pi, "hall"),
    "D": RobotStart(7.0, 2.6, math.pi, "hall"),
}
DESK_CREW = {"E": RobotStart(0.7, 6.2, 0.0, "yard"), "F": RobotStart(4.6, 8.6, math.pi, "hall")}


class Ended(NamedTuple):
    """A mission, as its user saw it end."""

    code: int
    told: str


class Crew:
    """Robots that carry something: one mission after the other."""

    def __init__(self, place: MissionSystem, crew: dict[str, RobotStart], thing: str) -> None:
        self.place, self.crew, self.thing = place, set(crew), thing

    @property
    def goal(self) -> tuple[float, float]:
        """Whichever is farther."""
        at = self.place.body(self.thing)
        return max(GOALS[self.thing], key=lambda goal: math.dist(goal, at[:2]))

    def carry(self, leader: str) -> subprocess.Popen[str]:
        x, y = self.goal
        return self.place.mission(leader, self.thing, f"L1:{x},{y}")

    def end(self, user: subprocess.Popen[str]) -> Ended:
        """Its last line; then nobody holds anything, nobody moves, and all who live are free."""
        code, out, err = self.place.outcome(user)
        assert "Traceback" not in err, err
        eventually(lambda: all(map(self.place.is_free, self.crew)), 60.0, f"{self.crew} are free")
        held = self.place.holding()
        assert self.crew.isdisjoint(held), held
        assert self.place.is_stationary((*self.crew, self.thing))
        assert 0.4 < self.place.body(self.thing).x < 5.6
        return Ended(code, (err or out).strip().splitlines()[-1])

    def kill(self, name: str) -> None:
        self.crew.remove(name)
        self.place.kill(name)


class Told(NamedTuple):
    """Both stories, told in two threads."""

    place: MissionSystem
    table: Future[TableStory]
    desk: Future[DeskStory]


class TableStory(NamedTuple):
    """C was killed, then all went well with D, as was seen of the table and the hands, m and deg."""

    killed: Ended
    killed_report: dict[str, Any]
    done: Ended
    report: dict[str, Any]
    off: tuple[float, float]
    grips_off_m: float
    went_beside: int


class DeskStory(NamedTuple):
    """The leader's channel was killed, and the mission ended by its user; one was aborted by its name, and then once
    more; then the leader was killed. What mission control says of the last two."""

    killed_channel: Ended
    aborted: Ended
    aborted_as: MissionContent
    aborted_again: str
    killed_leader: Ended
    killed_leader_as: MissionContent
    helpers_reason: str


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    folder = tmp_path_factory.mktemp("missions")
    with missions(folder, save_three_rooms(folder), "lab,hall,yard") as place, ThreadPoolExecutor(2) as threads:
        place.start(TABLE_CREW | DESK_CREW)
        yield Told(place, threads.submit(table_story, place), threads.submit(desk_story, place))


def table_story(place: MissionSystem) -> TableStory:
    crew = Crew(place, TABLE_CREW, "table")
    user = crew.carry("A")
    place.carrying("A", "table", user)
    crew.kill("C")
    killed, killed_report = crew.end(user), place.report("A")
    before = place.collisions
    with Watch(place, "table") as watch:
        goal, user = crew.goal, crew.carry("A")
        done = crew.end(user)
    at = place.body("table")
    off = math.dist(at[:2], goal), abs(math.degrees(math.remainder(at.heading, math.tau)))
    return TableStory(
        killed,
        killed_report,
        done,
        place.report("A"),
        off,
        watch.farthest_m(("A", "B", "D")),
        place.collisions - before,
    )


def desk_story(place: MissionSystem) -> DeskStory:
    crew = Crew(place, DESK_CREW, "desk")
    user = crew.carry("E")
    place.carrying("E", "desk", user)
    before = place.kill_server("events_yard")
    eventually(lambda: place.is_back("events_yard", before), 30.0, "the channel is back")
    if user.poll() is None:
        place.command("E", "abort", "--leader", "E")
    killed_channel = crew.end(user)

    user = crew.carry("E")
    place.at_phase("E", "approaching", user)
    name = place.led_by("E")
    assert f"{name}: move table desk, running" in " ".join(place.command("anybody", "status", name).split())
    place.command("anybody", "abort", name)
    aborted = crew.end(user)
    aborted_as = place.ended(name)
    refused = place.refusal("anybody", "abort", name)

    user = crew.carry("E")
    place.carrying("E", "desk", user)
    name = place.led_by("E")
    crew.kill("E")
    killed_leader = crew.end(user)
    reason = place.agent("F").state().program.reason
    return DeskStory(killed_channel, aborted, aborted_as, refused, killed_leader, place.ended(name), reason)


def test_three_robots_of_two_sub_networks_carry_a_table(told: Told) -> None:
    story = told.table.result()
    assert (story.done.code, story.done.told.split("\t")[0]) == (0, "done"), story.done
    off_m, off_deg = story.off
    assert off_m < 0.05
    assert off_deg < 3.0
    assert story.went_beside == 0
    assert story.grips_off_m < 0.02
    report = story.report
    assert (report["result"], report["reason"]) == ("done", "")
    assert report["robots"] == {"A": "leader", "B": "helper", "D": "helper"}
    assert {"lab", "hall"} <= set(report["latency_ms"])
    # Those who would be in each other's way gather one after the other.
    assert [name for name, _ in groupby(phase["name"] for phase in report["phases"])] == [
        *("reserving", "gathering", "approaching", "gripping", "carrying", "putting down", "backing off")
    ]


def test_its_report_is_a_page(told: Told) -> None:
    mission = told.table.result().report["mission"]
    assert "wrote" in told.place.command("A", "report", mission)
    (page,) = (told.place.folder / "A").rglob("report.html")
    assert page.parent.name == mission
    assert "gripping" in page.read_text()
    assert (page.parent / "timeline.png").stat().st_size > 1000


def test_a_helper_is_killed_while_it_carries(told: Told) -> None:
    story = told.table.result()
    assert story.killed.code == 1
    assert story.killed.told.endswith("carrying: C is silent")
    assert story.killed_report["reason"] == "carrying: C is silent"


def test_the_leader_is_killed_while_it_carries(told: Told) -> None:
    story = told.desk.result()
    assert story.killed_leader.code == 1
    assert "robot E does not answer" in story.killed_leader.told
    assert story.helpers_reason == "the leader E is silent"
    content = story.killed_leader_as
    assert content.result is MissionResult.FAILED
    assert content.reason.startswith("its leader E was gone for ")


def test_the_user_ends_it(told: Told) -> None:
    story = told.desk.result()
    assert story.aborted.code == 1
    assert story.aborted.told.endswith("it was aborted")
    content = story.aborted_as
    assert (content.result, content.kind, content.about) == (MissionResult.ABORTED, "move_table", "desk")
    assert {member.robot: member.role for member in content.members} == {"E": "leader", "F": "helper"}
    names = [phase.name for phase in content.phases]
    assert (names[0], names[-1]) == ("asking", "ending safely")
    assert "approaching" in names
    assert all(phase.begun <= phase.ended for phase in content.phases)
    assert "has ended already, aborted" in story.aborted_again


def test_the_leaders_channel_is_killed_while_it_carries(told: Told) -> None:
    ended = told.desk.result().killed_channel
    assert ended.code == 1
    assert re.search(r"it was aborted$|[EF] is silent$|F has left the mission$", ended.told), ended


def test_what_blocks_is_named(told: Told) -> None:
    told.table.result()
    place = told.place
    code, out, _ = place.outcome(place.mission("A", "table", "L1:8,2.6"))
    assert code == 1
    assert "door" in out
    code, out, err = place.outcome(place.mission("A", "sofa", "L1:8,2.6"))
    assert code == 1
    assert "there is no object 'sofa' that can be carried; there are desk, table" in out + err


def test_missions_that_ended_survive_a_kill_of_the_server(told: Told) -> None:
    told.table.result()
    told.desk.result()
    place, control = told.place, told.place.control
    eventually(
        lambda: not any(state.content.is_running for state in control.missions_since(0)), 30.0, "all ends are recorded"
    )
    before = {state.name: state.content for state in control.missions_since(0)}
    reports = {name: control.report(name) for name in before}
    since = max(state.version for state in control.missions_since(0))
    pid = place.kill_server("simulation")
    eventually(lambda: place.is_back("simulation", pid), 30.0, "the simulation server is back")
    again = eventually(lambda: place.missions_since(since), 30.0, "mission control answers")
    assert {state.name: state.content for state in again} == before
    assert {name: control.report(name) for name in before} == reports
    done = next(name for name, content in before.items() if content.result is MissionResult.DONE)
    assert reports[done]["phases"][-1]["name"] == "backing off"
    # A user who has only the running system gets the report as a page, too.
    assert "wrote" in place.command("anybody", "report", done)
    assert done in place.command("anybody", "list", "--json")

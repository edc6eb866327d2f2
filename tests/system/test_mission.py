"""Missions of robot processes over sub-networks: the paper's table, and what becomes of it where somebody dies.

Robots are slow, and most of the time nobody computes: two crews do their missions at the same time, in rooms of their
own. Each test waits for what it is about, in the order in which that happens."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import groupby
from typing import Any, NamedTuple

import pytest

from robocorba.simulation.mission_record import MissionContent, MissionResult
from robocorba.testing.missions import (
    MISSION_LIMIT_S,
    MissionSystem,
    RobotStart,
    Watch,
    missions,
    save_three_rooms,
)
from robocorba.testing.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

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


class Ended(NamedTuple):
    """A mission, as its user saw it end."""

    code: int
    last_line: str


class Crew:
    """Robots that carry something: one mission after the other."""

    def __init__(self, place: MissionSystem, crew: dict[str, RobotStart], thing: str) -> None:
        self.place, self.crew, self.thing = place, set(crew), thing

    @property
    def goal(self) -> tuple[float, float]:
        """Whichever is farther."""
        at = self.place.body(self.thing)
        return max(GOALS[self.thing], key=lambda goal: math.dist(goal, at[:2]))

    @property
    def far(self) -> tuple[float, float]:
        """Where the mission that runs carries it: it has left the other place."""
        at = self.place.body(self.thing)
        return max(GOALS[self.thing], key=lambda goal: goal[0]) if at.x > 2.2 else min(GOALS[self.thing])

    def off_m(self, goal: tuple[float, float]) -> float:
        """Distance from a goal."""
        return math.dist(self.place.body(self.thing)[:2], goal)

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


class KilledHelper(NamedTuple):
    """A helper was killed while it carried. off_m: distance of the table from its goal in the end."""

    ended: Ended
    report: dict[str, Any]
    off_m: float


class Carried(NamedTuple):
    """All went well, as was seen of the table and the hands, m and deg."""

    ended: Ended
    report: dict[str, Any]
    off: tuple[float, float]
    grips_off_m: float
    went_beside: int


class Aborted(NamedTuple):
    """A mission was aborted by its name, and then once more. record: what mission control says of it."""

    ended: Ended
    record: MissionContent
    again: str


class KilledLeader(NamedTuple):
    """The leader was killed while it carried. helper: who carried with it. successor: who leads then. goal: of the
    desk."""

    user: subprocess.Popen[str]
    mission: str
    helper: str
    successor: str
    goal: tuple[float, float]


class LedOn(NamedTuple):
    """How the mission of a killed leader ended. record: what mission control says. off_m: distance of the desk from its
    goal in the end."""

    ended: Ended
    record: MissionContent
    report: dict[str, Any]
    status: str
    off_m: float


class Stories(NamedTuple):
    """What happens to both crews, each in a thread, one after the other."""

    place: MissionSystem
    begun: Future[subprocess.Popen[str]]
    replaced: Future[frozenset[str]]
    killed_helper: Future[KilledHelper]
    carried: Future[Carried]
    killed_channel: Future[KilledHelper]
    aborted: Future[Aborted]
    killed_leader: Future[KilledLeader]
    took_over: Future[frozenset[str]]
    led_on: Future[LedOn]


@pytest.fixture(scope="module")
def stories(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stories]:
    folder = tmp_path_factory.mktemp("missions")
    with (
        missions(folder, save_three_rooms(folder), "lab,hall,yard") as place,
        ThreadPoolExecutor(1) as first,
        ThreadPoolExecutor(1) as second,
    ):
        place.start(TABLE_CREW | DESK_CREW)
        table, desk = Crew(place, TABLE_CREW, "table"), Crew(place, DESK_CREW, "desk")
        yield Stories(
            place,
            begun := first.submit(begin, table),
            first.submit(kill_helper, table),
            first.submit(end, table, begun),
            first.submit(carry, table),
            second.submit(kill_channel, desk),
            second.submit(abort, desk),
            killed_leader := second.submit(kill_leader, desk),
            second.submit(take_over, desk, killed_leader),
            second.submit(lead_on, desk, killed_leader),
        )


def begin(crew: Crew) -> subprocess.Popen[str]:
    """The user whose mission now carries the table."""
    user = crew.carry("A")
    crew.place.carrying("A", "table", user)
    return user


def kill_helper(crew: Crew) -> frozenset[str]:
    """Who takes hold then, where the table was put down."""
    crew.kill("C")
    return holding_without(crew.place, "A", "C")


def holding_without(place: MissionSystem, leader: str, killed: str) -> frozenset[str]:
    """Who takes hold, once a leader has planned without a killed robot."""

    def holding() -> frozenset[str]:
        kept = place.kept(leader)
        robots = frozenset(part.robot for part in kept.plan.subplans) if kept else frozenset[str]()
        return robots if kept and killed not in robots and kept.phase in TAKEN_HOLD else frozenset()

    return eventually(holding, MISSION_LIMIT_S, "they take hold again")


def end(crew: Crew, begun: Future[subprocess.Popen[str]]) -> KilledHelper:
    goal = crew.far
    return KilledHelper(crew.end(begun.result()), crew.place.report("A"), crew.off_m(goal))


def carry(crew: Crew) -> Carried:
    place = crew.place
    before = place.collisions
    with Watch(place, "table") as watch:
        goal, user = crew.goal, crew.carry("A")
        done = crew.end(user)
    at = place.body("table")
    off = math.dist(at[:2], goal), abs(math.degrees(math.remainder(at.heading, math.tau)))
    return Carried(done, place.report("A"), off, watch.farthest_m(("A", "B", "D")), place.collisions - before)


def kill_channel(crew: Crew) -> KilledHelper:
    place, goal, user = crew.place, crew.goal, crew.carry("E")
    place.carrying("E", "desk", user)
    before = place.kill_server("events_yard")
    eventually(lambda: place.is_back("events_yard", before), 30.0, "the channel is back")
    return KilledHelper(crew.end(user), place.report("E"), crew.off_m(goal))


def abort(crew: Crew) -> Aborted:
    place, user = crew.place, crew.carry("E")
    place.at_phase("E", "approaching", user)
    name = place.led_by("E")
    assert f"{name}: move table desk, running" in " ".join(place.command("anybody", "status", name).split())
    place.command("anybody", "abort", name)
    return Aborted(crew.end(user), place.ended(name), place.refusal("anybody", "abort", name))


def kill_leader(crew: Crew) -> KilledLeader:
    place, goal, user = crew.place, crew.goal, crew.carry("E")
    place.carrying("E", "desk", user)
    name = place.led_by("E")
    (helper,) = (member.robot for member in place.control.mission(name).content.members if member.robot != "E")
    crew.kill("E")

    def successor() -> str:
        content = place.control.mission(name).content
        return content.leader if content.term > 1 else ""

    return KilledLeader(user, name, helper, eventually(successor, MISSION_LIMIT_S, "another one leads"), goal)


def take_over(crew: Crew, killed: Future[KilledLeader]) -> frozenset[str]:
    """Who takes hold then, where the desk was put down."""
    return holding_without(crew.place, killed.result().successor, "E")


def lead_on(crew: Crew, killed: Future[KilledLeader]) -> LedOn:
    place, (user, name, _, leader, goal) = crew.place, killed.result()
    ended = crew.end(user)
    status = place.command("anybody", "status", name)
    return LedOn(ended, place.ended(name), place.report(leader), status, crew.off_m(goal))


def test_three_robots_begin_to_carry(stories: Stories) -> None:
    stories.begun.result()


def test_another_robot_takes_the_place_of_a_killed_one(stories: Stories) -> None:
    assert stories.replaced.result() == {"A", "B", "D"}


def test_a_helper_is_killed_while_it_carries(stories: Stories) -> None:
    """D carries from where the table was put down."""
    story = stories.killed_helper.result()
    assert (story.ended.code, story.report["reason"]) == (0, ""), story.ended
    assert story.report["faults"] == ["carrying: C is silent"]
    assert set(story.report["robots"]) == {"A", "B", "D"}
    assert story.off_m < NEAR_M


def test_the_leaders_channel_is_killed_while_it_carries(stories: Stories) -> None:
    """The carry waits for it, or begins again."""
    story = stories.killed_channel.result()
    assert (story.ended.code, story.report["reason"]) == (0, ""), story.ended
    assert story.off_m < NEAR_M


def test_the_user_ends_it(stories: Stories) -> None:
    story = stories.aborted.result()
    assert story.ended.code == 1
    assert story.ended.last_line.endswith("it was aborted")
    content = story.record
    assert (content.result, content.kind, content.about) == (MissionResult.ABORTED, "move_table", "desk")
    assert sorted(member.role for member in content.members) == ["helper", "leader"]
    names = [phase.name for phase in content.phases]
    assert (names[0], names[-1]) == ("asking", "ending safely")
    assert "approaching" in names
    assert all(phase.begun <= phase.ended for phase in content.phases)
    assert "has ended already, aborted" in story.again


def test_the_leader_is_killed_while_it_carries(stories: Stories) -> None:
    """Its helper takes over."""
    story = stories.killed_leader.result()
    assert story.helper in {"F", "G"}
    assert story.successor == story.helper


def test_another_helper_takes_hold_with_the_new_leader(stories: Stories) -> None:
    assert stories.took_over.result() == {"F", "G"}


def test_a_new_leader_gets_the_desk_to_its_goal(stories: Stories) -> None:
    helper, story = stories.killed_leader.result().helper, stories.led_on.result()
    assert story.ended.code == 0, story.ended
    content = story.record
    assert (content.result, content.reason) == (MissionResult.DONE, "")
    assert (content.leader, content.term) == (helper, 2)
    assert story.report["faults"] == [f"E is silent, and {helper} can't carry on"]  # too heavy for one
    assert f"{helper} took over in term 2 after " in story.status
    assert "E was silent" in story.status
    assert {member.robot for member in content.members} == {"F", "G"}
    assert story.off_m < NEAR_M


def test_three_robots_of_two_sub_networks_carry_a_table(stories: Stories) -> None:
    story = stories.carried.result()
    assert (story.ended.code, story.ended.last_line.split("\t")[0]) == (0, "done"), story.ended
    off_m, off_deg = story.off
    assert off_m < NEAR_M
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


def test_its_report_is_a_page(stories: Stories) -> None:
    mission = stories.carried.result().report["mission"]
    assert "wrote" in stories.place.command("A", "report", mission)
    (page,) = (stories.place.folder / "A").rglob("report.html")
    assert page.parent.name == mission
    assert "gripping" in page.read_text()
    assert (page.parent / "timeline.png").stat().st_size > 1000


def test_what_blocks_is_named(stories: Stories) -> None:
    stories.carried.result()
    place = stories.place
    code, out, _ = place.outcome(place.mission("A", "table", "L1:8,2.6"))
    assert code == 1
    assert "door" in out
    code, out, err = place.outcome(place.mission("A", "sofa", "L1:8,2.6"))
    assert code == 1
    assert "there is no object 'sofa' that can be carried; there are desk, table" in out + err


def test_missions_that_ended_survive_a_kill_of_the_server(stories: Stories) -> None:
    stories.carried.result()
    stories.led_on.result()
    place, control = stories.place, stories.place.control
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
    # Programs get all members of the records.
    (listed,) = (each for each in json.loads(place.command("anybody", "list", "--json")) if each["name"] == done)
    assert listed == json.loads(place.command("anybody", "status", done, "--json"))
    assert listed["icon"]["icon"] == "move_table"
    assert listed["attempts"] >= 1
    assert listed["report"] == reports[done]

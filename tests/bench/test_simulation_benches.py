"""The benches of the simulation: their building, what they compute, and small runs of them."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from bench.simulation import headless as bench_headless
from bench.simulation import robots as bench_robots
from bench.simulation import sensors as bench_sensors
from bench.simulation.headless import LASER, MOST, RING, Case, Lap, Wanderers, crowd
from bench.simulation.robots import AT_ONCE, BY_TURNS, FEW, MANY, Load
from bench.simulation.robots_client import Clients, Robot, drive
from robocorba.clients.robot_processes import servers
from robocorba.map_editor import native
from robocorba.map_editor.movable import movables
from robocorba.orb.orb import Orb
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.store import SimulationStore
from robocorba.stubs import RoboCorba
from testkit.generated_buildings import RADIUS_M, office, robots
from testkit.json_process import pids_of

pytestmark = pytest.mark.full


def test_the_office_is_as_it_is_described_and_robots_start_without_overlaps() -> None:
    building = office()
    assert building == office() != office(seed=2)
    assert native.loads(native.dumps(building)) == building
    assert len(building.floors) == 4
    for entry in building.floors.values():
        assert 68 <= len(entry.geometrical.walls) <= 80
        assert np.ptp(entry.floor.outline, axis=0).tolist() == [60.0, 60.0]
    assert len(movables(building)) == 4 * 24
    found = robots(office(), 200)
    assert len({about.name for about in found}) == 200
    assert {about.pose.floor for about in found} == set(office().floors)
    for floor in office().floors:
        places = np.array([about.pose[1:3] for about in found if about.pose.floor == floor])
        apart = np.hypot(*(places[:, None] - places[None]).T)
        assert apart[~np.eye(len(places), dtype=bool)].min() > 2 * RADIUS_M


@pytest.mark.parametrize("spec", [LASER, RING], ids=["laser", "ring"])
def test_clients_see_the_same_either_way_and_drive_by_it(spec: Any, tmp_path: Path) -> None:
    building, crew = office(), robots(office(), 12)
    names = [about.name for about in crew]
    together, alone = (Wanderers(building, names, spec, one_by_one) for one_by_one in (False, True))
    with SimulationStore(tmp_path / "simulation.sqlite") as store:
        agent = ManagementAgent(building, 1, store)
        sessions = [agent.register(about) for about in crew]
        for _ in range(3):  # the whole of each floor, then what has changed
            updates = [agent.database.changes(floor, together._sensor.version(floor)) for floor in building.floors]
            for clients in (together, alone):
                clients.follow(updates)
                clients.scan()
            assert np.array_equal(together.distances, alone.distances)
            for session, (ahead, turn) in zip(sessions, together.wander().tolist(), strict=True):
                session.command(ahead, 0.0, turn, 1.0)
            agent.step()
    assert together.distances.min() < spec.fan.range_m
    with crowd(building, Case(12, "some", spec, 1.0)) as found:
        before = [session.state().pose for session in found.sessions]
        lap = found.lap(1.0)
        moved = [math.dist(a[1:3], b.state().pose[1:3]) for a, b in zip(before, found.sessions, strict=True)]
    assert lap.factor > 0 < lap.cores
    assert sum(way > 0.3 for way in moved) > 6


def test_rows_have_the_medians_of_laps_and_growth_is_judged_by_the_time_a_robot() -> None:
    row = bench_headless.row_of(Case(10, "ring", RING, 60.0), [Lap(factor, factor, 60) for factor in (4.0, 2.0, 3.0)])
    assert (row["x real time"], row["worst"], row["best"]) == (3.0, 2.0, 4.0)
    assert (row["us a robot and s"], row["hits a robot and min"]) == (pytest.approx(1e5 / 3), 6.0)
    cases = bench_headless.CASES
    for slowdown, is_linear in ((1.0, True), (1.4, False)):
        rows = [
            {"robots": n, "x real time": 1e5 / n, "us a robot and s": 10.0 * (slowdown if n == MOST else 1.0)}
            for n in (case.robots for case in cases)
        ]
        *speeds, growth = bench_headless.marks_of(rows)
        assert [mark.limit for mark in speeds] == [case.least for case in cases if case.least]
        assert all(mark.is_reached for mark in speeds)
        assert growth.is_reached is is_linear


class Session:
    """Of a robot that is commanded."""

    def __init__(self) -> None:
        self.commands: list[Any] = []

    def command(self, wanted: Any, valid_s: float) -> None:
        self.commands.append(wanted)

    def state(self) -> Any:
        return SimpleNamespace(moving=self.commands[-1])


def test_robots_are_commanded_as_often_as_is_due_and_what_is_missing_is_counted() -> None:
    fleet = [Robot(Session(), number) for number in range(4)]
    found = drive(fleet, time.monotonic() + 0.05, 0.5, 10.0)
    assert found["due"] == 20 >= len(found["command"]) == len(found["state"]) > 3  # a busy machine misses some
    assert sum(len(robot.session.commands) for robot in fleet) == len(found["command"])
    assert min(found["late"]) >= 0

    class Gone(Session):
        def state(self) -> Any:
            raise CORBA.OBJECT_NOT_EXIST(0, CORBA.COMPLETED_NO)

    found = drive([Robot(Session(), 0), Robot(Gone(), 1)], time.monotonic(), 0.3, 10.0)
    assert (found["due"], found["lost"]) == (6, 1) and 0 < len(found["command"]) <= 3


def found_by_a_run(achieved: float = 1.0, made: int = 100) -> dict[str, Any]:
    """By a made-up one."""
    ms = [1.0] * (made - 2) + [15.0, 30.0]
    return {
        **dict.fromkeys(("command", "state", "late"), ms),
        **{BY_TURNS: [2.0, 3.0, 4.0], AT_ONCE: [20.0], "due": 100, "achieved": [0.5, achieved, achieved]},
        **{"pace": 1.0, "server": 0.5, "cpu": 0.2, "collisions": 30, "lost": 0},
    }


@pytest.mark.parametrize(
    ("found", "is_reached"),
    [({}, [True, True, True]), ({"achieved": 0.97}, [False, True, True]), ({"made": 90}, [True, False, False])],
)
@pytest.mark.parametrize(("load", "other"), [(FEW, MANY), (MANY, FEW)])
def test_robots_are_judged_by_the_medians_of_runs(
    load: Load, other: Load, found: dict[str, Any], is_reached: list[bool]
) -> None:
    runs = [(load, found), (load, {}), (load, found), (other, {})]
    rows = [bench_robots.row_of("1", each, found_by_a_run(**more), 6, 60.0) for each, more in runs]
    for row in rows:
        row["command p99"] = 15.0 if row["made"] == 1.0 else 30.0
    marks = [mark.is_reached for mark in bench_robots.marks_of(rows, 6)]
    judged, others = (marks[:3], marks[3:]) if load is FEW else (marks[3:], marks[:3])
    assert judged == is_reached[: len(judged)] and all(others)


def test_every_run_must_refuse_the_one_too_many_and_a_scan_is_compared_with_null_calls_of_its_own_round() -> None:
    rows = [row for name in "12" for row in bench_robots.log_on_rows_of(name, MANY, found_by_a_run())]
    for refused, is_reached in ((2, [True, True]), (1, [True, False])):
        assert [mark.is_reached for mark in bench_robots.log_on_marks_of(rows, 6, refused)] == is_reached
    null, scan = bench_sensors.NULL, bench_sensors.SCAN
    for scan_ms, is_fast in ((0.3, True), (0.5, False)):
        rounds = [{null: [0.2 * slow] * 3, scan: [scan_ms * slow] * 3} for slow in (1.0, 5.0, 1.0)]
        rows = bench_sensors.latency_rows(rounds)
        assert [row["null calls"] for row in rows] == pytest.approx([1.0, scan_ms / 0.2])
        (mark,) = bench_sensors.marks_of(rows)
        assert mark.is_reached is is_fast


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, Clients, Path]]:
    """Its server, two processes of clients, and its state folder."""
    folder = tmp_path_factory.mktemp("bench")
    native.save(office(), folder / "office.yaml")
    more = ("--building", str(folder / "office.yaml"), "--sensors", "2", "--start-limit", "300")
    with servers(folder / "state", *more) as naming, Orb(naming) as orb, Clients(naming, 2) as clients:
        administrator = (folder / "state" / "administrator.ior").read_text()
        orb.reference(administrator, RoboCorba.SimulationAdministrator).setLimit(6)
        yield orb.resolve("SimulationServer", RoboCorba.SimulationServer), clients, folder / "state"


@pytest.mark.system
def test_a_small_run_of_robots(system: tuple[Any, Clients, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    server, clients, state = system
    monkeypatch.setattr(bench_robots, "WARM_UP_S", 0.5)
    monkeypatch.setattr(bench_robots, "NULL_CALLS", 20)
    (pid,) = pids_of(state, "simulation")
    people = robots(office(), 12)
    assert len(bench_robots.null_calls(server, people[0])) == 20
    assert bench_robots.is_refused(server, people[0]) is False

    on = bench_robots.log_on(server, clients, people, 6)
    found = bench_robots.drive(server, clients, 2, 3.5, pid)
    clients.all("log_off")

    assert on["refused"] is True
    assert len(on[BY_TURNS]) == len(on[AT_ONCE]) == 6
    assert (found["due"], found["lost"]) == (6 * 35, 0)
    assert 0.9 * 210 <= len(found["command"]) <= 210
    row = bench_robots.row_of("1", Load(2, 2), found, 6, 3.5)
    assert row["pace"] > 0.5 and row["server cores"] > 0 < row["client cores"]
    assert server._get_state().robots == 0


@pytest.mark.system
def test_a_small_run_of_sensors(system: tuple[Any, Clients, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    server, clients, state = system
    for name, value in (("ROBOTS", 6), ("SETTLE_S", 0.5), ("CALLS", 10), ("ROUNDS", 2)):
        monkeypatch.setattr(bench_sensors, name, value)

    (row,) = bench_sensors.throughput(server, clients, state, 1.0, 1)

    assert row["sensors"] == 2
    assert row["scans/s"] > 20 and row["scans a sensor's CPU s"] > 20
    assert sum(map(int, row["robots of sensors"].split(" + "))) == 6
    rounds = bench_sensors.latency(server)
    assert len(rounds) == 2
    assert {len(took) for each in rounds for took in each.values()} == {10}
    assert server._get_state().robots == 0

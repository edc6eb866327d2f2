"""The benches of the simulation and of robots: their building, what they compute, and small runs of them."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from bench.common.harness import system
from bench.robots.protection import FAR_M, MARGIN_M, stage
from bench.simulation import headless as bench_headless
from bench.simulation import robots as bench_robots
from bench.simulation.headless import MOST
from bench.simulation.robots import Load
from bench.simulation.robots_client import Clients
from robocorba.map_editor import native
from robocorba.map_editor.movable import movables
from testkit.generated_buildings import RADIUS_M, office, robots

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


def test_growth_is_judged_by_the_time_a_robot() -> None:
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


@pytest.mark.system
def test_a_small_run_of_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_robots, "WARM_UP_S", 0.5)
    with system(building=office()) as place, Clients(place.orb.naming, 2) as clients:
        assert len(clients.log_on(robots(office(), 12), 6)) == 6
        found = bench_robots.drive(place.resolve("SimulationServer"), clients, 2, 3.5, place.running.pid("simulation"))
        clients.all("log_off")
        assert (found["due"], found["lost"]) == (6 * 35, 0)
        assert 0 < len(found["command"]) <= 210
        row = bench_robots.row_of("1", Load(2, 2), found)
        assert row["pace"] > 0 and row["server cores"] > 0 < row["client cores"]
        assert place.resolve("SimulationServer")._get_state().robots == 0


@pytest.mark.system
@pytest.mark.slow(50)
def test_an_actual_robot_stands_before_a_chair_that_no_map_has(tmp_path: Path) -> None:
    with stage(tmp_path, 0.8) as place:
        stands_at_m, report = place.approach(0.8, random.Random(2))
        assert "laser sees something" in report.reason and MARGIN_M <= stands_at_m < FAR_M
        assert place.contacts() == 0.0

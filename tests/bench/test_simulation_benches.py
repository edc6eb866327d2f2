"""The benches of the simulation: their building, what they compute, and small runs of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.simulation import headless as bench_headless
from bench.simulation import robots as bench_robots
from bench.simulation.headless import MOST
from bench.simulation.robots import Load
from bench.simulation.robots_client import Clients
from robocorba.clients.robot_processes import servers
from robocorba.map_editor import native
from robocorba.map_editor.movable import movables
from robocorba.orb.orb import Orb
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
    (pid,) = pids_of(state, "simulation")
    people = robots(office(), 12)
    assert len(bench_robots.null_calls(server, people[0])) == bench_robots.NULL_CALLS
    assert len(clients.log_on(people, 6, at_once=False)["log on"]) == 6
    found = bench_robots.drive(server, clients, 2, 3.5, pid)
    clients.all("log_off")
    assert (found["due"], found["lost"]) == (6 * 35, 0)
    assert 0 < len(found["command"]) <= 210
    row = bench_robots.row_of("1", Load(2, 2), found, 6, 3.5)
    assert row["pace"] > 0 and row["server cores"] > 0 < row["client cores"]
    assert server._get_state().robots == 0

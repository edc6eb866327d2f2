"""What robots have from the simulation, areas, sessions, and what is left of it when processes are
killed: the simulation server, sensor servers, robots."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from omniORB import CORBA

from robocorba.map_editor.polygons import FloorArea
from robocorba.simulation.registry import LEASE_S
from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from testkit.simulation import (
    BACK_LIMIT_S,
    CLIENT,
    GONE,
    Chaos,
    ClientProcess,
    Place,
    away,
    error_lines,
    simulation,
)
from tests.system.state_files import state_files
from tests.waits import outlast, stays

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: In the west hall of L1: two areas that overlap.
WEST: FloorArea = ("L1", ((1.0, 10.0), (4.0, 10.0), (4.0, 12.0), (1.0, 12.0)))
BOTH: FloorArea = ("L1", ((3.0, 10.5), (6.0, 10.5), (6.0, 11.5), (3.0, 11.5)))
LIMIT_S = 300.0
ROUNDS = 3
#: Five times what the bench allows [s]: a machine that is busy with other tests writes later.
BUSY_LOST_S = 1.0
HALL = (2.0, 12.0)
GRANTED, WAITING = RoboCorba.AREAS_GRANTED, RoboCorba.WAITING_FOR_AREAS


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=2) as place:
        yield place
        assert [line for line in error_lines(place.running.state) if "ended by SIGKILL" not in line] == []


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    yield whole
    whole.let_go()


def struct(area: FloorArea) -> Any:
    floor, polygon = area
    return RoboCorba.FloorArea(floor, [RoboCorba.XY(*corner) for corner in polygon])


def phases(*sessions: Any) -> list[Any]:
    return [session.reservation().phase for session in sessions]


# ---- areas ----


def test_a_robot_whose_process_was_killed_frees_its_areas(place: Place) -> None:
    process = place.launch(*CLIENT, str(place.running.naming))
    assert process.stdin is not None and process.stdout is not None
    rows, areas = (msgspec.json.encode(value).decode() for value in ([("doomed", "L1", 2.0, 14.5)], [WEST]))
    for order, answer in ((rows, "ready"), (f"reserve {areas}", "reserved")):
        process.stdin.write(f"{order}\n")
        process.stdin.flush()
        assert process.stdout.readline() == f"{answer}\n"
    waiter = place.log_on("waiter", 4.0, 14.5)
    waiter.reserveAreas([struct(BOTH)], LIMIT_S)
    stays(lambda: phases(waiter) == [WAITING], 1.0)  # the other one lives
    process.kill()
    eventually(lambda: phases(waiter) == [GRANTED], what="the areas of the dead robot are free")


# ---- sessions ----


def test_who_is_killed_makes_room_and_nobody_else_loses_anything(place: Place) -> None:
    """With more rounds and a table: python -m bench.simulation.chaos"""
    with contextlib.closing(Chaos(place, seed=1, lost_s=BUSY_LOST_S)) as chaos:
        for _ in range(ROUNDS):
            outcome = chaos.round()
            assert outcome.is_right, outcome
    assert {process.state for process in place.running.record().processes} == {"running"}


def test_a_robot_whose_floor_went_and_that_logged_on_elsewhere_outlives_the_server(place: Place) -> None:
    floor = RoboCorba.Element(aFloor=RoboCorba.Floor("roof", 9, 40.0, 3.0, []))
    version = place.editor.create("", floor)
    eventually(lambda: "roof" in place.database.floors())
    before = place.log_on("a", 3.0, 3.0, floor="roof")
    place.editor.remove(RoboCorba.ElementId(RoboCorba.FLOOR_ELEMENT, "", "roof"), version)
    eventually(lambda: "roof" not in place.database.floors())
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        before.state()
    a = place.log_on("a", 3.0, 12.0)
    began = a.state().time
    eventually(lambda: a.state().time > began + 0.5, what="all is written")
    place.kill("simulation")

    def answers() -> bool:
        with contextlib.suppress(*GONE):
            return away(a.state(), RoboCorba.Pose("L1", 3.0, 12.0, 0.0)) == 0.0
        return False

    eventually(answers, BACK_LIMIT_S, "the robot is back")
    assert "a" in place.names
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        before.state()
    # The administrator's reference is still valid, too; secrets are nowhere but in its file, and with the robots.
    place.administrator.setLimit(300)
    for reference, prefix in ((a, b"sessions/"), (place.administrator, b"administrator/")):
        known = bytes.fromhex(place.orb.uri(reference).removeprefix("IOR:"))
        secret = known.partition(prefix)[2][:32]
        assert len(set(secret)) > 10
        files = state_files(place.running.state)
        assert [file.path.name for file in files if secret in file.content] == []
    assert [file.path.name for file in files if file.mode & 0o077] == []


def test_robots_stay_logged_on_when_all_was_held_up(place: Place) -> None:
    """By SIGSTOP, the server and its robots, so that none of their calls waits for the server meanwhile."""
    place.remove_outlines("L1", "L2", "L3")
    robots = ClientProcess(place, number=7).wait_ready()
    simulation_server = place.pid("simulation")
    for pid in (robots.process.pid, simulation_server):
        os.kill(pid, signal.SIGSTOP)
    outlast(1.4 * LEASE_S)
    for pid in (simulation_server, robots.process.pid):
        os.kill(pid, signal.SIGCONT)
    began = place.server._get_state().time
    eventually(lambda: place.server._get_state().time > began + LEASE_S, what="the time of a lease")
    assert robots.report()["lost"] == []
    assert robots.names <= place.names
    assert place.pid("simulation") == simulation_server
    robots.kill()

"""What is left of robots' sessions when processes are killed, or held up: the simulation server, sensor servers,
robots."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator

import pytest
from omniORB import CORBA

from robocorba.simulation.registry import LEASE_S
from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from testkit.simulation import (
    BACK_LIMIT_S,
    GONE,
    Chaos,
    ClientProcess,
    Place,
    away,
    error_lines,
    simulation,
)
from tests.system.state_files import state_files
from tests.waits import outlast

pytestmark = [pytest.mark.system, pytest.mark.full]

ROUNDS = 3
#: Five times what the bench allows [s]: a machine that is busy with other tests writes later.
BUSY_LOST_S = 1.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=2) as place:
        yield place
        assert [line for line in error_lines(place.running.state) if "ended by SIGKILL" not in line] == []


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    yield whole
    whole.let_go()


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

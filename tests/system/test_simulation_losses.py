"""Data pools and sessions of robots, and what is left of them when processes are killed: the simulation server, sensor
servers, robots."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from omniORB import CORBA

from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.corba import maps
from robocorba.map_editor.model import Wall
from robocorba.robot.corba.remote_data_pool import PoolFollower
from robocorba.robot.data_pool.pool import DataPool
from robocorba.simulation.registry import LEASE_S
from robocorba.simulation.sensor_admission import proof_of, read_token
from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from testkit.simulation import (
    BACK_LIMIT_S,
    GONE,
    Chaos,
    ClientProcess,
    Place,
    RemoteFloor,
    away,
    drive_to,
    error_lines,
    simulation,
)
from tests.waits import outlast

pytestmark = [pytest.mark.system, pytest.mark.slow(100), pytest.mark.full]

ROUNDS = 2
#: Ten times what the bench allows [s]: a machine that is busy with other tests writes later.
BUSY_LOST_S = 2.0
HALL = (2.0, 12.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=2) as place:
        yield place
        assert [line for line in error_lines(place.running.state) if "ended by SIGKILL" not in line] == []


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    yield whole
    whole.let_go()
    whole.administrator.setPace(1.0)


# ---- data pools ----


@contextlib.contextmanager
def following(place: Place, floor: str, oneself: str = "") -> Iterator[DataPool]:
    """A pool that is kept up to date, and knows the floor."""
    with contextlib.closing(PoolFollower(place.orb, floor, oneself).start()) as follower:
        assert follower.pool.floor == floor
        eventually(lambda: follower.pool.snapshot().is_known, BACK_LIMIT_S, "the pool knows its floor")
        yield follower.pool


def bodies(place: Place, floor: str) -> dict[str, tuple[float, ...]]:
    """Poses of all that is on a floor, by name, as the database has them."""
    copy = RemoteFloor(place.database, floor)
    copy.follow()
    rows = copy.view.motions[["x", "y", "heading"]].tolist()
    return {body.name: row for body, row in zip(copy.view.bodies.values(), rows, strict=True)}


def known(pool: DataPool) -> dict[str, tuple[float, ...]]:
    """The same as a pool has them."""
    snapshot = pool.snapshot()
    things = [*snapshot.robots, *(thing for thing in snapshot.objects() if thing.is_movable)]
    return {thing.name: (thing.x, thing.y, thing.heading) for thing in things}


def test_pools_follow_their_floor_and_survive_a_kill_of_the_simulation_server(place: Place) -> None:
    me = place.log_on("me", *HALL)
    place.log_on("above", *HALL, floor="L3")
    with following(place, "L1", "me") as pool:
        drive_to(me, (HALL[0] + 1.0, HALL[1]))
        eventually(lambda: known(pool) == bodies(place, "L1"), what="it is as the database says")
        place.editor.create("L2", maps.element(Wall("new", (1.0, 13.0), (1.4, 13.0))))  # which is another floor
        place.editor.create("L1", maps.element(Wall("newer", (1.0, 13.0), (1.4, 13.0))))
        eventually(lambda: pool.snapshot().nearest_non_robot(1.2, 13.1) == (pytest.approx(0.1), 1.2, 13.0, "newer"))
        pid = place.kill("simulation")
        eventually(lambda: pool.problem, what="the pool notices")
        lag_s = pool.lag_s
        assert pool.snapshot().robot("me")  # what was known stays
        with following(place, "L1"):  # which begins before the server answers
            eventually(lambda: pool.lag_s > lag_s or not pool.problem)
        eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S)
        eventually(lambda: not pool.problem and pool.lag_s < 1.0, BACK_LIMIT_S, "the pool follows again")
        drive_to(me, HALL)
        eventually(lambda: known(pool) == bodies(place, "L1"))
        assert pool.change_floor("L3")
        assert known(pool) == bodies(place, "L3")
        assert pool.snapshot().robot("above") and not pool.snapshot().robot("me")
        with pytest.raises(UnknownFloor, match="L9"):
            pool.change_floor("L9")


# ---- sessions ----


def test_who_is_killed_makes_room_and_nobody_else_loses_anything(place: Place) -> None:
    """With more rounds and a table: python -m bench.simulation.chaos"""
    with contextlib.closing(Chaos(place, seed=1, lost_s=BUSY_LOST_S)) as chaos:
        for _ in range(ROUNDS):
            outcome = chaos.round()
            assert outcome.is_right, outcome
    assert {process.state for process in place.running.record().processes} == {"running"}


class StateFile(NamedTuple):
    """content: empty for a folder. mode: the permissions."""

    path: Path
    content: bytes
    mode: int


def state_files(folder: Path) -> list[StateFile]:
    """Of the state folder of a running system, and of all that is in it; without what has gone since it was listed."""
    found = []
    for path in (folder, *folder.rglob("*")):
        with contextlib.suppress(FileNotFoundError):
            content = path.read_bytes() if path.is_file() else b""
            found.append(StateFile(path, content, path.stat().st_mode & 0o777))
    return found


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


def test_a_false_sensor_server_gets_no_robots(place: Place) -> None:
    server, state = place.server, place.running.state
    true = place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)

    def names() -> list[str]:
        return [sensor.name for sensor in server.sensors()]

    load = RoboCorba.SensorLoad(0.0, 0.0, 0.0, 0)
    for name in ("false", "s1"):
        with pytest.raises(CORBA.NO_PERMISSION):
            server.reportSensor(name, true, load, [])
        with pytest.raises(CORBA.NO_PERMISSION):
            server.reportScans(name, [])
        with pytest.raises(RoboCorba.SensorRefused, match="token"):
            server.registerSensor(name, true, "guessed")
    # A proof that was overheard is good for the reference only that it was made for.
    token = read_token(state / "sensors.token")
    with pytest.raises(RoboCorba.SensorRefused):
        server.registerSensor("false", place.orb.resolve("MapEditor", CORBA.Object), proof_of(token, "false", "other"))
    assert names() == ["s1", "s2"]
    assert (state / "sensors.token").stat().st_mode & 0o077 == 0
    registered = server.registerSensor("more", true, proof_of(token, "more", place.orb.uri(true)))
    registered.report(load, [])
    assert names() == ["more", "s1", "s2"]
    eventually(lambda: names() == ["s1", "s2"], what="one that reports no more is gone")

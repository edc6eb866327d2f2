"""Data pools of the running system: real servers, a real robot, and another robot's pool in another process."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest

from robocorba.corba.conversion import maps
from robocorba.corba.remote.data_pool import PoolFollower, RemotePool
from robocorba.corba.remote.omni_database import RemoteFloor
from robocorba.data_pool.pool import DataPool
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import UnknownPlan
from robocorba.errors.services import NotReachable
from robocorba.maps.model import Wall
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually
from robocorba.testing.simulation import BACK_LIMIT_S, Place, drive_to, simulation

pytestmark = [pytest.mark.system, pytest.mark.full]

HALL = (2.0, 12.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("pools"), sensors=1) as place:
        yield place


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    yield whole
    whole.let_go()


@contextlib.contextmanager
def following(place: Place, floor: str, oneself: str = "") -> Iterator[DataPool]:
    """A pool that is kept up to date, and knows the floor."""
    with contextlib.closing(PoolFollower(place.orb, floor, oneself).start()) as follower:
        eventually(lambda: follower.pool.snapshot().is_known, what="the pool knows its floor")
        yield follower.pool


@contextlib.contextmanager
def another_robot(place: Place, floor: str, name: str) -> Iterator[tuple[RemotePool, Any]]:
    """Its pool, read over CORBA, and its process."""
    process = place.launch(
        sys.executable, str(Path(__file__).with_name("data_pool_server.py")), str(place.running.naming), floor, name
    )
    try:
        yield RemotePool.of_robot(place.orb, name, 20.0), process
    finally:
        process.kill()
        process.wait()


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


def test_the_pool_follows_a_robot_that_drives(place: Place) -> None:
    me = place.log_on("me", *HALL)
    place.log_on("other", HALL[0], HALL[1] + 2.0)
    with following(place, "L1", "me") as pool:
        drive_to(me, (HALL[0] + 2.0, HALL[1]))
        at = eventually(lambda: me.state().moving.ahead == 0.0 and me.state().at)
        seen = eventually(
            lambda: (one := pool.snapshot().robot("me")) and math.dist((one.x, one.y), (at.x, at.y)) < 1e-9 and one
        )
        assert (pool.problem, pool.floor, seen.radius_m) == ("", "L1", pytest.approx(0.3))
        eventually(lambda: known(pool) == bodies(place, "L1"), what="it is as the database says")
        assert [near.robot.name for near in pool.snapshot().robots_near(*HALL, 3.0)] == ["other"]
        near = pool.snapshot().nearest_non_robot(-0.5, 12.0)
        assert near and near[:3] == (0.5, 0.0, 12.0)
        assert near.name in ("wall-west", "L1")  # the wall runs along the floor's bounds
        eventually(lambda: 0.0 <= pool.lag_s < 2.0)


def test_another_floor_with_the_walls_of_that_one(place: Place) -> None:
    place.log_on("below", *HALL)
    place.log_on("above", *HALL, floor="L3")
    with following(place, "L1") as pool:
        assert pool.change_floor("L3")
        assert known(pool) == bodies(place, "L3")
        assert pool.snapshot().robot("above")
        assert not pool.snapshot().robot("below")
        walls = pool.snapshot().walls
        assert walls and walls.floor == "L3"
        with pytest.raises(UnknownFloor, match="L9"):
            pool.change_floor("L9")
        assert pool.floor == "L3"


def test_edits_of_the_map_are_followed(place: Place) -> None:
    with following(place, "L1") as pool:
        before = pool.snapshot().nearest_non_robot(1.2, 11.1)
        place.editor.create("L2", maps.element(Wall("new", (1.0, 11.0), (1.4, 11.0))))
        place.editor.create("L1", maps.element(Wall("newer", (1.0, 13.0), (1.4, 13.0))))
        eventually(lambda: pool.snapshot().nearest_non_robot(1.2, 13.1) == (pytest.approx(0.1), 1.2, 13.0, "newer"))
        assert pool.snapshot().nearest_non_robot(1.2, 11.1) == before  # L2 is another floor


def test_the_pool_survives_a_kill_of_the_simulation_server(place: Place) -> None:
    me = place.log_on("me", *HALL)
    with following(place, "L1", "me") as pool:
        eventually(lambda: pool.snapshot().robot("me"))
        pid = place.kill("simulation")
        eventually(lambda: pool.problem, what="the pool notices")
        lag_s = pool.lag_s
        assert pool.snapshot().robot("me")  # what was known stays
        eventually(lambda: pool.lag_s > lag_s or not pool.problem)
        eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S)
        eventually(lambda: not pool.problem and pool.lag_s < 1.0, BACK_LIMIT_S, "the pool follows again")
        drive_to(me, (HALL[0] + 1.0, HALL[1]))
        eventually(lambda: abs((pool.snapshot().robot("me") or me.state().at).x - HALL[0] - 1.0) < 0.1)
        eventually(lambda: known(pool) == bodies(place, "L1"))


def test_another_process_is_read_over_corba(place: Place) -> None:
    below = place.log_on("below", *HALL)
    place.log_on("above", 5.0, 4.0, floor="L2")
    below.reportPosture([0.5, -0.5])
    with another_robot(place, "L1", "leader") as (pool, process):
        eventually(lambda: pool.lag_s < math.inf, what="it knows its floor")
        assert pool.floor == "L1"
        whole = pool.content()
        assert (whole.floor, whole.since) == ("L1", 0)
        assert "below" in {body.name for body in whole.came}
        assert [posture.joints for posture in pool.postures(0.0)] == [(0.5, -0.5)]
        below.command(RoboCorba.Velocity(0.5, 0.0, 0.0), 1.0)
        moved = eventually(lambda: len((update := pool.changes(whole.version)).motions) and update)
        assert (moved.since, moved.came) == (whole.version, [])
        plan = pool.plan("carry")
        assert (plan.name, plan.version) == ("carry", 2)
        assert msgpack.unpackb(plan.content) == {"table": "T1", "robots": ["leader", "other"]}
        assert pool.plans() == [plan]
        with pytest.raises(UnknownPlan, match="fetch"):
            pool.plan("fetch")
        process.stdin.write("L2\n")
        process.stdin.flush()
        assert process.stdout.readline() == "True\n"
        assert pool.floor == "L2"
        assert {body.name for body in pool.content().came} == set(bodies(place, "L2"))
        assert pool.postures(0.0) == []
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        for ask in (pool.content, pool.plans, lambda: pool.lag_s):
            with pytest.raises(NotReachable, match="data pool"):
                ask()
    with pytest.raises(NotReachable):
        RemotePool.of_robot(place.orb, "nobody", 0.2)


def test_a_pool_begins_before_the_servers_answer(place: Place) -> None:
    pid = place.kill("simulation")
    with contextlib.closing(PoolFollower(place.orb, "L1").start()) as follower:
        assert follower.pool.floor == "L1"
        eventually(lambda: follower.pool.snapshot().is_known, BACK_LIMIT_S)
    eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S)

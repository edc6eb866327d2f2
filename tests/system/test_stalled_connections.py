"""Clients that stall or ask for much, beside a robot and other clients."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.attacks import connections, greedy_clients, stalled_connections
from robocorba.testing.processes import eventually
from robocorba.testing.simulation import NO_MOUNT, Place, simulation

pytestmark = [pytest.mark.system, pytest.mark.full]

#: More than a server has threads in any pool.
STALLED = 40
#: Simulated time that passes during an attack [s]; the lease of a robot is 2 s.
ATTACK_S = 3.0


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("attacked"), sensors=1) as place:
        yield place


@pytest.fixture(autouse=True)
def all_robots_leave(place: Place) -> Iterator[None]:
    yield
    place.let_go()


def check_a_robot_and_a_client(place: Place) -> None:
    """A robot stays logged on, and every server answers a client, while time passes."""
    session = place.log_on("R", 6.0, 6.0)
    began = session.state().time
    planner = place.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    channel = place.orb.resolve("EventChannels/main", RoboCorba.EventChannel)
    sensor = session._get_sensor()

    def has_passed() -> bool:
        assert (channel._get_name(), planner._get_mapVersion() > 0) == ("main", True)
        assert place.editor._get_currentVersion() > 0
        assert sensor.laser().rays > 0
        assert place.server._get_state().robots == 1
        place.orb.check_naming()
        return bool(session.state().time > began + ATTACK_S)

    eventually(has_passed, 60.0, "the simulated time")
    assert place.names == {"R"}


def test_stalled_connections_harm_nobody(place: Place) -> None:
    with contextlib.ExitStack() as attack:
        endpoints = [process.endpoint for process in place.running.record().processes if process.endpoint]
        assert len(endpoints) == 5  # naming service, map editor, simulation, sensor and channel
        for endpoint in endpoints:
            attack.enter_context(stalled_connections(Address.parse(endpoint), STALLED))
        check_a_robot_and_a_client(place)


def test_garbage_fills_no_log(place: Place) -> None:
    logs = [place.running.state / "logs" / f"{name}.log" for name in ("simulation", "map_editor", "omniNames")]
    before = [log.stat().st_size if log.exists() else 0 for log in logs]
    refused = b"GIOP\1\2\3\1\xff\xff\xff\xff garbage"  # omniORB reports messages of this length
    for process in place.running.record().processes:
        if process.endpoint:
            with connections(Address.parse(process.endpoint), [refused] * 50):
                pass
    check_a_robot_and_a_client(place)
    after = [log.stat().st_size if log.exists() else 0 for log in logs]
    assert all(then <= now < then + 2000 for then, now in zip(before, after, strict=True))


def test_pictures_harm_nobody(place: Place) -> None:
    with greedy_clients(place.launch, place.running.naming, "pictures", 10):
        check_a_robot_and_a_client(place)


def test_long_plans_harm_nobody(place: Place) -> None:
    """A short query is answered while forty long ones wait; each would take up to a second."""
    planner = place.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L1", 15.0, 3.0)
    with greedy_clients(place.launch, place.running.naming, "plans", 40):
        check_a_robot_and_a_client(place)
        assert len(planner.getPath(start, goal)) > 1
        assert len(planner.findPaths(planner.defaultRequest(start, goal))) == 1


def test_large_scans_harm_nobody(place: Place) -> None:
    """The sensor keeps up with the simulation, and a robot scans, while thirty calls for a million rays wait."""
    session = place.log_on("R", 6.0, 6.0)
    sensor = session._get_sensor()
    with greedy_clients(place.launch, place.running.naming, "scans", 30):
        for _ in range(20):
            assert len(sensor.scan(session.state().at, NO_MOUNT, sensor.laser()).distances) > 100

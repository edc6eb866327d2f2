"""Garbage on the wire, and clients that stall or ask for much, beside a robot and other clients: the simulation goes on
as it was."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import psutil
import pytest

from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.attacks import connections, greedy_clients, stalled_connections
from testkit.processes import eventually
from testkit.simulation import CROSS, NO_MOUNT, Place, error_lines, simulation

pytestmark = [pytest.mark.system, pytest.mark.full]

#: What servers may grow by over all of this module, MiB. Single messages of it have up to 40 MB.
GROWTH_MIB = 200
SERVERS = ("simulation", "sensor_s1")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """The same processes serve at the end, have not grown much and complain of nothing."""
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=1) as place:
        processes = {name: psutil.Process(place.pid(name)) for name in SERVERS}
        began = {name: process.memory_info().rss for name, process in processes.items()}
        yield place
        assert {name: place.pid(name) for name in SERVERS} == {name: one.pid for name, one in processes.items()}
        grown_mib = {name: (one.memory_info().rss - began[name]) / 2**20 for name, one in processes.items()}
        print("\n" + ", ".join(f"{name} grew by {grown:.0f} MiB" for name, grown in grown_mib.items()))
        assert max(grown_mib.values()) < GROWTH_MIB
        assert error_lines(place.running.state) == []


@pytest.fixture(autouse=True)
def all_is_well(place: Place) -> Iterator[None]:
    """After each test time goes on, and a robot can log on, drive and see."""
    yield
    place.let_go()
    began = place.server._get_state()
    assert (began.pace, began.paused, began.limit) == (1.0, False, 300)
    robot = place.log_on("well", 2.0, 12.0)
    robot.command(RoboCorba.Velocity(1.0, 0.0, 0.0), 0.2)
    eventually(lambda: robot.state().at.x > 2.01, what="a robot drives")
    eventually(lambda: place.server._get_state().time > began.time, what="time passes")
    sensor = robot._get_sensor()
    eventually(lambda: 4.0 < sensor.scan(robot.state().at, NO_MOUNT, CROSS).distances[0] < 7.0, what="it sees a wall")
    place.let_go()


#: More than a server has threads in any pool.
STALLED = 40
#: Simulated time that passes during an attack [s]; the lease of a robot is 2 s.
ATTACK_S = 3.0


def check_a_robot_and_a_client(place: Place) -> None:
    """A robot stays logged on and scans, and every server answers a client, while time passes."""
    session = place.log_on("R", 6.0, 6.0)
    began = session.state().time
    planner = place.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    channel = place.orb.resolve("EventChannels/main", RoboCorba.EventChannel)
    sensor = session._get_sensor()
    start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L1", 15.0, 3.0)

    def has_passed() -> bool:
        assert (channel._get_name(), planner._get_mapVersion() > 0) == ("main", True)
        assert place.editor._get_currentVersion() > 0
        assert len(sensor.scan(session.state().at, NO_MOUNT, sensor.laser()).distances) > 100
        assert place.server._get_state().robots == 1
        place.orb.check_naming()
        return bool(session.state().time > began + ATTACK_S)

    eventually(has_passed, what="the simulated time")
    assert place.names == {"R"}
    assert len(planner.getPath(start, goal)) > 1
    assert len(planner.findPaths(planner.defaultRequest(start, goal))) == 1


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
    garbage = b"GIOP\1\2\3\1\xff\xff\xff\xff garbage"  # omniORB reports messages of this length
    for process in place.running.record().processes:
        if process.endpoint:
            with connections(Address.parse(process.endpoint), [garbage] * 50):
                pass
    check_a_robot_and_a_client(place)
    after = [log.stat().st_size if log.exists() else 0 for log in logs]
    assert all(then <= now < then + 2000 for then, now in zip(before, after, strict=True))


@pytest.mark.parametrize(("wanted", "clients"), [("pictures", 10), ("plans", 40), ("scans", 30)])
def test_greedy_clients_harm_nobody(place: Place, wanted: str, clients: int) -> None:
    """Each of their plans takes up to a second, each of their calls for scans is for a million rays."""
    with greedy_clients(place.launch, place.running.naming, wanted, clients):
        check_a_robot_and_a_client(place)

"""Logging on and off, leases, limits, and who senses for whom."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from robocorba.errors import InvalidDescription, NameTaken, ServerFull, SessionExpired, UnknownRobot
from robocorba.simulation.physics import Limits
from robocorba.simulation.registry import Description, Pose, Registry


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def registry(clock: Clock) -> Registry:
    return Registry(3, clock, lease_s=2.0)


def robot(name: str) -> Description:
    return Description(name, Pose("L1", 1.0, 2.0))


def test_each_robot_has_a_secret_of_its_own(registry: Registry) -> None:
    keys = {registry.register(robot(name)).key for name in "ABC"}
    assert len(keys) == 3
    assert all(len(key) >= 32 for key in keys)
    for key in ("", "A", "x" * 32):
        with pytest.raises(SessionExpired):
            registry.heard(key)


def test_a_name_and_a_slot_are_taken_until_they_are_free(registry: Registry, clock: Clock) -> None:
    clients = [registry.register(robot(name)) for name in "ABC"]
    with pytest.raises(NameTaken):
        registry.register(robot("B"))
    clock.now += 0.5
    with pytest.raises(ServerFull) as full:
        registry.register(robot("D"))
    assert (full.value.limit, full.value.now, full.value.retry_s) == (3, 3, pytest.approx(1.5))
    registry.deregister(clients[1].key)
    registry.register(robot("B"))
    registry.evict("A")
    with pytest.raises(UnknownRobot):
        registry.evict("A")
    with pytest.raises(SessionExpired):
        registry.heard(clients[0].key)
    registry.register(robot("D"))
    registry.limit = 2  # nobody is sent away, but nobody comes in
    assert len(registry) == 3
    registry.evict("B")
    with pytest.raises(ServerFull):
        registry.register(robot("E"))


def test_whoever_is_not_heard_of_is_logged_off(registry: Registry, clock: Clock) -> None:
    alive, dead = registry.register(robot("A")), registry.register(robot("B"))
    for _ in range(5):
        clock.now += 1.0
        registry.heard(alive.key)
        gone = registry.expire()
        assert gone in ([], [dead])
    assert [client.name for client in registry.clients] == ["A"]
    assert alive.calls == 5
    with pytest.raises(SessionExpired):
        registry.heard(dead.key)
    registry.register(robot("B"))


def test_a_session_outlives_the_server(clock: Clock) -> None:
    key = Registry(3, clock).register(robot("A")).key
    after = Registry(3, clock)
    after.restore(robot("A"), key)
    assert after.heard(key).name == "A"
    with pytest.raises(NameTaken):
        after.register(robot("A"))


def test_robots_go_to_the_sensor_process_with_the_least_load(clock: Clock) -> None:
    registry = Registry(100, clock)
    assert registry.register(robot("early")).sensor == ""
    registry.sensor_is("S1", 0.0)
    registry.sensor_is("S2", 0.0)
    for number in range(19):
        registry.register(robot(f"R{number}"))
    shares = Counter(client.sensor for client in registry.clients)
    assert shares == {"S1": 10, "S2": 10}
    registry.sensor_is("S1", 0.8)
    registry.sensor_is("S2", 0.2)  # as many robots, but they ask less
    for number in range(10):
        assert registry.register(robot(f"Q{number}")).sensor == "S2"


def test_robots_of_a_sensor_process_that_died_move_to_the_others(clock: Clock) -> None:
    registry = Registry(100, clock)
    for name in ("S1", "S2", "S3"):
        registry.sensor_is(name, 0.1)
    for number in range(30):
        registry.register(robot(f"R{number}"))
    moved = registry.sensor_is_gone("S2")
    assert len(moved) == 10
    assert Counter(client.sensor for client in registry.clients) == {"S1": 15, "S3": 15}
    registry.sensor_is_gone("S1")
    registry.sensor_is_gone("S3")
    assert {client.sensor for client in registry.clients} == {""}
    registry.sensor_is("S4", 0.0)
    assert {client.sensor for client in registry.clients} == {"S4"}


@pytest.mark.parametrize(
    ("field", "changed"),
    [
        ("name", {"name": ""}),
        ("name", {"name": "../x"}),
        ("name", {"name": "x" * 61}),
        ("x", {"pose": Pose("L1", math.nan, 0.0)}),
        ("y", {"pose": Pose("L1", 0.0, math.inf)}),
        ("heading", {"pose": Pose("L1", 0.0, 0.0, math.nan)}),
        ("radius", {"radius_m": 0.0}),
        ("radius", {"radius_m": math.nan}),
        ("mass", {"mass_kg": -1.0}),
        ("speed", {"limits": Limits(speed=math.inf)}),
        ("acceleration", {"limits": Limits(acceleration=0.0)}),
    ],
)
def test_a_description_that_can_not_be_names_the_field(field: str, changed: dict) -> None:
    with pytest.raises(InvalidDescription) as refused:
        Description(**{"name": "A", "pose": Pose("L1", 0.0, 0.0), **changed})
    assert refused.value.field == field

"""Logging on and off, leases, limits."""

from __future__ import annotations

import math

import pytest

from robocorba.errors.simulation import InvalidDescription, NameTaken, ServerFull, SessionExpired, UnknownRobot
from robocorba.simulation.physics import Limits
from robocorba.simulation.registry import Description, Registry
from robocorba.spatial.pose import Pose
from tests.clock import Clock
from tests.simulation.places import robot


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def registry(clock: Clock) -> Registry:
    return Registry(3, clock, lease_s=2.0)


def test_each_robot_has_a_secret_of_its_own(registry: Registry) -> None:
    keys = {registry.register(robot(name)).key for name in "ABC"}
    assert len(keys) == 3
    assert all(len(key) >= 32 for key in keys)


def test_a_name_and_a_slot_are_taken_until_the_log_off(registry: Registry, clock: Clock) -> None:
    clients = [registry.register(robot(name)) for name in "ABC"]
    with pytest.raises(NameTaken):
        registry.register(robot("B"))
    clock.now += 0.5
    with pytest.raises(ServerFull) as full:
        registry.register(robot("D"))
    assert (full.value.limit, full.value.now, full.value.retry_s) == (3, 3, pytest.approx(1.5))
    registry.remove(clients[1])
    registry.register(robot("B"))
    registry.remove(registry.find("A"))
    with pytest.raises(UnknownRobot):
        registry.find("A")
    with pytest.raises(SessionExpired):
        clients[0].renew_lease()
    with pytest.raises(SessionExpired):
        registry.remove(clients[0])
    registry.register(robot("D"))
    registry.limit = 2  # nobody is sent away, but nobody comes in
    assert len(registry) == 3
    registry.remove(registry.find("B"))
    with pytest.raises(ServerFull):
        registry.register(robot("E"))


def test_a_call_in_progress_keeps_the_lease(registry: Registry, clock: Clock) -> None:
    client = registry.register(robot("A"))
    client.begin_call()
    clock.now += 5.0
    assert registry.expired() == []
    client.begin_call()
    client.end_call()
    clock.now += 5.0
    assert registry.expired() == []
    client.end_call()
    assert registry.expired() == []
    clock.now += 2.1
    assert registry.expired() == [client]


def test_a_robot_that_does_not_call_is_found(registry: Registry, clock: Clock) -> None:
    alive, dead = registry.register(robot("A")), registry.register(robot("B"))
    for _ in range(5):
        clock.now += 1.0
        alive.renew_lease()
        for client in registry.expired():
            assert client is dead
            registry.remove(client)
    assert [client.name for client in registry.clients] == ["A"]
    assert alive.call_rate == pytest.approx(1.0)
    registry.register(robot("B"))


def test_a_session_outlives_the_server(clock: Clock) -> None:
    client = Registry(3, clock).register(robot("A"))
    clock.now += 60.0
    after = Registry(3, clock)
    again = after.restore(robot("A"), client.key, client.since)
    assert (again.key, again.since) == (client.key, client.since)
    assert after.expired() == []
    with pytest.raises(NameTaken):
        after.register(robot("A"))


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
def test_an_invalid_description_names_the_field(field: str, changed: dict) -> None:
    with pytest.raises(InvalidDescription) as refused:
        Description(**{"name": "A", "pose": Pose("L1", 0.0, 0.0), **changed})
    assert refused.value.field == field

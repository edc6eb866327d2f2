"""Floors that nobody scans cost next to nothing, and the first scan on one sees the present."""

from __future__ import annotations

import numpy as np
import pytest

from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UpdateMismatch
from robocorba.maps.model import Building
from robocorba.sensing.fan import Fan
from robocorba.sensing.floor_follower import QUIET_INTERVAL_S, SCAN_WINDOW_S, FloorFollower
from robocorba.sensing.scan import Mount, ScanSpec
from robocorba.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.spatial.floor_update import FloorUpdate
from robocorba.spatial.pose import Pose
from tests.clock import Clock
from tests.simulation.places import robot, tower

INTERVAL_S = 0.03
AHEAD = ScanSpec(Fan(0.0, 0.1, 1, 9.0))


class Followed:
    """A building of two floors, and a follower that notes the floors that it asks for."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.world = SimulatedBuilding(tower())
        self._database = OmniDatabase(self.world)
        self.sensor = VirtualSensor(self.clock)
        self.sensor.set_map(self.world.building)
        self.follower = FloorFollower(self.sensor, self._changes, self.clock)
        self.asked: list[str] = []
        self.error: Exception | None = None

    def _changes(self, floor: str, since: int) -> FloorUpdate:
        self.asked.append(floor)
        if self.error:
            raise self.error
        return self._database.changes(floor, since)

    def follow(self, seconds: float) -> dict[str, int]:
        """Follow for some time; returns how often each floor was asked for."""
        self.asked.clear()
        for _ in range(round(seconds / INTERVAL_S)):
            self.clock.now += INTERVAL_S
            self.follower.follow()
        return {floor: self.asked.count(floor) for floor in ("L1", "L2")}

    def scan(self, x: float) -> float:
        """Distance ahead of (x, 2) on L1."""
        self.follower.prepare(["L1"])
        return float(self.sensor.scan("L1", np.array([[x, 2.0, 0.0]]), Mount(), AHEAD, "A").distances[0, 0])


@pytest.fixture
def place() -> Followed:
    place = Followed()
    place.world.add(robot("A", "L1", 5.0, 2.0))
    place.world.add(robot("B", "L1", 7.0, 2.0))
    place.world.refresh()
    place.follow(INTERVAL_S)
    return place


def test_only_floors_with_scans_are_followed_at_every_call(place: Followed) -> None:
    seldom = place.follow(30.0)
    assert seldom["L1"] == seldom["L2"] <= 30.0 / QUIET_INTERVAL_S
    place.scan(5.0)
    often = place.follow(SCAN_WINDOW_S - INTERVAL_S)
    assert often["L1"] == round(SCAN_WINDOW_S / INTERVAL_S) - 1
    assert often["L2"] <= SCAN_WINDOW_S / QUIET_INTERVAL_S
    place.follow(2 * INTERVAL_S)
    assert place.follow(30.0) == pytest.approx(seldom, abs=1)
    assert place.sensor.lag_s <= QUIET_INTERVAL_S


def test_the_first_scan_sees_where_robots_are_now(place: Followed) -> None:
    near = place.scan(5.0)
    place.follow(SCAN_WINDOW_S + 1.0)
    place.world.place("B", Pose("L1", 9.0, 2.0, 0.0))
    assert place.scan(5.0) == pytest.approx(near + 2.0)
    place.asked.clear()
    place.scan(5.0)
    assert place.asked == []  # only the first one waits for an update


@pytest.mark.parametrize("error", [NotReachable("the simulation server"), UpdateMismatch("L1", 1, 2)])
def test_a_first_scan_takes_what_is_there_when_no_update_comes(place: Followed, error: Exception) -> None:
    before = place.scan(5.0)
    place.follow(SCAN_WINDOW_S + 0.3)
    place.error = error
    assert place.scan(5.0) == before


def test_an_unknown_floor_is_left_to_the_scan_and_a_removed_one_forgotten(place: Followed) -> None:
    place.asked.clear()
    place.follower.prepare(["roof"])
    assert place.asked == []
    building = place.world.building
    place.follower.set_map(Building(building.name, {"L1": building.floors["L1"]}))
    assert place.follow(10.0)["L2"] == 0
    place.asked.clear()
    place.follower.prepare(["L2"])
    assert place.asked == []

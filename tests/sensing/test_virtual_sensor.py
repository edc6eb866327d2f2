"""The virtual sensor: scans of robots in a building that it follows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.sensing import InvalidScan, SensorBehind
from robocorba.maps.model import ElementKind, Wall
from robocorba.sensing.fan import LASER, PROXIMITY, Fan
from robocorba.sensing.reports import Reports
from robocorba.sensing.scan import Mount, Noise, ScanSpec
from robocorba.sensing.virtual_sensor import LAG_LIMIT_S, MAX_RAYS_AT_ONCE, VirtualSensor
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.spatial.pose import Pose
from tests.clock import Clock
from tests.simulation.places import robot, tower

AHEAD = ScanSpec(Fan(0.0, 0.1, 1, 9.0))


class Following:
    """A building, and a sensor that follows it."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.world = SimulatedBuilding(tower())
        self.database = OmniDatabase(self.world)
        self.sensor = VirtualSensor(self.clock)
        self.sensor.set_map(self.world.building)

    def follow(self) -> None:
        self.world.refresh()
        for floor in self.sensor.floors:
            self.sensor.follow(self.database.changes(floor, self.sensor.version(floor)), self.clock())

    def ahead(
        self,
        x: float,
        y: float,
        heading: float,
        own_robot: str | None = None,
        floor: str = "L1",
        mount: Mount | None = None,
    ) -> float:
        seen = self.sensor.scan(floor, np.array([[x, y, heading]]), mount or Mount(), AHEAD, own_robot)
        return float(seen.distances[0, 0])


@pytest.fixture
def place() -> Following:
    place = Following()
    for name, x in (("A", 5.0), ("B", 7.0)):
        place.world.add(robot(name, "L1", x, 2.0))
    place.follow()
    return place


def test_a_robot_sees_the_others_and_not_itself(place: Following) -> None:
    assert place.ahead(5.0, 2.0, 0.0, "A") == pytest.approx(1.6)
    assert place.ahead(5.0, 2.0, 0.0) == pytest.approx(1.6)  # the sensor is on the robot at this pose
    assert place.ahead(5.0, 2.0, 0.0, "C") == 0.0  # a robot that is elsewhere
    assert place.ahead(6.0, 2.0, 0.0) == pytest.approx(0.6)
    assert place.ahead(6.0, 2.0, math.pi) == pytest.approx(0.6)


def test_the_mount_is_taken_into_account(place: Following) -> None:
    mount = Mount(0.2, 0.1, math.pi)
    assert place.ahead(7.0, 2.0, 0.0, "B", mount=mount) == pytest.approx(7.2 - 5.0 - math.sqrt(0.4**2 - 0.1**2))


def test_changed_walls_objects_and_doors_are_seen(place: Following) -> None:
    assert place.ahead(4.0, 1.0, math.pi) == pytest.approx(1.0)  # the wall W1
    before = place.ahead(0.5, 2.0, 0.0)
    assert before == pytest.approx(1.0, abs=0.2)  # the table
    place.world.update(place.world.building.without(ElementKind.OBJECT, "L1", "T1"))
    place.follow()
    assert place.ahead(0.5, 2.0, 0.0) == pytest.approx(2.5)
    assert place.ahead(5.0, 3.0, math.pi / 2) == pytest.approx(1.0)  # the elevator's door
    place.world.add(robot("C", "L1", 8.0, 5.0))
    place.world.elevators.call("C", "E1", "L2")
    for _ in range(100):
        place.world.step()
    place.follow()
    assert place.ahead(5.0, 3.0, math.pi / 2) == pytest.approx(3.0)  # it is open, and the cabin's wall is seen
    assert place.ahead(5.0, 3.0, math.pi / 2, floor="L2") == pytest.approx(1.0)
    place.sensor.set_map(place.world.building.with_element("L1", Wall("W2", (4.0, 2.5), (6.0, 2.5))))
    assert place.ahead(5.0, 2.0, math.pi / 2) == pytest.approx(0.5)


@pytest.mark.parametrize("far", [1e5, 1e17, 1e300, -1e300, 1.7e308])
@pytest.mark.parametrize("which", range(3))
def test_numbers_of_any_size_are_scanned(place: Following, far: float, which: int) -> None:
    """Nothing is near that place; any heading is one."""
    robots = np.array([[5.0, 2.0, 0.0]])
    robots[0, which] = far
    for spec in (ScanSpec(LASER), ScanSpec(PROXIMITY, 0.4)):
        distances = place.sensor.scan("L1", robots, Mount(), spec).distances
        assert ((distances >= 0.0) & (distances <= spec.fan.range_m)).all()
        assert which == 2 or (distances == spec.fan.range_m).all()


def test_a_proximity_sensor_measures_from_the_rim(place: Following) -> None:
    seen = place.sensor.scan("L1", np.array([[5.9, 2.0, 0.0]]), Mount(), ScanSpec(PROXIMITY, 0.4), "C")
    assert seen.distances[0, 0] == pytest.approx(7.0 - 0.4 - 5.9 - 0.4)
    assert seen.distances[0, 2] == PROXIMITY.range_m
    assert seen.distances.min() >= 0.0


def test_a_scan_at_many_poses_equals_single_scans(place: Following) -> None:
    chance = np.random.default_rng(3)
    robots = np.column_stack([chance.uniform(0.5, 9.5, (50, 2)), chance.uniform(-4, 4, 50)])
    spec = ScanSpec(LASER)
    together = place.sensor.scan("L1", robots, Mount(0.1), spec).distances
    alone = [place.sensor.scan("L1", robots[k : k + 1], Mount(0.1), spec).distances[0] for k in range(50)]
    assert np.array_equal(together, alone)


def test_noise_is_the_same_for_the_same_seed(place: Following) -> None:
    robots = np.array([[6.0, 2.0, 0.0]])

    def read(seed: int) -> list[float]:
        return place.sensor.scan("L1", robots, Mount(), ScanSpec(LASER, 0.0, Noise(0.05), seed)).distances[0].tolist()

    assert read(1) == read(1) != read(2)


def test_scans_of_outdated_floor_data_are_refused(place: Following) -> None:
    place.clock.now += LAG_LIMIT_S - 0.01
    place.ahead(6.0, 2.0, 0.0)
    assert place.sensor.lag_s == pytest.approx(LAG_LIMIT_S - 0.01)
    place.clock.now += 0.02
    with pytest.raises(SensorBehind):
        place.ahead(6.0, 2.0, 0.0)
    fresh = VirtualSensor(place.clock)
    fresh.set_map(tower())
    with pytest.raises(SensorBehind):
        fresh.scan("L1", np.zeros((1, 3)), Mount(), AHEAD)
    with pytest.raises(UnknownFloor):
        fresh.scan("roof", np.zeros((1, 3)), Mount(), AHEAD)


@pytest.mark.parametrize(
    ("robots", "mount"),
    [
        ([[math.nan, 0.0, 0.0]], Mount()),
        ([[1.0, 1.0, 0.0], [0.0, 0.0, math.inf]], Mount()),
        ([[0.0, 0.0, 0.0]], Mount(math.nan)),
        ([[0.0, 0.0, 0.0]], Mount(0.0, 0.0, -math.inf)),
        ([[0.0, 0.0, 0.0]] * (MAX_RAYS_AT_ONCE // LASER.count + 1), Mount()),
    ],
)
def test_an_invalid_scan_is_refused(place: Following, robots: list[list[float]], mount: Mount) -> None:
    with pytest.raises(InvalidScan):
        place.sensor.scan("L1", np.array(robots), mount, ScanSpec(LASER))


@pytest.mark.parametrize("rim", [-0.1, math.nan, 101.0])
def test_an_invalid_rim_is_refused(rim: float) -> None:
    with pytest.raises(InvalidScan):
        ScanSpec(LASER, rim)
    with pytest.raises(InvalidScan):
        ScanSpec(Fan(0.0, 0.1, 1, 1000.0), 1.0)


def test_reports_hold_the_load_and_the_last_scans(place: Following) -> None:
    cpu = Clock()
    reports = Reports(place.sensor, place.clock, cpu)
    spec = ScanSpec(LASER, 0.2)
    for name in ("A", "A", None):
        seen = place.sensor.scan("L1", np.array([[5.0, 2.0, 0.3]]), Mount(), spec, name)
        reports.record_scan(name, Pose("L1", 5.0, 2.0, 0.3), Mount(), spec, seen)
    place.clock.now += 2.0
    cpu.now += 0.5
    (last,) = reports.collect()
    assert (last.robot, last.at) == ("A", ("L1", 5.0, 2.0, 0.3))
    assert last.distances == pytest.approx(seen.distances[0] + 0.2)
    load = reports.load
    assert (load.busy, load.scan_rate) == (pytest.approx(0.25), pytest.approx(1.5))
    assert reports.collect() == []


def test_reports_hold_each_sensor_of_a_robot_and_what_its_rays_hit(place: Following) -> None:
    reports, at = Reports(place.sensor, place.clock, Clock()), Pose("L1", 5.0, 2.0, 0.3)
    for mount, spec in ((Mount(), ScanSpec(LASER)), (Mount(0.1), ScanSpec(PROXIMITY, 0.4, seed=5))):
        for _ in range(2):
            seen = place.sensor.scan("L1", np.array([at[1:]]), mount, spec, "A")
            reports.record_scan("A", at, mount, spec, seen)
    reports.record_scan(None, at, mount, spec, seen)
    laser, ring = reports.collect_robot_scans()
    assert (laser.robot, laser.at, laser.mount, laser.range_m, laser.rim_m) == ("A", at, (0.0, 0.0, 0.0), 8.0, 0.0)
    assert (ring.mount, ring.range_m, ring.rim_m, ring.noise) == ((0.1, 0.0, 0.0), 1.0, 0.4, (0.0, 0.0, 0.0, 5))
    assert ring.distances.tolist() == seen.distances[0].tolist()
    for found in (laser, ring):
        assert found.hits.tolist() == [distance < found.range_m for distance in found.distances.tolist()]
    assert 0 < laser.hits.sum() < len(laser.hits)
    assert reports.collect_robot_scans() == []

"""The virtual sensor: scans of robots in a building that it follows, noise, reports. Floors that nobody scans cost next
to nothing, and the first scan on one sees the present."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import LineString, affinity, box

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.sensing import InvalidScan, SensorBehind
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.model import Building, ElementKind, Wall
from robocorba.map_editor.spatial.floor_update import FloorUpdate
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.floor_follower import QUIET_INTERVAL_S, SCAN_WINDOW_S, FloorFollower
from robocorba.simulation.sensing.noise import disturb
from robocorba.simulation.sensing.reports import Reports
from robocorba.simulation.sensing.scan import LASER, PROXIMITY, Mount, Noise, ScanSpec
from robocorba.simulation.sensing.virtual_sensor import LAG_LIMIT_S, MAX_RAYS_AT_ONCE, VirtualSensor
from tests.clock import Clock
from tests.simulation.places import robot, tower

AHEAD = ScanSpec(Fan(0.0, 0.1, 1, 9.0))
INTERVAL_S = 0.03
#: Before noise, and robots to disturb them.
DISTANCES, ROBOTS = np.full((20, 1000), 4.0), np.arange(20)


class Following:
    """A building with robots A and B, a sensor that follows it, and the floors that its follower has asked for. error:
    what it gets instead of updates."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.world = SimulatedBuilding(tower())
        self._database = OmniDatabase(self.world)
        self.sensor = VirtualSensor(self.clock)
        self.sensor.set_map(self.world.building)
        self.follower = FloorFollower(self.sensor, self._changes, self.clock)
        self.asked: list[str] = []
        self.error: Exception | None = None
        for name, x in (("A", 5.0), ("B", 7.0)):
            self.world.add(robot(name, "L1", x, 2.0))
        self.follow()

    def _changes(self, floor: str, since: int) -> FloorUpdate:
        self.asked.append(floor)
        if self.error:
            raise self.error
        return self._database.changes(floor, since)

    def follow(self) -> None:
        """Follow at once."""
        self.world.refresh()
        for floor in self.sensor.floors:
            self.sensor.follow(self._database.changes(floor, self.sensor.version(floor)), self.clock())

    def follow_for(self, seconds: float) -> dict[str, int]:
        """Follow for some time as a server does; returns how often each floor was asked for."""
        self.asked.clear()
        for _ in range(round(seconds / INTERVAL_S)):
            self.clock.now += INTERVAL_S
            self.follower.follow()
        return {floor: self.asked.count(floor) for floor in ("L1", "L2")}

    def scan(self, x: float) -> float:
        """Distance ahead of A at (x, 2) on L1, as a server scans."""
        self.follower.prepare(["L1"])
        return self.ahead(x, 2.0, 0.0, "A")

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
    return Following()


def test_a_robot_sees_the_others_and_not_itself(place: Following) -> None:
    assert place.ahead(5.0, 2.0, 0.0, "A") == pytest.approx(1.6)
    assert place.ahead(5.0, 2.0, 0.0) == pytest.approx(1.6)  # the sensor is on the robot at this pose
    assert place.ahead(5.0, 2.0, 0.0, "C") == 0.0  # a robot that is elsewhere
    assert place.ahead(6.0, 2.0, 0.0) == pytest.approx(0.6)
    assert place.ahead(6.0, 2.0, math.pi) == pytest.approx(0.6)
    mount = Mount(0.2, 0.1, math.pi)
    assert place.ahead(7.0, 2.0, 0.0, "B", mount=mount) == pytest.approx(7.2 - 5.0 - math.sqrt(0.4**2 - 0.1**2))
    near = place.sensor.scan("L1", np.array([[5.9, 2.0, 0.0]]), Mount(), ScanSpec(PROXIMITY, 0.4), "C").distances[0]
    assert near[0] == pytest.approx(7.0 - 0.4 - 5.9 - 0.4)  # from its rim
    assert near[2] == PROXIMITY.range_m and near.min() >= 0.0


def test_changed_walls_objects_and_doors_are_seen(place: Following) -> None:
    assert place.ahead(4.0, 1.0, math.pi) == pytest.approx(1.0)  # the wall W1
    for x, heading in ((2.0, 0.3), (2.4, 1.0), (1.6, -0.7)):  # the table, on the map and moved
        place.world.place("T1", Pose("L1", x, 2.0, heading))
        place.follow()
        table = affinity.rotate(box(-0.5, -0.3, 0.5, 0.3), heading, (0.0, 0.0), use_radians=True)
        to_table = LineString([(0.5 - x, 0.0), (9.0, 0.0)]).intersection(table).bounds[0] + x - 0.5
        assert place.ahead(0.5, 2.0, 0.0) == pytest.approx(to_table)
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
def test_numbers_of_any_size_are_scanned(place: Following, far: float) -> None:
    """Nothing is near that place; any heading is one."""
    for which in range(3):
        robots = np.array([[5.0, 2.0, 0.0]])
        robots[0, which] = far
        for spec in (ScanSpec(LASER), ScanSpec(PROXIMITY, 0.4)):
            distances = place.sensor.scan("L1", robots, Mount(), spec).distances
            assert ((distances >= 0.0) & (distances <= spec.fan.range_m)).all()
            assert which == 2 or (distances == spec.fan.range_m).all()


def test_a_scan_at_many_poses_equals_single_scans(place: Following) -> None:
    chance = np.random.default_rng(3)
    robots = np.column_stack([chance.uniform(0.5, 9.5, (50, 2)), chance.uniform(-4, 4, 50)])
    spec = ScanSpec(LASER)
    together = place.sensor.scan("L1", robots, Mount(0.1), spec).distances
    alone = [place.sensor.scan("L1", robots[k : k + 1], Mount(0.1), spec).distances[0] for k in range(50)]
    assert np.array_equal(together, alone)

    def read(seed: int) -> list[float]:
        noisy = ScanSpec(LASER, 0.0, Noise(0.05), seed)
        return place.sensor.scan("L1", robots[:1], Mount(), noisy).distances[0].tolist()

    assert read(1) == read(1) != read(2)


def test_scans_of_outdated_floor_data_and_invalid_ones_are_refused(place: Following) -> None:
    here = [0.0, 0.0, 0.0]
    for robots, mount in (
        ([[math.nan, 0.0, 0.0]], Mount()),
        ([[1.0, 1.0, 0.0], [0.0, 0.0, math.inf]], Mount()),
        ([here], Mount(math.nan)),
        ([here], Mount(0.0, 0.0, -math.inf)),
        ([here] * (MAX_RAYS_AT_ONCE // LASER.count + 1), Mount()),
    ):
        with pytest.raises(InvalidScan):
            place.sensor.scan("L1", np.array(robots), mount, ScanSpec(LASER))
    for fan, rim in ((LASER, -0.1), (LASER, math.nan), (LASER, 101.0), (Fan(0.0, 0.1, 1, 1000.0), 1.0)):
        with pytest.raises(InvalidScan):
            ScanSpec(fan, rim)
    place.clock.now += LAG_LIMIT_S - 0.01
    place.ahead(6.0, 2.0, 0.0)
    assert place.sensor.lag_s == pytest.approx(LAG_LIMIT_S - 0.01)
    place.clock.now += 0.02
    with pytest.raises(SensorBehind):
        place.ahead(6.0, 2.0, 0.0)
    fresh = VirtualSensor(place.clock)
    fresh.set_map(tower())
    for floor, refusal in (("L1", SensorBehind), ("roof", UnknownFloor)):
        with pytest.raises(refusal):
            fresh.scan(floor, np.array([here]), Mount(), AHEAD)


# ---- reports ----


def test_reports_hold_the_load_and_the_last_scan_of_each_sensor_with_what_its_rays_hit(place: Following) -> None:
    cpu, at = Clock(), Pose("L1", 5.0, 2.0, 0.3)
    reports = Reports(place.sensor, place.clock, cpu)
    for mount, spec in ((Mount(0.1), ScanSpec(PROXIMITY, 0.4, seed=5)), (Mount(), ScanSpec(LASER, 0.2))):
        for name in ("A", "A", None):
            seen = place.sensor.scan("L1", np.array([at[1:]]), mount, spec, name)
            reports.record_scan(name, at, mount, spec, seen)
    place.clock.now += 2.0
    cpu.now += 0.5
    (last,) = reports.collect()
    assert (last.robot, last.at) == ("A", at)
    assert last.distances == pytest.approx(seen.distances[0] + 0.2)
    assert (reports.load.busy, reports.load.scan_rate) == (pytest.approx(0.25), pytest.approx(3.0))
    ring, laser = reports.collect_robot_scans()
    assert (laser.robot, laser.at, laser.mount, laser.range_m, laser.rim_m) == ("A", at, (0.0, 0.0, 0.0), 8.0, 0.2)
    assert (ring.mount, ring.range_m, ring.rim_m, ring.noise) == ((0.1, 0.0, 0.0), 1.0, 0.4, (0.0, 0.0, 0.0, 5))
    assert laser.distances.tolist() == seen.distances[0].tolist()
    for found in (laser, ring):
        assert found.hits.tolist() == [distance < found.range_m for distance in found.distances.tolist()]
    assert 0 < laser.hits.sum() < len(laser.hits)
    assert reports.collect() == reports.collect_robot_scans() == []


# ---- floors that are followed ----


def test_only_floors_with_scans_are_followed_at_every_call(place: Following) -> None:
    place.follow_for(INTERVAL_S)
    seldom = place.follow_for(30.0)
    assert seldom["L1"] == seldom["L2"] <= 30.0 / QUIET_INTERVAL_S
    place.scan(5.0)
    often = place.follow_for(SCAN_WINDOW_S - INTERVAL_S)
    assert often["L1"] == round(SCAN_WINDOW_S / INTERVAL_S) - 1
    assert often["L2"] <= SCAN_WINDOW_S / QUIET_INTERVAL_S
    place.follow_for(2 * INTERVAL_S)
    assert place.follow_for(30.0) == pytest.approx(seldom, abs=1)
    assert place.sensor.lag_s <= QUIET_INTERVAL_S
    building = place.world.building
    place.follower.set_map(Building(building.name, {"L1": building.floors["L1"]}))
    assert place.follow_for(10.0)["L2"] == 0
    place.asked.clear()
    place.follower.prepare(["L2", "roof"])  # left to the scan
    assert place.asked == []


def test_the_first_scan_sees_where_robots_are_now(place: Following) -> None:
    place.follow_for(INTERVAL_S)
    near = place.scan(5.0)
    place.follow_for(SCAN_WINDOW_S + 1.0)
    place.world.place("B", Pose("L1", 9.0, 2.0, 0.0))
    assert place.scan(5.0) == pytest.approx(near + 2.0)
    place.asked.clear()
    before = place.scan(5.0)
    assert place.asked == []  # only the first one waits for an update
    for error in (NotReachable("the simulation server"), UpdateMismatch("L1", 1, 2)):
        place.error = None
        place.follow_for(SCAN_WINDOW_S + 0.3)
        place.error = error
        assert place.scan(5.0) == before  # what is there


# ---- noise ----


def test_the_error_has_the_stated_deviation_and_depends_on_seed_and_robot_only() -> None:
    errors = disturb(Noise(0.01, 0.005), DISTANCES, 8.0, 1, ROBOTS) - 4.0
    assert abs(errors.mean()) < 4 * 0.03 / math.sqrt(errors.size)
    assert errors.std() == pytest.approx(0.03, rel=0.02)
    share = (np.abs(errors) < 0.03).mean()
    assert share == pytest.approx(0.6827, abs=0.015)  # as of a normal distribution
    noise = Noise(0.01)
    first, again, other = (disturb(noise, DISTANCES, 8.0, seed, ROBOTS) for seed in (7, 7, 8))
    assert np.array_equal(first, again)
    assert np.array_equal(first[4:5], disturb(noise, DISTANCES[:1], 8.0, 7, ROBOTS[4:5]))  # whatever the others
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.05
    assert abs(np.corrcoef(first[0], first[1])[0, 1]) < 0.15


def test_lost_echoes_read_the_range_and_nothing_is_read_beyond_it() -> None:
    read = disturb(Noise(3.0, 0.0, 0.1), DISTANCES, 8.0, 1, ROBOTS)
    assert (read.min(), read.max()) == (0.0, 8.0)
    lost = disturb(Noise(0.0, 0.0, 0.1), DISTANCES, 8.0, 1, ROBOTS)
    assert (lost == 8.0).mean() == pytest.approx(0.1, abs=0.01)
    nothing_met = np.full((1, 50), 8.0)
    assert np.array_equal(disturb(Noise(1.0), nothing_met, 8.0, 1, ROBOTS[:1]), nothing_met)
    for field, name in (("sigma", "sigma_m"), ("relative", "relative"), ("lost", "lost")):
        for value in (-0.1, math.nan, math.inf, 11.0):
            with pytest.raises(InvalidScan) as refused:
                Noise(**{name: value})
            assert refused.value.field == field

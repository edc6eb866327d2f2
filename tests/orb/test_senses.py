"""The senses of a robot whose adaptor is in another process."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.sensing import UnknownSensor
from robocorba.orb.orb import Orb
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.corba import senses as module
from robocorba.robot.corba.adaptor_servant import RobotAdaptorServant, RobotSensorsServant, SensingAdaptorServant
from robocorba.robot.corba.remote_adaptor import RemoteAdaptor
from robocorba.robot.corba.senses import RemoteSenses, range_sensor
from robocorba.robot.senses import Ranges, RangeSensor, Reading, Senses, nearest_m, usual_sensors
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import Mount, Noise, ScanSpec
from robocorba.stubs import RoboCorba
from tests.clock import Clock

SONAR = RangeSensor("sonar", Mount(0.2, -0.1, 0.5), ScanSpec(Fan(-0.1, 0.1, 3, 4.0), 0.3, Noise(0.01, 0.02, 0.03)))
BUMPER = Reading("bumper", "contacts", 12.5, 3.0)
Starting = Callable[[object], Senses | None]


class Driver(RobotAdaptor, Senses):
    """A robot that stands, and its sensors."""

    def __init__(self, *sensors: RangeSensor) -> None:
        self.senses = self
        self._sensors = sensors
        self.seen = Ranges(12.5, np.array([1.0, 2.0, 3.0]))

    def _succeed(self, argument: object = None) -> bool:
        return True

    start = stop = read = write = _succeed

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return self._sensors

    def ranges(self, name: str) -> Ranges:
        self.sensor(name)
        if name == "laser":
            raise OSError(5, "no serial port")
        return self.seen

    def readings(self) -> Sequence[Reading]:
        return [BUMPER]


@pytest.fixture
def start(orb: Orb) -> Starting:
    """Starts the adaptor behind a servant by an agent, and returns its senses there."""

    def started(servant: object) -> Senses | None:
        orb.accept_calls()
        adaptor = RemoteAdaptor(orb, "A")
        assert adaptor.start(["--uri", orb.uri(orb.activate(servant)), "rest"])
        return adaptor.senses

    return started


def test_sensors_and_what_they_measure_are_those_of_the_driver(start: Starting) -> None:
    laser, _ = usual_sensors()
    senses = start(SensingAdaptorServant(Driver(laser, SONAR)))
    assert senses and senses.sensors == [laser, SONAR]
    seen = senses.ranges("sonar")
    assert (seen.time, seen.distances.tolist()) == (12.5, [1.0, 2.0, 3.0])
    assert senses.readings() == [BUMPER]
    with pytest.raises(AdaptorFailed, match="no serial port"):
        senses.ranges("laser")
    with pytest.raises(UnknownSensor, match="'front'; known are laser"):
        nearest_m(senses, "front")
    with pytest.raises(UnknownSensor, match="'radar'; known are laser, sonar"):
        senses.ranges("radar")


def test_an_adaptor_of_four_methods_has_no_senses(orb: Orb, start: Starting) -> None:
    assert start(RobotAdaptorServant(Driver(SONAR))) is None
    none = orb.activate(RobotSensorsServant(lambda: None))
    with pytest.raises(RoboCorba.AdaptorFailed, match="has no sensors"):
        none.readings()


def test_sensors_that_cannot_be_are_refused_at_the_start(start: Starting) -> None:
    for sensors, reason in (
        ((SONAR, SONAR), "two sensors 'sonar'"),
        ((SONAR._replace(mount=Mount(math.nan)),), r"'sonar' has a where: \(nan, 0.0, 0.0\) is not finite"),
    ):
        with pytest.raises(AdaptorFailed, match=reason):
            start(SensingAdaptorServant(Driver(*sensors)))
    struct = range_sensor(SONAR)
    struct.spec.rays = 0
    with pytest.raises(AdaptorFailed, match="its sensor 'sonar' has a rays: 0 is not 1 to"):
        module.range_sensor_of(struct)


def test_distances_that_cannot_be_are_refused(start: Starting) -> None:
    driver = Driver(SONAR)
    senses = start(SensingAdaptorServant(driver))
    assert senses
    for sent in ([1.0, math.nan, 2.0], [1.0, -0.1, 2.0], [1.0, 2.0]):
        driver.seen = Ranges(1.0, np.array(sent))
        with pytest.raises(AdaptorFailed, match=f"sonar must send 3 distances.*it sent {len(sent)}, the least"):
            senses.ranges("sonar")
    driver.seen = Ranges(1.0, np.array([1.0, math.inf, 9.0]))  # no echo, as ROS writes it, and beyond the range
    assert senses.ranges("sonar").distances.tolist() == [1.0, 4.0, 4.0]


def test_a_sensor_that_stops_measuring_has_failed(orb: Orb, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last measurement would show a free way for ever."""
    clock = Clock()
    monkeypatch.setattr(module.time, "monotonic", clock)
    driver = Driver(SONAR)
    orb.accept_calls()
    uri = orb.uri(orb.activate(SensingAdaptorServant(driver)))
    senses, ours = RemoteSenses(orb, uri), RemoteSenses(orb, uri, is_clock_ours=True)
    began = clock.now
    for passed_s, measured_at, has_failed in (
        *((0.0, 5.0, False), (0.9, 5.0, False), (0.2, 5.0, True)),
        *((0.1, 6.0, False), (9.0, 2.0, False), (1.1, 2.0, True)),  # it was switched on again
    ):
        clock.now += passed_s
        driver.seen = driver.seen._replace(time=measured_at)
        for each in (senses, ours):
            if has_failed:
                with pytest.raises(AdaptorFailed, match="sonar has measured nothing for 1"):
                    each.ranges("sonar")
        if not has_failed:
            assert senses.ranges("sonar").time == measured_at
            assert began <= ours.ranges("sonar").time <= clock.now
    assert (senses.readings()[0].time, ours.readings()[0].time) == (12.5, clock.now)

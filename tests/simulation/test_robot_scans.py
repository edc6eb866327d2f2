"""The last scan of each sensor of a robot, for viewers."""

from __future__ import annotations

import numpy as np
import pytest

from robocorba.simulation.robot_scans import (
    IDLE_INTERVAL_S,
    MAX_SENSORS,
    READ_INTERVAL_S,
    READ_WINDOW_S,
    RobotScans,
)
from tests.clock import Clock
from tests.simulation.places import scan


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def scans(clock: Clock) -> RobotScans:
    return RobotScans(clock)


def test_each_sensor_has_its_last_scan(scans: RobotScans) -> None:
    ring = {"distances": np.ones(8), "hits": np.ones(8, bool), "range_m": 1.0}
    for time in (1.0, 2.0):
        scans.record(scan(time=time))
        scans.record(scan(time=time, **ring))
        scans.record(scan(time=time, ahead=0.3))
    scans.record(scan("B", 2.5))
    found = scans.since("L1", 0.0)
    assert [(one.robot, one.time, len(one.distances), one.mount[0]) for one in found] == [
        ("A", 2.0, 5, 0.0),
        ("A", 2.0, 8, 0.0),
        ("A", 2.0, 5, 0.3),
        ("B", 2.5, 5, 0.0),
    ]
    assert [one.robot for one in scans.since("L1", 2.0)] == ["B"]


def test_a_robot_that_changed_floors_is_on_the_new_one(scans: RobotScans) -> None:
    scans.record(scan())
    scans.record(scan(time=2.0, floor="L2"))
    assert scans.since("L1", 0.0) == []
    assert len(scans.since("L2", 0.0)) == 1


def test_memory_is_bounded_for_each_robot(scans: RobotScans) -> None:
    for number in range(3 * MAX_SENSORS):
        scans.record(scan(ahead=number / 100))
    kept = [one.mount[0] for one in scans.since("L1", 0.0)]
    assert kept == [number / 100 for number in range(2 * MAX_SENSORS, 3 * MAX_SENSORS)]


def test_robots_that_left_are_forgotten(scans: RobotScans) -> None:
    for name in "ABC":
        scans.record(scan(name))
    scans.forget("A")
    scans.keep({"C", "D"})
    assert [one.robot for one in scans.since("L1", 0.0)] == ["C"]


def test_scans_are_wanted_more_often_while_somebody_reads_them(scans: RobotScans, clock: Clock) -> None:
    assert scans.interval_s == IDLE_INTERVAL_S
    scans.since("L1", 0.0)
    assert scans.interval_s == READ_INTERVAL_S
    clock.now += READ_WINDOW_S + 0.1
    assert scans.interval_s == IDLE_INTERVAL_S

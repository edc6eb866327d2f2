"""Feeds of scans and postures: what a viewer is sent, and when a scan is too old."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from robocorba.console.sensor_feed import MAX_AGE_S, MAX_GONE, NOTHING, Feed, ScanFeed
from robocorba.sensing.fan import LASER, PROXIMITY, Fan
from robocorba.simulation.robot_scans import RobotScan
from tests.simulation.places import scan


def of_fan(robot: str, fan: Fan, time: float = 1.0, ahead: float = 0.0, **others: Any) -> RobotScan:
    """A scan of a sensor with these rays, all of which hit something at 0.5 m."""
    rays = {"first_rad": fan.first_rad, "step_rad": fan.step_rad, "range_m": fan.range_m}
    seen = {"distances": np.full(fan.count, 0.5), "hits": np.ones(fan.count, bool)}
    return scan(robot, time, ahead=ahead, **{**rays, **seen, **others})


def keys(feed: ScanFeed) -> list[str]:
    return list(feed.feed.keys)


# ---- feeds ----


def test_a_viewer_gets_everything_and_then_changes() -> None:
    feed = Feed()
    feed.put("A", 1)
    feed.put("B", [2])
    assert feed.since(NOTHING) == (True, {"A": "1", "B": "[2]"}, [])
    version = feed.version
    assert feed.since(version) == (False, {}, [])
    feed.put("A", 1)
    assert feed.version == version  # nothing new
    feed.put("A", 3)
    feed.drop(["B", "unknown"])
    assert feed.since(version) == (False, {"A": "3"}, ["B"])
    feed.put("B", 4)
    assert feed.since(version) == (False, {"A": "3", "B": "4"}, [])
    assert feed.since(NOTHING) == (True, {"A": "3", "B": "4"}, [])


def test_a_version_of_another_feed_gets_everything() -> None:
    before = Feed()
    before.put("A", 1)
    after = Feed()
    after.put("B", 2)
    assert after.since(before.version) == (True, {"B": "2"}, [])


def test_departed_entries_are_forgotten_at_last() -> None:
    feed = Feed()
    version = feed.version
    for number in range(MAX_GONE + 5):
        feed.put(str(number), number)
        feed.drop([str(number)])
    assert feed.since(version) == (True, {}, [])


# ---- scans ----


def test_sensors_are_called_by_their_rays() -> None:
    feed, other = ScanFeed(), Fan(0.0, 0.1, 3, 2.0)
    found = [
        *(of_fan("A", LASER), of_fan("A", PROXIMITY), of_fan("A", LASER, ahead=0.2), of_fan("A", other)),
        *(of_fan("A", other, ahead=0.2), of_fan("B", LASER)),
    ]
    feed.update(found, True, 1.0, 50.0)
    names = ["A/laser", "A/proximity", "A/laser 2", "A/sensor 1", "A/sensor 2", "B/laser"]
    assert keys(feed) == names
    feed.update([of_fan("A", LASER, 2.0, ahead=0.2)], False, 2.0, 51.0)
    assert keys(feed) == names  # a sensor keeps its name


def test_a_scan_in_json_has_all_that_a_fan_needs() -> None:
    feed = ScanFeed()
    hits = np.array([True, False, True])
    seen = of_fan("A", Fan(-0.1, 0.1, 3, 2.0), rim_m=0.4, distances=np.array([0.5, 2.0, 1.23456]), hits=hits)
    feed.update([seen], True, 1.0, 50.0)
    (text,) = feed.feed.since(NOTHING).entries.values()
    assert json.loads(text) == {
        "key": "A/sensor 1",
        "robot": "A",
        "sensor": "sensor 1",
        "time": 1.0,
        "pose": {"x": 1.0, "y": 2.0, "heading": 0.0},
        "mount": {"ahead": 0.0, "left": 0.0, "heading": 0.0},
        "angles": {"first": -0.1, "step": 0.1, "count": 3},
        "range": 2.0,
        "rim": 0.4,
        "ranges": [0.9, 2.4, pytest.approx(1.635)],
        "hits": [1, 0, 1],
    }


def test_scans_of_robots_that_left_go() -> None:
    feed = ScanFeed()
    feed.update([of_fan("A", LASER), of_fan("B", LASER)], True, 1.0, 50.0)
    feed.update([of_fan("B", LASER, 1.1)], False, 1.1, 50.1)
    assert keys(feed) == ["A/laser", "B/laser"]
    feed.update([of_fan("B", LASER, 1.1)], True, 1.1, 50.1)
    assert keys(feed) == ["B/laser"]


def test_a_sensor_that_ended_goes_and_may_come_back() -> None:
    feed, old = ScanFeed(), of_fan("A", LASER, 10.0)
    feed.update([old], True, 10.0, 50.0)
    feed.update([old], True, 10.0 + MAX_AGE_S + 0.1, 50.0 + MAX_AGE_S + 0.1)
    feed.update([old], True, 10.0 + MAX_AGE_S + 0.2, 50.0 + MAX_AGE_S + 0.2)
    assert keys(feed) == []
    feed.update([of_fan("A", LASER, 13.0)], False, 13.0, 53.0)
    assert keys(feed) == ["A/laser"]


def test_a_scan_stays_while_time_is_paused_and_while_it_flies() -> None:
    feed = ScanFeed()
    feed.update([of_fan("A", LASER, 10.0)], True, 10.0, 50.0)
    feed.update([], False, 10.1, 90.0)  # paused
    assert keys(feed) == ["A/laser"]
    fast = ScanFeed()
    fast.update([of_fan("A", LASER, 10.0)], True, 10.0, 50.0)
    fast.update([of_fan("A", LASER, 12.0)], False, 20.0, 50.1)  # simulated a hundred times as fast
    assert keys(fast) == ["A/laser"]


def test_what_was_scanned_long_ago_is_not_shown_to_the_first_viewer() -> None:
    feed = ScanFeed()
    feed.update([of_fan("A", LASER, 10.0), of_fan("B", LASER, 99.0)], True, 100.0, 50.0)
    assert keys(feed) == ["B/laser"]
    feed.update([of_fan("A", LASER, 100.1)], False, 100.1, 50.1)
    assert keys(feed) == ["B/laser", "A/laser"]

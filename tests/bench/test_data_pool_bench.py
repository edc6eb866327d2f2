"""What the bench of data pools computes."""

from __future__ import annotations

import pytest

from bench.robots.data_pool import ages_ms, marks_of, memory_marks_of, memory_row
from bench.robots.data_pool_client import bytes_of
from tests.data_pool.places import Place

#: The server was asked every 5 ms; it made a step at 0.010, 0.030 and 0.050.
STAMPS = [(0.000, 1.00), (0.006, 1.00), (0.011, 1.02), (0.026, 1.02), (0.031, 1.04), (0.046, 1.04), (0.051, 1.06)]


def test_ages_count_from_when_the_state_was_not_there_yet() -> None:
    looks = [(0.040, 1.04, 0.0), (0.042, 1.04, 0.0), (0.044, 1.04, 0.0)]
    assert ages_ms(STAMPS, looks, 0.002) == pytest.approx([14.0, 16.0])


def test_a_look_that_comes_late_stands_for_those_before_it() -> None:
    looks = [(0.040, 1.04, 0.0), (0.050, 1.06, 0.0), (0.052, 1.06, 0.0)]
    assert ages_ms(STAMPS, looks, 0.002) == pytest.approx([14.0, 16.0, 18.0, 20.0, 22.0, 4.0])


def test_what_is_older_than_all_that_is_known_counts_too() -> None:
    looks = [(1.040, 0.5, 0.0), (1.042, 0.5, 0.0)]
    assert ages_ms(STAMPS, looks, 0.002) == pytest.approx([1040.0])


def test_bytes_are_those_of_the_pool_alone() -> None:
    place = Place()
    pools = [place.pool("L1"), place.pool("L1"), place.pool("L2")]
    for pool in pools:
        pool.follow()
    building = bytes_of([place.world.building])
    one, other, two = bytes_of([place, pools[0]]), bytes_of([place, pools[1]]), bytes_of([place, pools[0], pools[1]])
    assert building > 1000
    assert one == pytest.approx(other, rel=0.01)
    assert two - one > 1000


def test_marks() -> None:
    row = {"age p99": 90.0, "change p99": 210.0, "moving": 0.9}
    assert [mark.is_reached for mark in marks_of([row, row, {**row, "age p99": 300.0}])] == [True, False, True]
    rows = [memory_row(str(held), held * 1024, 0, 0) for held in (100, 90, 400, 130)]
    assert [(mark.value, mark.is_reached) for mark in memory_marks_of(rows)] == [(0.25, True), (1.3, False)]

"""Postures on a pool's floor: read for those who ask, also of a source that does not answer."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.posture import Posture
from robocorba.robot.data_pool.postures import KEPT_S, RETRY_S, PoolPostures
from tests.clock import Clock


class Source:
    """An Omni database whose postures a test sets."""

    def __init__(self) -> None:
        self.clock, self.floor = Clock(), "L1"
        self.known = {"L1": [Posture("A", 1.0, (0.1,)), Posture("B", 2.0, (0.2,))], "L2": [Posture("C", 3.0, ())]}
        self.is_away = False
        self.calls = 0
        self.answer = self.postures
        self.pool = PoolPostures(lambda floor, time_s: self.answer(floor, time_s), lambda: self.floor, self.clock)

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        self.calls += 1
        if self.is_away:
            raise NotReachable("away")
        if floor not in self.known:
            raise UnknownFloor("floorName", floor, list(self.known))
        return [posture for posture in self.known[floor] if posture.time > time_s]

    def names(self, time_s: float = 0.0) -> list[str]:
        return [posture.robot for posture in self.pool.since(time_s)]


@pytest.fixture
def source() -> Source:
    return Source()


def test_readers_share_what_was_read_of_the_floor_that_the_robot_is_on(source: Source) -> None:
    assert (source.names(), source.names(1.0), source.names(2.0)) == (["A", "B"], ["B"], [])
    assert source.calls == 1
    source.known["L1"] = [Posture("A", 4.0, (0.3,))]
    source.clock.now += KEPT_S
    assert (source.names(), source.calls) == (["A"], 2)
    source.floor = "L2"
    assert source.names() == ["C"]
    source.floor = "roof"
    assert source.names() == []


def test_a_source_that_does_not_answer_is_asked_seldom(source: Source) -> None:
    source.names()
    source.is_away = True
    source.clock.now += KEPT_S
    assert [source.names() for _ in range(3)] == [["A", "B"]] * 3
    assert source.calls == 2
    source.floor = "L2"
    assert [source.names() for _ in range(2)] == [[], []]
    source.is_away = False
    source.clock.now += RETRY_S
    assert source.names() == ["C"]


def test_nobody_waits_for_another_reader(source: Source) -> None:
    source.names()
    source.clock.now += KEPT_S
    asked, answers = threading.Event(), threading.Event()

    def hang(floor: str, time_s: float) -> list[Posture]:
        asked.set()
        answers.wait(60.0)
        return source.postures(floor, time_s)

    source.answer = hang
    with ThreadPoolExecutor() as threads:
        threads.submit(source.names)
        assert asked.wait(60.0)
        assert source.names() == ["A", "B"]
        answers.set()

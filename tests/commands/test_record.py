"""What `robocorba record` writes, also if the simulation server does not answer for a while."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from robocorba.errors.services import NotReachable
from robocorba.simulation.recording import Recorder, Recording
from robocorba.simulation.system_changes import SystemChanges
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate
from robocorba.testing.buildings import two_floors

record = importlib.import_module("robocorba.commands.record")  # whose name is also that of the command


class Floors:
    """Returns or raises the given answers, one after another."""

    def __init__(self, answers: Sequence[list[FloorUpdate] | NotReachable]) -> None:
        self._answers = iter(answers)

    def follow(self, resolve_timeout_s: float) -> SystemChanges:
        answer = next(self._answers)
        if isinstance(answer, NotReachable):
            raise answer
        return SystemChanges(answer, [], [], [])


class Times:
    """A stop signal whose ticks do not wait."""

    def __init__(self, count: int) -> None:
        self._count = count

    def ticks(self, every_s: float, limit_s: float) -> Iterator[float]:
        return (every_s * number for number in range(self._count))


def update(since: int, version: int, floor: str = "L1") -> FloorUpdate:
    return FloorUpdate(floor, since, version, 0.1 * version, 1, [], [], np.empty(0, MOTION), {})


def recorded(
    path: Path, answers: Sequence[list[FloorUpdate] | NotReachable], **limits: float
) -> list[tuple[float, int]]:
    with Recorder(path / "a.mcap", two_floors()) as recorder:
        record.record_changes(Floors(answers), recorder.write_changes, 0.0, Times(len(answers)), **limits)  # type: ignore[arg-type]
    return [(round(at_s, 3), update.version) for at_s, update in Recording(path / "a.mcap").updates()]


def test_changes_are_recorded(tmp_path: Path) -> None:
    answers = [[update(WHOLE, 5), update(WHOLE, 7, "L2")], [update(5, 6), update(7, 7, "L2")], [update(6, 9)]]
    assert recorded(tmp_path, answers) == [(0.0, 5), (0.0, 7), (0.05, 6), (0.1, 9)]


def test_an_unchanged_floor_is_recorded_rarely(tmp_path: Path) -> None:
    answers = [[update(WHOLE, 5)], *([update(5, 5)] for _ in range(50))]
    assert recorded(tmp_path, answers) == [(0.0, 5), (1.0, 5), (2.0, 5)]


def test_recording_continues_after_an_outage(tmp_path: Path) -> None:
    away = NotReachable("away")
    answers = [[update(WHOLE, 5)], [update(5, 6)], away, away, away, [update(WHOLE, 105)], [update(105, 106)]]
    assert recorded(tmp_path, answers) == [(0.0, 5), (0.05, 6), (0.25, 105), (0.3, 106)]


def test_after_a_longer_outage_the_recording_is_complete(tmp_path: Path) -> None:
    with pytest.raises(NotReachable, match="away"):
        recorded(tmp_path, [[update(WHOLE, 5)], *[NotReachable("away")] * 3], outage_limit_s=0.0)
    found = Recording(tmp_path / "a.mcap")
    assert (found.is_complete, found.count) == (True, 1)

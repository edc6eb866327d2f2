"""Spans of the history become recordings and films; opened recordings become histories."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robocorba.console import films as films_module
from robocorba.console import recordings as recordings_module
from robocorba.console.defects import DEFECT
from robocorba.console.films import Films, InvalidFilm, record
from robocorba.console.history import History, Moment
from robocorba.console.recordings import Recordings, UnknownRecording
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidRecording
from robocorba.maps.model import Building
from robocorba.simulation.recording import Recording
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.testing.buildings import two_floors
from robocorba.testing.processes import eventually

FLOOR = "L1"
BODY = Body(7, BodyKind.ROBOT, "R1", 0.3, (), 50.0)


@pytest.fixture(scope="module")
def building() -> Building:
    return two_floors()


@pytest.fixture
def films() -> Iterator[Films]:
    films = Films()
    yield films
    films.close()


def history(seconds: int, began: float = 1000.0) -> History:
    """A robot that drives 1 m a second along x, seen once a second."""
    history = History()
    view = FloorView(FLOOR)
    for second in range(seconds + 1):
        motions = np.zeros(1, MOTION)
        motions["number"], motions["x"], motions["y"], motions["vx"] = 7, 2.0 + second, 3.0, 1.0
        view.apply(FloorUpdate(FLOOR, WHOLE, second + 1, float(second), 1, [BODY], [], motions, {}))
        history.add(view, began + second)
    return history


def places(moments: list[Moment]) -> list[tuple[float, float]]:
    """Time and x of the robot in each moment."""
    return [(moment.at, float(moment.rows["x"][0])) for moment in moments]


def test_a_span_begins_with_the_state_at_its_begin() -> None:
    assert places(history(5).between(FLOOR, 1001.5, 1003.0)) == [(1001.5, 3.0), (1002.0, 4.0), (1003.0, 5.0)]


def test_a_span_before_the_history_begins_with_it() -> None:
    assert places(history(2).between(FLOOR, 10.0, 1001.0)) == [(1000.0, 2.0), (1001.0, 3.0)]


def test_a_span_of_an_unknown_floor_is_refused() -> None:
    with pytest.raises(UnknownFloor):
        history(1).between("cellar", 0.0, 1.0)


def test_a_span_is_recorded_with_its_times_and_read_again(tmp_path: Path, building: Building) -> None:
    file = tmp_path / "span.mcap"
    record(file, building, FLOOR, history(5).between(FLOOR, 1001.0, 1003.0), 1004.5)
    recording = Recording(file)
    assert recording.began == pytest.approx(1001.0)
    assert recording.duration_s == pytest.approx(3.5)
    view = recording.at(1.0, [FLOOR])[FLOOR]
    assert [body.name for body in view.bodies.values()] == ["R1"]
    assert view.motions["x"][0] == pytest.approx(4.0)


def test_a_recording_is_opened_looked_at_and_closed_for_newer_ones(
    tmp_path: Path, building: Building, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings_module, "MAX_OPEN", 2)
    file = tmp_path / "span.mcap"
    record(file, building, FLOOR, history(5).between(FLOOR, 1000.0, 1005.0), 1005.0)
    recordings = Recordings()
    first = recordings.open(file, "monday.mcap")
    assert first.row() == {"key": first.key, "name": "monday.mcap", "floors": [FLOOR], "past": [1000.0, 1005.0]}
    [(at, x)] = places([first.history.at(FLOOR, 1002.1)])
    assert at == pytest.approx(1002.0)
    assert x == 4.0
    assert first.plan(FLOOR)["name"] == FLOOR
    with pytest.raises(UnknownFloor):
        first.plan("cellar")
    for _ in range(2):
        recordings.open(file, "again")
    assert [row["name"] for row in recordings.rows()] == ["again", "again"]
    with pytest.raises(UnknownRecording):
        recordings.get(first.key)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    file.write_text("no recording")
    with pytest.raises(InvalidRecording):
        Recordings().open(file, "x")
    assert Recordings().rows() == []


def test_a_film_is_made(building: Building, films: Films) -> None:
    moments = history(3).between(FLOOR, 1000.0, 1003.0)
    number = films.start(building, FLOOR, moments, 1003.0, 20.0)
    with pytest.raises(InvalidFilm, match="another film"):
        films.start(building, FLOOR, moments, 1003.0, 20.0)
    eventually(lambda: films.state(number)["phase"] != "making", 120.0, "the end of the film's making")
    assert films.state(number)["problem"] == ""
    assert films.file(number).read_bytes()[4:8] == b"ftyp"


def test_a_cancelled_film_says_so(building: Building, films: Films) -> None:
    number = films.start(building, FLOOR, history(3).between(FLOOR, 1000.0, 1003.0), 1003.0, 1.0)
    films.cancel(number)
    assert films.state(number)["phase"] == "failed"
    assert films.state(number)["problem"] == "cancelled"
    with pytest.raises(InvalidFilm, match="not ready"):
        films.file(number)


def test_a_defect_is_no_film(building: Building, films: Films, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise KeyError("a defect")

    monkeypatch.setattr(films_module, "record", fail)
    number = films.start(building, FLOOR, history(3).between(FLOOR, 1000.0, 1003.0), 1003.0, 1.0)
    eventually(lambda: films.state(number)["phase"] != "making", what="the end of the film's making")
    assert films.state(number)["problem"] == DEFECT
    with pytest.raises(InvalidFilm, match="not ready"):
        films.file(number)


@pytest.mark.parametrize("end_s", [1000.0, 999.0])
def test_a_film_that_would_end_before_it_begins_is_refused(building: Building, films: Films, end_s: float) -> None:
    with pytest.raises(InvalidFilm, match="not after"):
        films.start(building, FLOOR, history(1).between(FLOOR, 1000.0, 1001.0), end_s, 1.0)


@pytest.mark.parametrize("speed", [0.0, -1.0, 1000.0, float("nan")])
def test_impossible_speeds_are_refused(building: Building, films: Films, speed: float) -> None:
    with pytest.raises(InvalidFilm, match="speed"):
        films.start(building, FLOOR, history(1).between(FLOOR, 1000.0, 1001.0), 1001.0, speed)


def test_a_film_that_would_be_too_long_is_refused_with_a_speed_that_is_possible(
    building: Building, films: Films
) -> None:
    moments = history(1).between(FLOOR, 1000.0, 1001.0)
    with pytest.raises(InvalidFilm, match="choose 3 or more"):
        films.start(building, FLOOR, moments, 2800.0, 1.0)


def test_an_unknown_film_is_refused(films: Films) -> None:
    with pytest.raises(InvalidFilm, match="make it again"):
        films.file(5)

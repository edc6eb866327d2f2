"""Binary frames of floors, and the moments that can be looked back at."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest

from robocorba.console.frames import ROW, Rows, rows_of, update_frame, whole_frame
from robocorba.console.history import INTERVAL_S, MOMENT_BYTES, History
from robocorba.errors.paths import UnknownFloor
from robocorba.spatial.elevator_state import Doors, ElevatorState
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView

NAME = '<b>"\u202eעגלה\U0001f6bb'
CABIN = ElevatorState(3.5, "", Doors.OPENING, 0.25, ("A",), ("B", "C"))


def body(number: int, name: str = "A") -> Body:
    return Body(number, BodyKind.ROBOT, name, 0.4, (), 127.0)


def motions(*places: tuple[int, float]) -> Any:
    rows = np.zeros(len(places), MOTION)
    for row, (number, x) in zip(rows, places, strict=True):
        row["number"], row["x"], row["heading"] = number, x, 0.5
    return rows


def update(since: int, version: int, *places: tuple[int, float], came: list[Body] | None = None) -> FloorUpdate:
    return FloorUpdate("L1", since, version, 1.5, 7, came or [], [9], motions(*places), {"E": CABIN})


def read(frame: bytes) -> tuple[dict[str, Any], Rows]:
    """As live.js reads it."""
    (length,) = struct.unpack_from("<I", frame)
    return json.loads(frame[4 : 4 + length]), np.frombuffer(frame[4 + length :], ROW)


def view(*places: tuple[int, float]) -> FloorView:
    copy = FloorView("L1")
    copy.apply(update(WHOLE, 1, *places, came=[body(number) for number, _ in places]))
    return copy


def test_a_frame_has_what_an_update_has() -> None:
    header, rows = read(update_frame(update(3, 4, (1, 2.0), (5, -3.25), came=[body(5, NAME)])))
    assert (header["floor"], header["time"], header["map"], header["whole"]) == ("L1", 1.5, 7, False)
    assert header["went"] == [9]
    assert header["came"] == [{"number": 5, "kind": "robot", "name": NAME, "radius": 0.4, "outline": []}]
    assert header["elevators"]["E"] == {
        **{"cabin": "", "height": 3.5, "doors": "opening", "opening": 0.25},
        **{"riders": ["A"], "queue": ["B", "C"]},
    }
    assert rows["number"].tolist() == [1, 5] and rows["x"].tolist() == [2.0, -3.25] and rows["heading"][0] == 0.5


@pytest.mark.parametrize("length", range(5))
def test_rows_are_aligned(length: int) -> None:
    """Browsers read the rows as an array of 4-byte numbers in place."""
    frame = whole_frame("x" * length, 0.0, 1, [body(1, NAME)], {}, rows_of(motions((1, 1.0))))
    assert (len(frame) - ROW.itemsize) % 4 == 0
    assert read(frame)[0]["whole"]


def test_a_floor_without_bodies() -> None:
    header, rows = read(whole_frame("L1", 0.0, 1, [], {}, rows_of(motions())))
    assert header["came"] == [] and len(rows) == 0


def history_of(*moments: tuple[float, float], **limits: Any) -> History:
    history = History(**limits)
    for at_s, x in moments:
        history.add(view((1, x)), at_s)
    return history


def x_at(history: History, at_s: float) -> float:
    return float(read(history.frame("L1", at_s))[1]["x"][0])


def test_looking_back_shows_the_moment_before() -> None:
    history = history_of((10.0, 1.0), (11.0, 2.0), (12.0, 3.0))
    assert [x_at(history, at) for at in (0.0, 10.0, 10.9, 11.0, 11.5, 99.0)] == [1.0, 1.0, 1.0, 2.0, 2.0, 3.0]
    assert history.span() == (10.0, 12.0)
    assert history.floors == ["L1"]


def test_moments_are_some_time_apart() -> None:
    history = history_of((10.0, 1.0), (10.0 + INTERVAL_S / 2, 2.0), (10.0 + INTERVAL_S, 3.0))
    assert x_at(history, 10.0 + INTERVAL_S / 2) == 1.0
    assert x_at(history, 11.0) == 3.0


def test_old_moments_are_forgotten() -> None:
    history = history_of((10.0, 1.0), (15.0, 2.0), (21.0, 3.0), kept_s=10.0)
    assert history.span() == (15.0, 21.0)


@pytest.mark.parametrize("ahead_s", [1.0, -1.0, 3600.0, -3600.0, 365 * 86400.0, -365 * 86400.0])
def test_the_past_stays_as_long_ago_as_it_is_when_the_clock_is_set(ahead_s: float) -> None:
    epoch = 1.7e9
    history = History(kept_s=10.0, epoch=lambda: epoch)
    for at in range(3):
        history.add(view((1, at)), float(at))
    epoch += ahead_s
    for at in range(3, 6):
        history.add(view((1, at)), float(at))
    assert history.span() == (epoch, epoch + 5.0)
    assert [x_at(history, epoch + at) for at in range(6)] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert [moment.at - epoch for moment in history.between("L1", epoch + 1.5, epoch + 4.0)] == [1.5, 2.0, 3.0, 4.0]


def test_memory_is_bounded() -> None:
    limit = 100 * (MOMENT_BYTES + ROW.itemsize)
    history = history_of(*((float(at), float(at)) for at in range(1000)), max_bytes=limit)
    first, last = history.span()
    assert last == 999.0 and first > 0.0
    assert last - first <= 100


def test_moments_of_a_floor_without_bodies_are_bounded() -> None:
    history, empty = History(max_bytes=100 * MOMENT_BYTES), FloorView("L1")
    for at in range(1000):
        cabin = CABIN._replace(height=float(at))
        empty.apply(FloorUpdate("L1", WHOLE, at + 1, float(at), 1, [], [], motions(), {"E": cabin}))
        history.add(empty, float(at))
    first, last = history.span()
    assert last == 999.0
    assert last - first <= 100


def test_a_floor_that_was_never_seen() -> None:
    assert History().span() == (0.0, 0.0)
    with pytest.raises(UnknownFloor):
        history_of((1.0, 1.0)).frame("L9", 1.0)


def test_an_outline_and_riders_of_then_are_kept() -> None:
    history = history_of((10.0, 1.0))
    header, _ = read(history.frame("L1", 10.0))
    assert header["whole"] and header["elevators"]["E"]["riders"] == ["A"]

"""Moments of floors, what has happened in them, and the recordings and films that they become."""

from __future__ import annotations

import copy
import itertools
import json
import math
import os
import resource
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocorba.console import films as films_module
from robocorba.console import monitor_state
from robocorba.console import recordings as recordings_module
from robocorba.console.arguments import NotPossible
from robocorba.console.contacts import Contact, contacts_since
from robocorba.console.defects import DEFECT
from robocorba.console.films import Films, record
from robocorba.console.floor_plan import floor_plan
from robocorba.console.frames import ROW, Rows, update_frame, whole_update
from robocorba.console.happenings import MAX_CONTACTS, MAX_TEXT, Happenings
from robocorba.console.history import INTERVAL_S, KEPT_S, MOMENT_BYTES, History, Moment
from robocorba.console.monitor_state import MonitorState
from robocorba.console.past_files import PastFiles
from robocorba.console.recordings import Recordings
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.model import Building, ElementKind, Wall
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.simulation.recording import Recording
from testkit.buildings import two_floors
from testkit.processes import eventually

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


def test_frames_of_floors() -> None:
    header, rows = read(update_frame(update(3, 4, (1, 2.0), (5, -3.25), came=[body(5, NAME)])))
    assert (header["floor"], header["time"], header["map"], header["whole"]) == ("L1", 1.5, 7, False)
    assert header["went"] == [9]
    assert header["came"] == [{"number": 5, "kind": "robot", "name": NAME, "radius": 0.4, "outline": []}]
    assert header["elevators"]["E"] == {
        **{"cabin": "", "height": 3.5, "doors": "opening", "opening": 0.25},
        **{"riders": ["A"], "queue": ["B", "C"]},
    }
    assert rows["number"].tolist() == [1, 5] and rows["x"].tolist() == [2.0, -3.25] and rows["heading"][0] == 0.5
    # Browsers read the rows as an array of 4-byte numbers in place.
    for length in range(5):
        floor = FloorView("x" * length)
        floor.apply(FloorUpdate(floor.floor, WHOLE, 1, 0.0, 1, [body(1, NAME)], [], motions((1, 1.0)), {}))
        frame = update_frame(whole_update(floor))
        assert (len(frame) - ROW.itemsize) % 4 == 0
        assert read(frame)[0]["whole"]
    header, rows = read(update_frame(whole_update(view())))
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
    assert (history.span(), history.floors, History().span()) == ((10.0, 12.0), ["L1"], (0.0, 0.0))
    history.rename({"L1": "Ground"})
    header, _ = read(history.frame("Ground", 10.0))
    assert header["whole"] and header["elevators"]["E"]["riders"] == ["A"]
    for look in (history.frame, lambda floor, at: history.between(floor, 0.0, at)):
        with pytest.raises(UnknownFloor):
            look("L1", 1.0)
    history = history_of((10.0, 1.0), (10.0 + INTERVAL_S / 2, 2.0), (10.0 + INTERVAL_S, 3.0))
    assert [x_at(history, at) for at in (10.0 + INTERVAL_S / 2, 11.0)] == [1.0, 3.0]
    assert history_of((10.0, 1.0), (15.0, 2.0), (21.0, 3.0), kept_s=10.0).span() == (15.0, 21.0)


@pytest.mark.parametrize("ahead_s", [1.0, -1.0, 3600.0, -3600.0, 365 * 86400.0, -365 * 86400.0])
def test_the_past_stays_as_long_ago_as_it_is_when_the_clock_is_set(ahead_s: float) -> None:
    epoch = 1.7e9
    history = History(kept_s=10.0, epoch=lambda: epoch)
    for at in range(6):
        epoch += ahead_s if at == 3 else 0.0
        history.add(view((1, at)), float(at))
    assert history.span() == (epoch, epoch + 5.0)
    assert [x_at(history, epoch + at) for at in range(6)] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert history.at("L1", epoch + 2.5).at == epoch + 2.0
    assert [moment.at - epoch for moment in history.between("L1", epoch + 1.5, epoch + 4.0)] == [1.5, 2.0, 3.0, 4.0]


@pytest.mark.parametrize("row_bytes", [ROW.itemsize, 0])
def test_memory_is_bounded_also_of_floors_without_bodies(row_bytes: int) -> None:
    history, floor = History(max_bytes=100 * (MOMENT_BYTES + row_bytes)), FloorView("L1")
    came, rows = ([body(1)], motions((1, 0.0))) if row_bytes else ([], motions())
    for at in range(1000):
        cabin = CABIN._replace(height=float(at))
        floor.apply(FloorUpdate("L1", WHOLE, at + 1, float(at), 1, came, [], rows, {"E": cabin}))
        history.add(floor, float(at))
    first, last = history.span()
    assert last == 999.0
    assert 0.0 < last - first <= 100


# ---- the past on disk ----


def kept(
    folder: Path, *moments: tuple[float, float], epoch: float = 1.7e9, max_bytes: int = 2**20
) -> tuple[PastFiles, History, Happenings]:
    """What a console that has seen these moments keeps in a folder."""
    history, happenings = history_of(*moments, epoch=lambda: epoch), Happenings()
    files = PastFiles(folder, history, happenings, two_floors, max_bytes)
    files.keep()
    return files, history, happenings


def test_a_killed_console_finds_its_past_again_with_a_gap(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    now_s = time.monotonic() - 60.0
    first, history, happenings = kept(tmp_path, *((now_s + at, at) for at in range(6)))
    for rows in (ROWS, of_server(collisions=1)):
        happenings.note(rows, now_s + 4.0)
    history.add(view((1, 6.0)), now_s + 6.0)
    first.keep()
    second, alone, _ = kept(tmp_path, (now_s + 7.0, 7.0))
    second.keep()
    assert "in use by another process" in second.problem and caplog.text.count("in memory only") == 1
    assert x_at(alone, 1.7e9 + now_s + 9.0) == 7.0

    assert first._lock
    os.close(first._lock)  # as the kernel does after a kill
    [file] = tmp_path.glob("*.mcap")
    file.write_bytes(file.read_bytes() + b"\x06\x20\0\0\0\0\0\0\0 damaged")
    third, history, happenings = kept(tmp_path, (now_s + 20.0, 20.0), epoch=1.8e9)  # the clock was set
    assert not history.gaps()
    third.close()
    third, history, happenings = kept(tmp_path, (now_s + 30.0, 30.0))
    epoch = history.epoch()
    assert np.allclose(history.gaps(), [(epoch + now_s + 6.0, epoch + now_s + 30.0)], rtol=0.0, atol=0.01)
    assert [x_at(history, epoch + now_s + at) for at in (0.5, 5.5, 31.0)] == [0.0, 5.0, 30.0]
    assert len(history.at("L1", epoch + now_s + 15.0).rows) == 0
    assert [(each.number, each.text) for each in happenings.after(0)] == [(1, "a collision")]
    third.close()


def test_the_past_on_disk_is_bounded_and_goes_on_from_file_to_file(tmp_path: Path) -> None:
    now_s = time.monotonic() - 1000.0
    files, history, _ = kept(tmp_path, (now_s, 0.0), max_bytes=20_000)
    for at in range(1, 100):
        history.add(view((1, at)), now_s + at)
        files.keep()
        assert files.size == sum(file.stat().st_size for file in tmp_path.glob("*.mcap")) <= 20_000
    files.close()
    assert len(list(tmp_path.glob("*.mcap"))) > 2
    files, history, _ = kept(tmp_path)
    found = places(history.between("L1", 0.0, 1.7e9 + now_s + 98.5))
    expected = [(1.7e9 + now_s + at, at) for at in range(99 - len(found), 99)]
    assert np.allclose(found, expected, rtol=0.0, atol=0.01)
    assert 10 < len(found) < 90 and len(history.gaps()) == 1
    files.close()


def test_a_full_disk_stops_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, limits = time.monotonic() - 60.0, resource.getrlimit(resource.RLIMIT_FSIZE)
    files, history, _ = kept(tmp_path, (now_s, 0.0))
    history.add(view((1, 1.0)), now_s + 1.0)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
        files.keep()
        assert "too large" in files.problem
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    monkeypatch.setattr(files, "_retry_s", 0.0)
    files.keep()
    assert not files.problem
    files.close()
    file = tmp_path / "file"
    file.touch()
    assert "exists" in kept(file)[0].problem


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


def driven_history(seconds: int) -> History:
    """A robot that drives 1 m a second along x, seen once a second since 1000.0."""
    return history_with(*({BODY: (2.0 + second, 3.0, 0.0)} for second in range(seconds + 1)), began=1000.0)


def places(moments: list[Moment]) -> list[tuple[float, float]]:
    """Time and x of the robot in each moment."""
    return [(moment.at, float(moment.rows["x"][0])) for moment in moments]


def test_recordings_are_closed_for_newer_ones(
    tmp_path: Path, building: Building, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings_module, "MAX_OPEN", 2)
    file, recordings = tmp_path / "span.mcap", Recordings()
    file.write_text("no recording")
    with pytest.raises(InvalidRecording):
        recordings.open(file, "x")
    assert recordings.rows() == []
    record(file, building, FLOOR, driven_history(5).between(FLOOR, 1000.0, 1005.0), 1006.5)
    assert Recording(file).duration_s == pytest.approx(6.5)
    first = recordings.open(file, "monday.mcap")
    assert first.row() == {"key": first.key, "name": "monday.mcap", "floors": [FLOOR], "past": [1000.0, 1005.0]}
    [(at, x)] = places([first.history.at(FLOOR, 1002.1)])
    assert (at, x) == (pytest.approx(1002.0), 4.0)
    assert first.plan(FLOOR)["name"] == FLOOR
    with pytest.raises(UnknownFloor):
        first.plan("cellar")
    for _ in range(2):
        recordings.open(file, "again")
    assert [row["name"] for row in recordings.rows()] == ["again", "again"]
    with pytest.raises(NotPossible):
        recordings.get(first.key)


def test_a_film_is_made(building: Building, films: Films) -> None:
    number = start_film(films, building, 1003.0, 20.0)
    with pytest.raises(NotPossible, match="another film"):
        start_film(films, building, 1003.0, 20.0)
    eventually(lambda: films.state(number)["phase"] != "making", 120.0, "the end of the film's making")
    assert films.state(number)["problem"] == ""
    assert films.file(number).read_bytes()[4:8] == b"ftyp"
    with pytest.raises(NotPossible, match="make it again"):
        films.file(5)


def start_film(films: Films, building: Building, end_s: float, speed: float) -> int:
    return films.start(building, FLOOR, driven_history(3).between(FLOOR, 1000.0, min(end_s, 1003.0)), end_s, speed)


def test_a_film_that_fails_says_so(building: Building, films: Films, monkeypatch: pytest.MonkeyPatch) -> None:
    for problem in ("cancelled", DEFECT):
        number = start_film(films, building, 1003.0, 1.0)
        if problem == "cancelled":
            films.cancel(number)
        eventually(lambda number=number: films.state(number)["phase"] != "making", what="the end of the film's making")
        assert (films.state(number)["phase"], films.state(number)["problem"]) == ("failed", problem)
        with pytest.raises(NotPossible, match="not ready"):
            films.file(number)
        monkeypatch.setattr(films_module, "record", lambda *_: {}["a defect"])


def test_bad_films_are_refused(building: Building, films: Films) -> None:
    for end_s, speed, refusal in (
        *((end_s, 1.0, "not after") for end_s in (1000.0, 999.0)),
        *((1001.0, speed, "speed") for speed in (0.0, -1.0, 1000.0, math.nan)),
        (2800.0, 1.0, "choose 3 or more"),
    ):
        with pytest.raises(NotPossible, match=refusal):
            films.start(building, FLOOR, driven_history(1).between(FLOOR, 1000.0, 1001.0), end_s, speed)


def test_floor_plans() -> None:
    name = "<script>alert(1)</script>\u202e'\"&"
    building = two_floors().with_changes([(ElementKind.WALL, "L1", name, Wall(name, (1.0, 1.0), (2.0, 1.0)))])
    gaps_m = doors_m = 0.0
    for floor, entry in building.floors.items():
        plan = json.loads(json.dumps(floor_plan(building, floor), allow_nan=False))
        assert plan["name"] == floor
        roads = entry.topological
        for kind, known in (("walls", entry.geometrical.walls), ("nodes", roads.nodes)):
            assert {each["name"] for each in plan[kind]} == set(known)
        assert len(plan["edges"]) == len(roads.edges)
        assert {one["name"] for one in plan["elevators"]} <= set(building.elevators)
        x_min, y_min, x_max, y_max = plan["bounds"]
        assert x_min < x_max and y_min < y_max
        for wall in plan["walls"]:
            drawn_m = sum(math.dist(a, b) for piece in wall["pieces"] for a, b in itertools.pairwise(piece))
            assert drawn_m <= math.dist(wall["a"], wall["b"]) + 1e-3
            gaps_m += math.dist(wall["a"], wall["b"]) - drawn_m
        doors_m += sum(math.dist(door["a"], door["b"]) for door in plan["doors"])
    assert doors_m > 0.1
    assert gaps_m == pytest.approx(doors_m, abs=1e-3)
    with pytest.raises(KeyError):
        floor_plan(building, "L9")


LINK = {"peer": "b", "direction": "INCOMING", "condition": "UP"}
PROGRAM = {"name": "", "result": "NO_RESULT", "reason": ""}


AGENT = {"condition": "IDLE", "reason": "", "at": {"floor": "L1"}, "mission": "", "program": PROGRAM}
SIMULATION = {"collisions": 0, "paused": False}
#: Reports of a system.
ROWS: dict[str, Any] = {
    "naming": "",
    "server": {
        "state": {"state": SIMULATION, "clients": [{"name": "R1", "at": {"floor": "L1"}}], "sensors": []},
        **{"age": 0.1, "problem": ""},
    },
    "robots": {"R1": {"state": AGENT, "age": 0.1, "problem": "", "bound": True}},
    "channels": {"a": {"state": {"links": [LINK]}, "age": 0.1, "problem": ""}},
}


def noticed(*steps: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Kind, robot and text of what a sequence of reports shows."""
    happenings = Happenings()
    for at_s, step in enumerate(steps):
        happenings.note(step, float(at_s))
    return [(each.kind, each.robot, each.text) for each in happenings.after(0)]


def changed(before: dict[str, Any], *path: str, to: Any) -> dict[str, Any]:
    """A copy of reports with one value changed."""
    after = copy.deepcopy(before)
    entry = after
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = to
    return after


def of_robot(before: dict[str, Any], **state: Any) -> dict[str, Any]:
    """The same with another state of R1."""
    return changed(before, "robots", "R1", "state", to={**AGENT, **state})


def of_server(**members: Any) -> dict[str, Any]:
    """Reports with another state of the simulation."""
    return changed(ROWS, "server", "state", "state", to={**SIMULATION, **members})


OFF = changed(ROWS, "server", "state", "clients", to=[])
ENDED = changed(ROWS, "robots", "R1", to={**ROWS["robots"]["R1"], "age": 4.0, "bound": False})
ASKED = changed(ROWS, "robots", "R2", to={"state": None, "age": None, "problem": "", "bound": True})
UNKNOWN = changed(ROWS, "robots", "R1", to={"state": None, "age": None, "problem": "hangs", "bound": True})


DOWN = changed(ROWS, "channels", "a", "state", "links", to=[{**LINK, "condition": "DOWN"}])


CONNECTING = {**ROWS, "naming": "connecting"}
LOST = {**ROWS, "naming": "does not answer"}
#: What reports, one after the other, show: kind, robot and text.
CASES: dict[str, tuple[list[dict[str, Any]], list[tuple[str, str, str]]]] = {
    "the first report and an equal one": ([ROWS, ROWS], []),
    "collisions are counted": (
        [ROWS, of_server(collisions=1), of_server(collisions=3)],
        [("collision", "", "a collision"), ("collision", "", "2 collisions")],
    ),
    "a server that restarts": ([of_server(collisions=7), ROWS], []),
    "stop and release": (
        [ROWS, of_robot(ROWS, condition="STOPPED", reason="emergency stop"), ROWS],
        [("stop", "R1", "R1 is stopped: emergency stop"), ("stop", "R1", "R1 may move again")],
    ),
    "a program": (
        [
            ROWS,
            of_robot(ROWS, condition="RUNNING", program={**PROGRAM, "name": "fetch"}),
            of_robot(ROWS, program={"name": "fetch", "result": "FAILED", "reason": "door"}),
        ],
        [("program", "R1", "R1 runs fetch"), ("program", "R1", "R1 has ended fetch, failed: door")],
    ),
    "a mission": (
        [ROWS, of_robot(ROWS, mission="M1"), ROWS],
        [("mission", "R1", "R1 takes part in mission M1"), ("mission", "R1", "R1 leaves mission M1")],
    ),
    "a robot logs off and falls silent": (
        [ROWS, OFF, changed(OFF, "robots", "R1", "age", to=4.0)],
        [("robot", "R1", "R1 has logged off"), ("robot", "R1", "R1 does not answer")],
    ),
    "a robot ends, which takes its name from the naming service": ([ROWS, ENDED], [("robot", "R1", "R1 has ended")]),
    "a gateway": ([ROWS, DOWN], [("channel", "", "the gateway from b to a is down")]),
    "a new robot, once": (
        [ROWS, ASKED, changed(ROWS, "robots", "R2", to=ROWS["robots"]["R1"])],
        [("robot", "R2", "R2 has started")],
    ),
    "a new robot that hangs": (
        [ROWS, ASKED, changed(ASKED, "robots", "R2", "problem", to="does not answer")],
        [("robot", "R2", "R2 has started"), ("robot", "R2", "R2 does not answer")],
    ),
    "the first robot and channel of a running system": (
        [{**ROWS, "robots": {}, "channels": {}}, ROWS],
        [("robot", "R1", "R1 has started"), ("channel", "", "channel a has started")],
    ),
    "what ran before the console": ([{**CONNECTING, "robots": {}, "channels": {}}, CONNECTING, ROWS, ROWS], []),
    "a lost naming service": ([ROWS, LOST, of_robot(LOST, condition="STOPPED")], [("stop", "R1", "R1 is stopped")]),
    "a robot without any answer": ([ROWS, UNKNOWN], [("robot", "R1", "R1 does not answer")]),
}


@pytest.mark.parametrize("case", CASES)
def test_what_reports_show(case: str) -> None:
    steps, news = CASES[case]
    assert noticed(*steps) == news


def test_a_lost_server_is_no_crowd_of_news_and_old_news_are_forgotten() -> None:
    lost = changed(ROWS, "server", "problem", to="does not answer")
    assert [kind for kind, _, _ in noticed(ROWS, lost, ROWS)] == ["server", "server"]
    happenings = Happenings()
    for at_s, step in ((0.0, ROWS), (1.0, of_server(paused=True)), (KEPT_S + 2.0, ROWS)):
        happenings.note(step, at_s)
    assert [(each.number, each.text) for each in happenings.after(0)] == [(2, "the simulation continues")]
    assert happenings.after(2) == []
    assert happenings.last == 2
    before = {**ROWS, "robots": {"\u202ex": ROWS["robots"]["R1"]}}
    after = changed(before, "robots", "\u202ex", "state", "condition", to="STOPPED")
    assert noticed(before, after) == [("stop", "\u202ex", "\u2068\u202ex\u2069 is stopped")]
    ((_, _, text),) = noticed(ROWS, of_robot(ROWS, condition="STOPPED", reason="x" * 5000))
    assert len(text) == MAX_TEXT


TABLE = ((-0.5, -0.25), (0.5, -0.25), (0.5, 0.25), (-0.5, 0.25))
R1, R2 = (Body(number, BodyKind.ROBOT, name, 0.3, (), 50.0) for number, name in ((1, "R1"), (2, "R2")))
TABLE_1 = Body(3, BodyKind.OBJECT, "table 1", 0.56, TABLE, 20.0)
#: Free places of the building, away from its walls.
AWAY, MIDDLE = (3.0, 2.0, 0.0), (5.0, 2.0, 0.0)


def history_with(*moments: dict[Body, tuple[float, float, float]], began: float = 0.0) -> History:
    """A floor once a second; a moment has the place x, y, heading of each body."""
    history, view = History(), FloorView(FLOOR)
    for second, places in enumerate(moments):
        motions = np.zeros(len(places), MOTION)
        for row, (body, place) in zip(motions, places.items(), strict=True):
            row["number"], (row["x"], row["y"], row["heading"]) = body.number, place
        view.apply(FloorUpdate(FLOOR, WHOLE, second + 1, float(second), 1, list(places), [], motions, {}))
        history.add(view, began + second)
    return history


def found(*moments: dict[Body, tuple[float, float, float]], building: Building | None = None) -> list[Contact]:
    return contacts_since(history_with(*moments), building or Building(""), 0.0, 10.0)


def test_robots_that_meet_somebody_are_named() -> None:
    apart = {R1: AWAY, R2: MIDDLE}
    together = {R1: AWAY, R2: (AWAY[0] + 0.62, AWAY[1], 0.0)}
    assert found(apart, together, apart, together) == [Contact(FLOOR, "R1", "R2")]
    assert found(together, {**together, R1: (AWAY[0], AWAY[1], 1.0)}) == []  # they touched before
    assert found(apart, {R1: AWAY, R2: (AWAY[0] + 0.64, AWAY[1], 0.0)}) == []  # a gap
    assert found({TABLE_1: MIDDLE}, {TABLE_1: AWAY}) == []  # no robots
    # Beside a table lies free floor as long as the table lies along.
    x, y, _ = AWAY
    assert found({R1: AWAY, TABLE_1: MIDDLE}, {R1: AWAY, TABLE_1: (x, y + 0.6, 0.0)}) == []
    turned = {R1: AWAY, TABLE_1: (x, y + 0.6, np.pi / 2)}
    assert found({R1: AWAY, TABLE_1: MIDDLE}, turned) == [Contact(FLOOR, "R1", "table 1")]
    building = two_floors()
    wall = next(iter(building.floors[FLOOR].geometrical.walls.values()))
    end = (*wall.a, 0.0)
    words = {contact.other for contact in found({R1: (50.0, 50.0, 0.0)}, {R1: end}, building=building)}
    assert "a wall" in words
    contacts = [Contact("L2", "R1", "a wall"), Contact("L1", "R2", "table 1")]
    assert collision(contacts) == ("R1", "L2", "2 collisions: R1 and a wall, R2 and table 1")
    assert collision([]) == ("", "", "2 collisions")
    _, _, text = collision([Contact("L1", f"R{number}", "a wall") for number in range(20)])
    assert text.count("a wall") == MAX_CONTACTS
    assert text.endswith(" and others")


def collision(contacts: list[Contact]) -> tuple[str, str, str]:
    """Robot, floor and text of two collisions between these."""
    happenings = Happenings(lambda at_s: contacts)
    for count in (0, 2):
        happenings.note(of_server(collisions=count), 1.0)
    (happening,) = happenings.after(0)
    return happening.robot, happening.floor, happening.text


class FakeState:
    """Reports the clients that a test sets."""

    def __init__(self) -> None:
        self.clients, self.forgotten = list[str](), list[str]()
        self.forget, self.start, self.close = self.forgotten.append, int, int

    def rows(self) -> dict[str, Any]:
        clients = [{"name": name, "at": {"floor": "L1", "x": 1.0, "y": 2.0, "heading": 0.0}} for name in self.clients]
        server = {"state": {"state": SIMULATION, "clients": clients, "sensors": []}, "age": 0.0, "problem": ""}
        return {"naming": "", "server": server, "robots": {}, "channels": {}}


def test_a_robot_that_logged_off_is_known_until_it_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = FakeState()
    state = MonitorState(fake, History())
    for clients, gone in ((["R1", "R2"], []), (["R2"], ["R1"]), ([], ["R1", "R2"]), (["R2"], ["R1"])):
        fake.clients = clients
        state.update()
        assert sorted(state.rows()["gone"]) == gone
    row = state.rows()["gone"]["R1"]
    assert row["client"]["at"]["x"] == 1.0
    assert row["age"] >= 0.0
    state.forget("R1")
    assert state.rows()["gone"] == {}
    assert fake.forgotten == ["R1"]
    monkeypatch.setattr(monitor_state, "MAX_GONE", 3)
    for number in range(3, 9):
        fake.clients = [f"R{number}"]
        state.update()
    fake.clients = []
    assert list(state.rows()["gone"]) == ["R6", "R7", "R8"]


def test_the_span_to_look_back_begins_with_the_history_and_happenings_are_numbered_in_the_rows() -> None:
    fake, history = FakeState(), History()
    state = MonitorState(fake, history)
    began, now = state.rows()["past"]
    assert began == now
    history.add(view(), now - 10.0)
    assert state.rows()["past"][0] == now - 10.0
    for fake.clients in ([], ["R1"]):
        state.update()
    assert state.rows()["happenings"] == 1
    assert state.happenings.after(0)[0].text == "R1 has logged on"

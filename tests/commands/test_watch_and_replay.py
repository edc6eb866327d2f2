"""What `robocorba watch`, `record` and `replay` show, write and refuse, and when they retry and end."""

from __future__ import annotations

import contextlib
import importlib
import io
import itertools
import json
import math
import os
import signal
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
import typer
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner, Result

from robocorba.commands.replay import replay
from robocorba.commands.simulation_tables import as_json, clients, elevators, members, robots, sensor, sheets, with_note
from robocorba.commands.tables import show
from robocorba.commands.waiting import Outage, StopSignal
from robocorba.commands.watch import Camera, film
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.simulation.recording import Recorder, Recording
from robocorba.simulation.system_changes import SystemChanges
from robocorba.stubs import RoboCorba
from robocorba.system.logs import one_line
from testkit.buildings import two_floors
from testkit.processes import eventually
from tests.waits import outlast, work_for


def view(floor: str, *names: str, moments: dict[str, ElevatorState] | None = None) -> FloorView:
    """A floor where robots drive at 0.5 m/s from x = 1, 2, ... m, among a chair."""
    bodies = [Body(number, BodyKind.ROBOT, name, 0.4, (), 127.0) for number, name in enumerate(names, 1)]
    bodies.insert(0, Body(99, BodyKind.OBJECT, "chair", 0.3, ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), 5.0))
    rows = [(body.number, 0.3, 0.4, 0.0, float(body.number), 2.0, math.pi / 2) for body in bodies]
    found = FloorView(floor)
    found.apply(FloorUpdate(floor, WHOLE, 1, 5.0, 1, bodies, [], np.array(rows, MOTION), moments or {}))
    return found


def client(name: str, floor: str) -> RoboCorba.ClientState:
    return RoboCorba.ClientState(name, RoboCorba.Pose(floor, 3.0, 4.0, -math.pi), 1.7e9, 0.25, 12.5, 0.0015, "s1")


RIDE = {"E1": ElevatorState(1.75, "", Doors.CLOSED, 0.0, ("A",), ("B", "C"))}
STOP = {"E2": ElevatorState(0.0, "L1", Doors.OPENING, 0.5, (), ())}
STATE = RoboCorba.ServerState(300, 2, 91.84, 0.0, 57.3, True, 4, 69, 15.81)
SENSOR = RoboCorba.SensorState("s1", RoboCorba.SensorLoad(0.31, 0.032, 1234.5, 7), 9)


def test_the_tables_of_a_simulation() -> None:
    floors = [view("L1", "A", "B", moments=RIDE), view("L2", moments=STOP)]
    tables = {"server": [members(STATE)], "robots": clients([client("B", "L1")], floors)}
    tables |= {"elevators": elevators(floors), "sensors": [sensor(SENSOR)]}
    found = [[dict(zip(each.titles, row, strict=True)) for row in each.rows] for each in sheets(tables)]
    lift = ("elevator", "cabin", "height [m]", "doors", "open [%]", "riders", "queue")
    assert found == [
        [
            {
                **{"robots": "2", "limit": "300", "time [s]": "91.8", "pace": "as fast as possible"},
                **{"achieved": "57.30", "paused": "yes", "collisions": "69", "events/s": "15.8", "map version": "4"},
            }
        ],
        [
            {
                **{"robot": "B", "floor": "L1", "x [m]": "3.00", "y [m]": "4.00", "heading [°]": "-180"},
                **{"speed [m/s]": "0.50", "silent [s]": "0.25", "calls/s": "12.5", "latency [ms]": "1.50"},
                "served by": "s1",
            }
        ],
        [
            dict(zip(lift, ("E1", "travelling", "1.75", "closed", "0", "A", "B, C"), strict=True)),
            dict(zip(lift, ("E2", "L1", "0.00", "opening", "50", "", ""), strict=True)),
        ],
        [{"sensor server": "s1", "robots": "9", "busy [%]": "31", "lag [ms]": "32", "scans/s": "1234.5"}],
    ]
    written = json.loads(json.dumps(as_json(tables)))
    assert (written["robots"][0]["call_rate"], written["server"]["map_version"]) == (12.5, 4)


def test_rows_of_robots_and_elevators(capsys: pytest.CaptureFixture[str]) -> None:
    both = [client("A", "L1"), client("B", "L2")]
    assert [row["name"] for row in clients(both, [view("L2")])] == ["B"]
    assert [row["name"] for row in clients(both, [view("L2"), view("L1")])] == ["A", "B"]
    (found,) = clients([client("new", "L1")], [view("L1", "A")])
    assert found["speed"] == 0.0  # it is on no floor yet
    later = {"E1": ElevatorState(3.5, "L2", Doors.OPEN, 1.0, (), ())}
    (found,) = elevators([view("L1", moments=RIDE), view("L2", moments=later)])
    assert (found["cabin"], found["doors"]) == ("L2", "OPEN")
    assert sheets({}) == []
    found = robots([view("L1", "A"), view("L2", "C")])
    (sheet,) = sheets({"robots": found})
    assert sheet.titles == ["robot", "floor", "x [m]", "y [m]", "heading [°]", "speed [m/s]"]
    assert sheet.rows == [["A", "L1", "1.00", "2.00", "90", "0.50"], ["C", "L2", "1.00", "2.00", "90", "0.50"]]
    found = [found[0] | {"nearest": None, "nearest_is": ""}, found[1] | {"nearest": 0.118, "nearest_is": "in no map"}]
    (sheet,) = sheets({"robots": found})
    assert sheet.titles[-2:] == ["nearest [m]", "nearest is"]
    assert [row[-2:] for row in sheet.rows] == [["", ""], ["0.12", "in no map"]]
    show(*sheets({"robots": robots([view("L\t1", "A")])}))
    assert capsys.readouterr().out.splitlines()[1:] == ["A\tL\\t1\t1.00\t2.00\t90\t0.50"]


@settings(max_examples=30)
@given(name=st.text(), floor=st.text())
def test_any_name_is_a_cell_of_one_line(name: str, floor: str) -> None:
    moments = {name: STOP["E2"]}
    tables = {"robots": robots([view(floor, name)]), "elevators": elevators([view(floor, moments=moments)])}
    console = Console(file=io.StringIO(), width=3000)
    console.print(with_note(tables, note="gone [/]"))
    assert isinstance(console.file, io.StringIO)
    rows = console.file.getvalue().split("\n")
    assert (len(rows), rows[-2]) == (12, "gone [/]") and rows == list(map(one_line, rows))


# ---- signals and outages ----


@pytest.fixture
def stop() -> Iterator[StopSignal]:
    """A stop, and afterwards the signals as they were."""
    with contextlib.closing(StopSignal()) as stop:
        yield stop


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_wait(stop: StopSignal, number: signal.Signals) -> None:
    assert not stop.wait(0.0)
    os.kill(os.getpid(), number)
    began = time.monotonic()
    assert stop.wait(60.0)
    assert stop.wait(60.0)
    assert time.monotonic() - began < 50.0


def test_ticks_come_in_time_until_a_signal(stop: StopSignal) -> None:
    began = time.monotonic()
    times = list(stop.ticks(0.02, 0.5))
    assert time.monotonic() - began >= 0.5
    assert times[0] == 0.0 and times[-1] < 0.5
    assert len(times) <= 25
    assert all(later > earlier for earlier, later in itertools.pairwise(times))
    slow = 0
    for _ in stop.ticks(0.01, 0.5):
        slow += 1
        work_for(0.05)
    assert 0 < slow <= 10
    eventually(lambda: len(list(stop.ticks(0.02, 0.1))) > 1, what="more than one on a machine that is not too busy")
    count = 0
    for _ in stop.ticks(0.001):
        count += 1
        if count == 3:
            os.kill(os.getpid(), signal.SIGTERM)
    assert count == 3


def test_an_outage_has_a_limit() -> None:
    wrong = NotReachable("gone")
    outage = Outage(0.1)
    assert not outage.is_active
    assert outage.note_failure(wrong) == "not reachable for 0 s: gone"
    assert outage.is_active
    outage.note_answer()
    assert not outage.is_active
    outage.note_failure(wrong)
    outlast(0.1)
    with pytest.raises(NotReachable, match="gone"):
        outage.note_failure(wrong)


class FilmedFloor(Camera):
    """A camera whose pictures show the time at which they were taken, as a grey. answers: when calls begin and when
    they are answered [s]; None: the call fails then. It is the clock and the stop signal of the film too."""

    def __init__(self, answers: list[tuple[float, float, bool]]) -> None:
        self._answers = iter(answers)
        self._next = (0.0, 0.0, True)
        self.now = 100.0

    def ticks(self, every_s: float, limit_s: float = 0.0) -> Iterator[float]:
        for answer in self._answers:
            self._next, self.now = answer, 100.0 + answer[0]
            yield answer[0]
        self.now = max(self.now, 100.0 + limit_s)

    def png(self, resolve_timeout_s: float = 0.0) -> bytes:
        _, at_s, is_answered = self._next
        self.now = 100.0 + at_s
        if not is_answered:
            raise NotReachable("gone")
        buffer = io.BytesIO()
        Image.new("L", (64, 64), grey(at_s)).save(buffer, "PNG")
        return buffer.getvalue()


def grey(taken_s: float) -> int:
    return 20 + round(6 * taken_s)


def filmed(tmp_path: Path, answers: list[tuple[float, float, bool]], seconds: float) -> list[float]:
    """When the picture of each frame was taken [s], of a film with 5 frames per second."""
    floor, file = FilmedFloor(answers), tmp_path / "a.mp4"
    with contextlib.suppress(NotReachable):
        film(floor, file, seconds, 5, floor, lambda: floor.now)  # type: ignore[arg-type]
    with av.open(str(file)) as container:
        greys = [frame.to_ndarray(format="gray")[32, 32] for frame in container.decode(video=0)]
    return [(float(value) - 20) / 6 for value in greys]


def test_a_gap_of_a_film_shows_the_picture_before_it(tmp_path: Path) -> None:
    steady = [(0.2 * n, 0.2 * n, True) for n in range(10)]
    taken = filmed(tmp_path, [*steady, (2.0, 30.0, True), (30.2, 30.2, True)], 31.0)
    assert len(taken) == 5 * 31
    for frame, taken_s in enumerate(taken):
        assert taken_s <= frame / 5 + 0.4, f"frame {frame} is from the future"
    assert taken[5 * 29] == pytest.approx(1.8, abs=0.5)
    assert taken[-1] == pytest.approx(30.2, abs=0.5)


@pytest.mark.parametrize(("seconds", "frames"), [(0.0, 50), (20.0, 100)])
def test_the_last_gap_of_a_film_is_in_it(tmp_path: Path, seconds: float, frames: int) -> None:
    """The server dies after 2 s; the film goes on up to its end, or to the last call that failed."""
    steady = [(0.2 * n, 0.2 * n, True) for n in range(11)]
    outage = [(2.2 + 0.6 * n, 2.7 + 0.6 * n, False) for n in range(13)]
    taken = filmed(tmp_path, [*steady, *outage], seconds)
    assert abs(len(taken) - frames) <= 1
    assert taken[-1] == pytest.approx(2.0, abs=0.5)


record = importlib.import_module("robocorba.commands.record")  # whose name is also that of the command


def recorded_by(
    path: Path, answers: Sequence[list[FloorUpdate] | NotReachable], **limits: float
) -> list[tuple[float, int]]:
    """The updates in a recording of floors that answer so, one after another, with ticks that don't wait."""
    left = iter(answers)

    def follow(resolve_timeout_s: float) -> SystemChanges:
        answer = next(left)
        if isinstance(answer, NotReachable):
            raise answer
        return SystemChanges(answer, [], [], [])

    floors: Any = SimpleNamespace(follow=follow)
    times: Any = SimpleNamespace(ticks=lambda every_s, limit_s: (every_s * each for each in range(len(answers))))
    (path / "a.mcap").unlink(missing_ok=True)
    with Recorder(path / "a.mcap", two_floors()) as recorder:
        record.record_changes(floors, recorder.write_changes, 0.0, times, **limits)
    return [(round(at_s, 3), update.version) for at_s, update in Recording(path / "a.mcap").updates()]


def floor_update(since: int, version: int, floor: str = "L1") -> FloorUpdate:
    return FloorUpdate(floor, since, version, 0.1 * version, 1, [], [], np.empty(0, MOTION), {})


def test_changes_are_recorded_up_to_an_outage(tmp_path: Path) -> None:
    whole, next_one = floor_update(WHOLE, 5), floor_update(5, 6)
    away, again = NotReachable("away"), [floor_update(WHOLE, 105)]
    answers: list[list[FloorUpdate] | NotReachable] = [
        [whole, floor_update(WHOLE, 7, "L2")],
        [next_one, floor_update(7, 7, "L2")],
    ]
    assert recorded_by(tmp_path, [*answers, [floor_update(6, 9)]]) == [(0.0, 5), (0.0, 7), (0.05, 6), (0.1, 9)]
    # An unchanged floor is recorded rarely.
    assert recorded_by(tmp_path, [[whole], *([floor_update(5, 5)] for _ in range(50))]) == [
        (0.0, 5),
        (1.0, 5),
        (2.0, 5),
    ]
    # Recording continues after an outage.
    answers = [[whole], [next_one], away, away, away, again, [floor_update(105, 106)]]
    assert recorded_by(tmp_path, answers) == [(0.0, 5), (0.05, 6), (0.25, 105), (0.3, 106)]
    with pytest.raises(NotReachable, match="away"):
        recorded_by(tmp_path, [[floor_update(WHOLE, 5)], *[NotReachable("away")] * 3], outage_limit_s=0.0)
    found = Recording(tmp_path / "a.mcap")
    assert (found.is_complete, found.count) == (True, 1)


app = typer.Typer()
app.command()(replay)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds in which a robot drives on each floor, at 1 m/s from x = 1 m."""
    path = tmp_path_factory.mktemp("recording") / "a.mcap"
    with Recorder(path, two_floors()) as recorder:
        for tick in range(41):
            for number, floor in enumerate(("L1", "L2"), 1):
                body = Body(number, BodyKind.ROBOT, f"R{number}", 0.4, (), 127.0)
                came = [body] if tick == 0 else []
                rows = np.array([(number, 1.0, 0.0, 0.0, 1.0 + 0.05 * tick, 5.0, 0.0)], MOTION)
                moments = {"E1": ElevatorState(0.0, "L1", Doors.CLOSED, 0.0, (), ())} if tick == 0 else {}
                update = FloorUpdate(floor, tick, tick + 1, 0.05 * tick, 1, came, [], rows, moments)
                recorder.write(update, 1.7e9 + 0.05 * tick)
    return path


def replayed(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_rows_and_pictures_of_a_recording(recording: Path, tmp_path: Path) -> None:
    found = replayed(recording)
    assert found.exit_code == 0
    assert found.stdout.splitlines() == [
        "robot\tfloor\tx [m]\ty [m]\theading [°]\tspeed [m/s]",
        "R1\tL1\t3.00\t5.00\t0\t1.00",
        "R2\tL2\t3.00\t5.00\t0\t1.00",
        "",
        "elevator\tcabin\theight [m]\tdoors\topen [%]\triders\tqueue",
        "E1\tL1\t0.00\tclosed\t0\t\t",
    ]
    found = replayed(recording, "--at", "1.01", "--floor", "L2")
    assert found.stdout.splitlines()[1] == "R2\tL2\t2.00\t5.00\t0\t1.00"
    assert "R1" not in found.stdout
    found = replayed(recording, "--png", tmp_path / "a.png", "--at", "1", "--width", "300")
    assert (found.exit_code, found.stdout) == (0, f"drew {tmp_path / 'a.png'}\n")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.format == "PNG"
        assert picture.width == 300


@pytest.mark.usefixtures("stop")  # which puts signals in order again, to which videos listen
def test_a_video(recording: Path, tmp_path: Path) -> None:
    for speed, pictures in (("1", 21), ("4", 6)):
        file = tmp_path / f"{speed}.mp4"
        found = replayed(recording, "--video", file, "--floor", "L2", "--width", "301", "--speed", speed)
        assert (found.exit_code, found.stderr) == (0, "")
        assert found.stdout.startswith(f"wrote {file}: {pictures / 10:.1f} s, {pictures} pictures of 302 x")
        with av.open(str(file)) as container:
            frames = list(container.decode(video=0))
        assert len(frames) == pictures
        first, last = (frames[i].to_ndarray(format="rgb24").astype(int) for i in (0, -1))
        assert np.abs(first - last).max() > 50


def test_what_is_impossible_is_one_line(recording: Path, tmp_path: Path) -> None:
    unknown, png = "recording: there is no floor 'L9'; known are L1, L2", f"{tmp_path}/b.png"
    for arguments, reason in (
        *((("--floor", "L9", *more), unknown) for more in ((), ("--png", png))),
        (
            ("--floor", "L1", "--floor", "L2", "--video", f"{tmp_path}/b.mp4"),
            "--floor is 'L1, L2': a picture shows one",
        ),
        (("--video", f"{tmp_path}/b.gif"), f"{tmp_path}/b.gif: a video's name ends with .mp4"),
        (("--video", f"{tmp_path}/no/b.mp4"), f"{tmp_path}/no/b.mp4: No such file or directory"),
        (("--png", f"{tmp_path}/no/b.png"), f"{tmp_path}/no/b.png: No such file or directory"),
        (("--png", png, "--width", "5"), "width: 5 is not"),
    ):
        found = replayed(recording, *arguments)
        assert (found.exit_code, found.stdout) == (1, "")
        assert found.stderr.startswith(f"robocorba replay: {reason}")
        assert found.stderr.count("\n") == 1


def test_files_that_are_no_recordings_or_would_not_end_are_refused(tmp_path: Path) -> None:
    with Recorder(tmp_path / "empty.mcap", two_floors()):
        pass
    (tmp_path / "other.mcap").write_text("other")
    for name, reason in (
        ("empty.mcap", "contains no updates"),
        ("other.mcap", "not an MCAP file"),
        ("no.mcap", "No such file"),
    ):
        found = replayed(tmp_path / name)
        assert found.exit_code == 1
        assert found.stderr.startswith(f"robocorba replay: {tmp_path / name}: {reason}")
    with Recorder(tmp_path / "a.mcap", two_floors()) as recorder:
        for version, at_s in ((1, 0.0), (2, 300 * 86400.0)):
            update = FloorUpdate("L1", version - 1, version, at_s, 1, [], [], np.zeros(0, MOTION), {})
            recorder.write(update, 1.7e9 + at_s)
    found = replayed(tmp_path / "a.mcap", "--video", tmp_path / "a.mp4")
    assert "the film would have 259200000 pictures, at most 1000000: choose 260 or more" in found.stderr
    assert not (tmp_path / "a.mp4").exists()

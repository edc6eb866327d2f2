"""What `robocorba watch` shows of any state, and when it retries and ends."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import math
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from rich.console import Console

from robocorba.commands.simulation_tables import (
    SimulationTables,
    as_tables,
    clients,
    elevators,
    filled_tables,
    members,
    robots,
    sensor,
    show,
)
from robocorba.commands.waiting import Outage, StopSignal
from robocorba.commands.watch import Camera, film
from robocorba.errors.services import NotReachable
from robocorba.spatial.elevator_state import Doors, ElevatorState
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.stubs import RoboCorba
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
    tables = SimulationTables(
        [members(STATE)], clients([client("B", "L1")], floors), elevators(floors), [sensor(SENSOR)]
    )
    found = {
        kind: [dict(zip(titles, row, strict=True)) for row in rows] for kind, titles, rows in filled_tables(tables)
    }
    assert found == {
        "server": [
            {
                "robots": "2",
                "limit": "300",
                "time [s]": "91.8",
                "pace": "as fast as possible",
                "achieved": "57.30",
                "paused": "yes",
                "collisions": "69",
                "events/s": "15.8",
                "map version": "4",
            }
        ],
        "robot": [
            {
                "robot": "B",
                "floor": "L1",
                "x [m]": "3.00",
                "y [m]": "4.00",
                "heading [°]": "-180",
                "speed [m/s]": "0.50",
                "silent [s]": "0.25",
                "calls/s": "12.5",
                "latency [ms]": "1.50",
                "sensor server": "s1",
            }
        ],
        "elevator": [
            {
                "elevator": "E1",
                "cabin": "travelling",
                "height [m]": "1.75",
                "doors": "closed",
                "open [%]": "0",
                "riders": "A",
                "queue": "B, C",
            },
            {
                "elevator": "E2",
                "cabin": "L1",
                "height [m]": "0.00",
                "doors": "opening",
                "open [%]": "50",
                "riders": "",
                "queue": "",
            },
        ],
        "sensor": [{"sensor server": "s1", "robots": "9", "busy [%]": "31", "lag [ms]": "32", "scans/s": "1234.5"}],
    }
    assert json.loads(json.dumps(tables._asdict()))["robots"][0]["callRate"] == 12.5


def test_only_robots_on_the_floors_are_shown() -> None:
    both = [client("A", "L1"), client("B", "L2")]
    assert [row["name"] for row in clients(both, [view("L2")])] == ["B"]
    assert [row["name"] for row in clients(both, [view("L2"), view("L1")])] == ["A", "B"]


def test_a_robot_that_is_on_no_floor_yet_has_no_speed() -> None:
    (found,) = clients([client("new", "L1")], [view("L1", "A")])
    assert found["speed"] == 0.0


def test_robots_of_floors_without_a_server() -> None:
    tables = SimulationTables(robots=robots([view("L1", "A", "B"), view("L2", "C")]))
    ((kind, titles, rows),) = filled_tables(tables)
    assert (kind, titles) == ("robot", ("robot", "floor", "x [m]", "y [m]", "heading [°]", "speed [m/s]"))
    assert rows == [
        ("A", "L1", "1.00", "2.00", "90", "0.50"),
        ("B", "L1", "2.00", "2.00", "90", "0.50"),
        ("C", "L2", "1.00", "2.00", "90", "0.50"),
    ]


def test_the_last_known_elevator_counts() -> None:
    later = {"E1": ElevatorState(3.5, "L2", Doors.OPEN, 1.0, (), ())}
    (found,) = elevators([view("L1", moments=RIDE), view("L2", moments=later)])
    assert (found["cabin"], found["doors"]) == ("L2", "OPEN")


def test_an_empty_state_has_no_tables() -> None:
    assert filled_tables(SimulationTables()) == []


@given(name=st.text(), floor=st.text())
def test_any_name_is_a_cell_of_one_line(name: str, floor: str) -> None:
    tables = SimulationTables(
        robots=robots([view(floor, name)]), elevators=elevators([view(floor, moments={name: STOP["E2"]})])
    )
    assert all(cell.isprintable() for _, _, rows in filled_tables(tables) for row in rows for cell in row)
    console = Console(file=io.StringIO(), width=300)
    console.print(as_tables(tables, note="gone [/]"))


def test_without_a_terminal_a_row_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    show(SimulationTables(robots=robots([view("L\t1", "A")])))
    assert capsys.readouterr().out == "robot\tA\tL\\t1\t1.00\t2.00\t90\t0.50\n"


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
    assert time.monotonic() - began < 5.0


def test_ticks_come_in_time_up_to_a_limit(stop: StopSignal) -> None:
    began = time.monotonic()
    times = list(stop.ticks(0.02, 1.0))
    assert time.monotonic() - began >= 1.0
    assert times[0] == 0.0
    assert 1 < len(times) <= 50
    assert times == sorted(times) and times[-1] < 1.0
    assert all(later - earlier > 0.0 for earlier, later in itertools.pairwise(times))


def test_slow_ticks_are_missed_not_made_up_for(stop: StopSignal) -> None:
    slow = []
    for passed_s in stop.ticks(0.01, 1.0):
        slow.append(passed_s)
        work_for(0.05)
    assert 2 <= len(slow) <= 20


def test_ticks_end_by_a_signal(stop: StopSignal) -> None:
    count = 0
    for _ in stop.ticks(0.001):
        count += 1
        if count == 3:
            os.kill(os.getpid(), signal.SIGTERM)
    assert count == 3


def test_an_outage_raises_after_its_limit() -> None:
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

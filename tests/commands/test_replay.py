"""`robocorba replay` of a recording: as rows, as a picture, as a video. No server runs."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
import typer
from PIL import Image
from typer.testing import CliRunner, Result

from robocorba.commands.replay import replay
from robocorba.simulation.recording import Recorder
from robocorba.spatial.elevator_state import Doors, ElevatorState
from robocorba.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.testing.buildings import two_floors

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


@pytest.fixture(autouse=True)
def signals() -> Iterator[None]:
    """Videos listen to signals."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_end_in_rows(recording: Path) -> None:
    found = run(recording)
    assert found.exit_code == 0
    assert found.stdout.splitlines() == [
        "robot\tR1\tL1\t3.00\t5.00\t0\t1.00",
        "robot\tR2\tL2\t3.00\t5.00\t0\t1.00",
        "elevator\tE1\tL1\t0.00\tclosed\t0\t\t",
    ]


def test_a_moment_of_a_floor(recording: Path) -> None:
    found = run(recording, "--at", "1.01", "--floor", "L2")
    assert found.stdout.splitlines()[0] == "robot\tR2\tL2\t2.00\t5.00\t0\t1.00"
    assert "R1" not in found.stdout


def test_a_picture(recording: Path, tmp_path: Path) -> None:
    found = run(recording, "--png", tmp_path / "a.png", "--at", "1", "--width", "300")
    assert (found.exit_code, found.stdout) == (0, f"drew {tmp_path / 'a.png'}\n")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.format == "PNG"
        assert picture.width == 300


@pytest.mark.parametrize(("speed", "pictures"), [("1", 21), ("4", 6)])
def test_a_video(recording: Path, tmp_path: Path, speed: str, pictures: int) -> None:
    found = run(recording, "--video", tmp_path / "a.mp4", "--floor", "L2", "--width", "301", "--speed", speed)
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout.startswith(f"wrote {tmp_path / 'a.mp4'}: {pictures / 10:.1f} s, {pictures} pictures of 302 x")
    with av.open(str(tmp_path / "a.mp4")) as container:
        frames = list(container.decode(video=0))
    assert len(frames) == pictures
    first, last = (frames[i].to_ndarray(format="rgb24").astype(int) for i in (0, -1))
    assert np.abs(first - last).max() > 50


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--floor", "L9"), "recording: there is no floor 'L9'; known are L1, L2"),
        (("--floor", "L9", "--png", "{}/b.png"), "recording: there is no floor 'L9'; known are L1, L2"),
        (("--floor", "L1", "--floor", "L2", "--video", "{}/b.mp4"), "--floor is 'L1, L2': a picture shows one floor"),
        (("--video", "{}/b.gif"), "{}/b.gif: a video's name ends with .mp4"),
        (("--video", "{}/no/b.mp4"), "{}/no/b.mp4: No such file or directory"),
        (("--png", "{}/no/b.png"), "{}/no/b.png: No such file or directory"),
        (("--png", "{}/b.png", "--width", "5"), "width: 5 is not"),
    ],
)
def test_what_can_not_be_done_is_one_line(
    recording: Path, tmp_path: Path, arguments: tuple[str, ...], reason: str
) -> None:
    found = run(recording, *(argument.format(tmp_path) for argument in arguments))
    assert (found.exit_code, found.stdout) == (1, "")
    assert found.stderr.startswith(f"robocorba replay: {reason.format(tmp_path)}")
    assert found.stderr.count("\n") == 1


def test_a_film_that_would_not_end_is_refused(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", two_floors()) as recorder:
        for version, at_s in ((1, 0.0), (2, 300 * 86400.0)):
            update = FloorUpdate("L1", version - 1, version, at_s, 1, [], [], np.zeros(0, MOTION), {})
            recorder.write(update, 1.7e9 + at_s)
    found = run(tmp_path / "a.mcap", "--video", tmp_path / "a.mp4")
    assert "the film would have 259200000 pictures, at most 1000000: choose 260 or more" in found.stderr
    assert not (tmp_path / "a.mp4").exists()


def test_files_that_are_no_recordings(tmp_path: Path) -> None:
    with Recorder(tmp_path / "empty.mcap", two_floors()):
        pass
    (tmp_path / "other.mcap").write_text("other")
    for name, reason in (
        ("empty.mcap", "contains no updates"),
        ("other.mcap", "not an MCAP file"),
        ("no.mcap", "No such file"),
    ):
        found = run(tmp_path / name)
        assert found.exit_code == 1
        assert found.stderr.startswith(f"robocorba replay: {tmp_path / name}: {reason}")

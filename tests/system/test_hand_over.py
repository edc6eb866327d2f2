"""The paper's Figure 11: two robots hand over a sheet of paper, virtual and then actual, by the same two programs."""

from __future__ import annotations

import csv
import functools
import math
import os
import threading
from collections import deque
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import av
import numpy as np
import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.clients import hand_over
from robocorba.clients.hand_over import BASE_RETREAT_M, BUILDING, CHANNEL, GIVER, MEETING_POSES, START_POSES, TAKER
from robocorba.clients.hand_over_facts import GIVING, TAKING, Moment, facts, faults
from robocorba.kinematics import tasks
from robocorba.kinematics.body import SmartPalBody
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import GRIP, JOINTS, OPEN_RAD, SHUT_RAD, Side
from robocorba.kinematics.tasks import GRIP_DEPTH_M, SHEET_M
from robocorba.maps.samples import load_sample, sample_path
from robocorba.motion.robot_state import RobotState
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.programs.checker import Start, check
from robocorba.simulation.recording import Recording
from robocorba.spatial.arrays import Floats
from robocorba.supervision.launch import LoggedProcess, module_command
from robocorba.testing.processes import Launcher, real_system

pytestmark = [pytest.mark.slow, pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = Path(str(files("robocorba") / "samples"))
#: From hand to hand along the sheet, and what they may be off, m.
HAND_DISTANCE_M, NEAR_M = SHEET_M - 2 * GRIP_DEPTH_M, 0.005
FLOOR = "L1"
#: What is between the time and the icon in the line of an icon that begins.
ICON = " s  "
#: On a loaded machine processes take long to start, s.
LIMIT_S = 380.0


# ---- the programs ----


def test_the_samples_are_what_is_computed(tmp_path: Path) -> None:
    assert hand_over.main([str(tmp_path), "--write-programs"]) == 0
    names = {"hand-over-giver.json", "hand-over-taker.json"}
    assert {file.name for file in tmp_path.iterdir()} == names
    for name in names:
        assert (SAMPLES / name).read_text() == (tmp_path / name).read_text()


@pytest.mark.parametrize("robot", [GIVER, TAKER])
def test_the_programs_are_sound(robot: str) -> None:
    x, y, heading = START_POSES[robot]
    planner = PathPlanner(load_sample(BUILDING))
    report = check(hand_over.programs()[robot], InverseKinematics(), planner, Start(Place(FLOOR, x, y), heading))
    assert report.findings == ()


# ---- what is checked of a hand-over ----


@pytest.fixture(scope="module")
def kinematics() -> InverseKinematics:
    return InverseKinematics()


class Play:
    """Moments made up: both robots stand where they meet, with their hands as told."""

    def __init__(self, kinematics: InverseKinematics) -> None:
        self._kinematics = kinematics
        between_m = math.dist(MEETING_POSES[GIVER][:2], MEETING_POSES[TAKER][:2])
        self._ends = tasks.hand_over(between_m, hand_over.SHEET_HEIGHT_M, hand_over.SHEET_LEFT_M)
        self.moments: list[Moment] = []

    def add(self, giver_shut: bool, taker_shut: bool, back_m: float = 0.0, **off: float) -> Play:
        """back_m: how far both hands are drawn back. off: what is wrong with the taker's hand: z, m, or yaw, rad."""
        taker = self._ends.taker.moved(-back_m)
        taker = taker._replace(z=taker.z + off.get("z", 0.0), yaw=off.get("yaw", 0.0))
        giver = self._state(GIVER, GIVING, self._ends.giver.moved(-back_m), giver_shut)
        self.moments.append(
            Moment(0.5 * len(self.moments), giver, self._state(TAKER, TAKING, taker, taker_shut, off.get("x", 0.0)))
        )
        return self

    def _state(self, robot: str, side: Side, hand: HandPose, is_shut: bool, offset_m: float = 0.0) -> RobotState:
        joints = self._kinematics.solve({side: hand}, np.zeros(len(JOINTS)))
        joints[GRIP[side]] = SHUT_RAD if is_shut else OPEN_RAD
        x, y, heading = MEETING_POSES[robot]
        return RobotState(0.0, x + offset_m, y, heading, joints=joints)


def test_a_hand_over_as_it_should_be(kinematics: InverseKinematics) -> None:
    play = Play(kinematics).add(False, False, 0.1).add(True, False).add(True, True).add(True, True)
    play.add(False, True).add(False, True, 0.1)
    seen = facts(play.moments)
    assert (seen.gripped_s, seen.released_s, seen.is_taken) == (1.0, 2.0, True)
    assert (seen.distance_error_m, seen.height_error_m, seen.angle_error_rad) == pytest.approx((0, 0, 0), abs=1e-4)
    assert seen.end_distance_m == pytest.approx(HAND_DISTANCE_M + 0.2, abs=1e-4)
    assert faults(seen) == []


@pytest.mark.parametrize(
    ("off", "fault"),
    [
        ({"x": 0.008}, "the hands were 8.0 mm from where the sheet's ends are"),
        ({"x": -0.008}, "the hands were 8.0 mm from where the sheet's ends are"),
        ({"z": 0.007}, "one hand was 7.0 mm over the other"),
        ({"yaw": math.radians(5)}, "the hands were 5.0 deg misaligned"),
    ],
)
def test_hands_that_do_not_hold_one_sheet(kinematics: InverseKinematics, off: dict[str, float], fault: str) -> None:
    play = Play(kinematics).add(True, False).add(True, True).add(True, True, **off).add(False, True, 0.1)
    assert faults(facts(play.moments)) == [fault]


def test_hands_that_do_something_else(kinematics: InverseKinematics) -> None:
    dropped = Play(kinematics).add(True, False).add(False, False).add(False, True).add(False, True, 0.1)
    assert "the taker's gripper was not shut before the giver's opened" in faults(facts(dropped.moments))
    kept = Play(kinematics).add(True, False).add(True, True).add(True, True, 0.1)
    assert faults(facts(kept.moments))[0] == "the taker's gripper was not shut before the giver's opened"
    stays = Play(kinematics).add(True, False).add(True, True).add(False, True)
    assert faults(facts(stays.moments)) == ["the hands were not drawn back"]
    lost = Play(kinematics).add(True, False).add(True, True).add(False, True).add(False, False, 0.1)
    assert faults(facts(lost.moments)) == ["the taker does not hold the sheet in the end"]


# ---- the two runs ----


@pytest.fixture(scope="module")
def naming(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Servers that run already, on the paper's scene."""
    folder = tmp_path_factory.mktemp("system")
    options = ("--building", str(sample_path(BUILDING)), "--subnets", CHANNEL)
    with claimed_ports() as port, Launcher(folder) as launch:
        running = real_system(launch, folder / "state", port, *options).wait_ready()
        threading.Thread(target=deque, args=(running.process.stderr, 0), daemon=True).start()
        yield str(running.naming)


def run(folder: Path, kind: str, *options: str) -> None:
    """A hand-over in a folder, and what it prints and writes."""
    command = (*module_command("robocorba.clients.hand_over"), str(folder), *options)
    printed: list[str] = []
    with LoggedProcess(folder / "errors", *command, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}) as process:
        while line := process.read_line(LIMIT_S):
            printed.append(line.rstrip("\n"))
        assert (process.wait(LIMIT_S), process.log_tail()) == (0, ""), "\n".join(printed)
    logged = [line.split(ICON, 1)[1] for line in printed if ICON in line]
    order = ["A  say hand_over.ready", "B  gripper left close", "B  say hand_over.gripped", "A  gripper right open"]
    assert [line for line in logged if line in order] == order
    check_joints(folder / f"hand-over-{kind}.csv")
    check_recording(folder / f"hand-over-{kind}.mcap")


@pytest.mark.system
@pytest.mark.timeout(3 * LIMIT_S)
def test_actual_robots_in_servers_that_run(naming: str, tmp_path: Path) -> None:
    run(tmp_path, "actual", "--actual", "--naming", naming)
    check_film(tmp_path / "hand-over-actual.mp4")


@pytest.mark.system
@pytest.mark.timeout(3 * LIMIT_S)
def test_virtual_robots_in_servers_of_their_own(tmp_path: Path) -> None:
    run(tmp_path, "virtual", "--no-film")
    assert not list(tmp_path.glob("*.mp4"))


def check_joints(file: Path) -> None:
    """Once more, from what was written: who had the sheet when, and where the hands were then."""
    with file.open(newline="") as source:
        rows = list(csv.DictReader(source))
    moments = [
        (float(giver["seconds"]), Arm(giver, GIVER, GIVING), Arm(taker, TAKER, TAKING))
        for giver, taker in zip(rows[::2], rows[1::2], strict=True)
    ]
    assert len(moments) > 100
    shut = [(giver.grip > math.radians(5), taker.grip > math.radians(5)) for _, giver, taker in moments]
    changes = [now for before, now in zip([None, *shut], shut, strict=False) if now != before]
    assert changes == [(False, False), (True, False), (True, True), (False, True)]
    for (_, giver, taker), both in zip(moments, shut, strict=True):
        if both == (True, True):
            assert math.dist(giver.hand(), taker.hand()) == pytest.approx(HAND_DISTANCE_M, abs=NEAR_M)
            assert giver.hand()[2] == pytest.approx(taker.hand()[2], abs=NEAR_M)
    _, giver, taker = moments[-1]
    assert math.dist(giver.hand(), taker.hand()) > HAND_DISTANCE_M + 2 * BASE_RETREAT_M


body = functools.cache(SmartPalBody)


class Arm:
    """Of one robot, in a row of the file."""

    def __init__(self, row: dict[str, str], robot: str, side: Side) -> None:
        assert row["robot"] == robot
        self._side = side
        self._at = [float(row[name]) for name in ("x", "y", "heading")]
        self._joints: Floats = np.array([float(row[name]) for name in JOINTS])
        self.grip = self._joints[GRIP[side]]

    def hand(self) -> tuple[float, float, float]:
        """In the building's frame, m."""
        hand, (x, y, heading) = body().hand(self._side, self._joints), self._at
        c, s = math.cos(heading), math.sin(heading)
        return x + c * hand.x - s * hand.y, y + s * hand.x + c * hand.y, hand.z


def check_recording(file: Path) -> None:
    """It opens, is whole, and shows both robots drive from where they begin to behind where they meet."""
    recording = Recording(file)
    assert recording.is_complete and recording.floors == [FLOOR]
    seen: dict[str, list[tuple[float, float]]] = {GIVER: [], TAKER: []}
    for _, views in recording.sampled(0.1):
        view = views[FLOOR]
        for number, body in view.bodies.items():
            if body.name in seen:
                motion = view.motion(number)
                seen[body.name].append((motion["x"], motion["y"]))
    for robot, places in seen.items():
        x, y, heading = MEETING_POSES[robot]
        assert math.dist(places[0], START_POSES[robot][:2]) < 0.02
        end = x - BASE_RETREAT_M * math.cos(heading), y - BASE_RETREAT_M * math.sin(heading)
        assert math.dist(places[-1], end) < 0.03


def check_film(file: Path) -> None:
    """It has ten pictures a second, robots move in it, and the sheet goes from the left to the right."""
    pictures, places = 0, []
    with av.open(str(file)) as container:
        for frame in container.decode(container.streams.video[0]):  # one at a time: all of them take gigabytes
            picture = np.asarray(frame.to_image())
            if not pictures:
                first = picture.astype(float)
            pictures += 1
            sheet = (picture[..., 0] > 180) & (picture[..., 1] < 80) & (picture[..., 2] > 70)
            if sheet.sum() > 300:  # it is seen well
                places.append(np.nonzero(sheet)[1].mean())
    assert pictures > 100
    assert np.abs(picture - first).mean() > 1.0
    assert len(places) > pictures / 2
    assert places[0] < places[len(places) // 2] < places[-1]

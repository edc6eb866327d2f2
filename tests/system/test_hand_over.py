"""The paper's Figure 11: two robots hand over a sheet of paper, virtual and then actual, by the same two programs."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Sequence
from importlib.resources import files
from itertools import groupby
from pathlib import Path

import av
import numpy as np
import pytest

from robocorba.clients import hand_over
from robocorba.clients.hand_over import BASE_RETREAT_M, BUILDING, CHANNEL, GIVER, MEETING_POSES, START_POSES, TAKER
from robocorba.clients.hand_over_facts import GIVING, HAND_DISTANCE_M, TAKING, Moment, facts, faults, is_shut
from robocorba.map_editor.samples import load_sample, sample_path
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.robot.kinematics import tasks
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import GRIP, JOINTS, OPEN_RAD, SHUT_RAD, Side
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.programs.checker import Start, check
from robocorba.simulation.recording import Recording
from robocorba.system.supervision.launch import LoggedProcess, module_command
from testkit.processes import running_system

pytestmark = [pytest.mark.slow(70), pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = Path(str(files("robocorba") / "samples"))
FLOOR = "L1"
#: What is between the time and the icon in the line of an icon that begins.
ICON = " s  "
#: On a loaded machine processes take long to start, s.
LIMIT_S = 380.0


# ---- the programs ----


def test_the_programs_are_sound_and_are_the_samples(tmp_path: Path) -> None:
    assert hand_over.main([str(tmp_path), "--write-programs"]) == 0
    names = {"hand-over-giver.json", "hand-over-taker.json"}
    assert {file.name for file in tmp_path.iterdir()} == names
    for name in names:
        assert (SAMPLES / name).read_text() == (tmp_path / name).read_text()
    planner, inverse = PathPlanner(load_sample(BUILDING)), InverseKinematics()
    for robot, program in hand_over.programs().items():
        x, y, heading = START_POSES[robot]
        assert check(program, inverse, planner, Start(Place(FLOOR, x, y), heading)).findings == ()


# ---- what is checked of a hand-over ----

#: Whose grippers are shut at a moment, the giver's and the taker's, and how far both hands are drawn back, m.
Step = tuple[bool, bool, float]
NOBODY, GIVES, BOTH, TAKES, APART = (
    *((False, False, 0.0), (True, False, 0.0), (True, True, 0.0), (False, True, 0.0)),
    (False, True, 0.1),
)


def play(*steps: Step, **off: float) -> list[Moment]:
    """Moments made up: both robots stand where they meet. off: what is wrong with the taker's hand at the third one: x,
    z, m, or yaw, rad."""
    inverse = InverseKinematics()
    between_m = math.dist(MEETING_POSES[GIVER][:2], MEETING_POSES[TAKER][:2])
    giving, taking = tasks.hand_over(between_m, hand_over.SHEET_HEIGHT_M, hand_over.SHEET_LEFT_M)

    def state(robot: str, side: Side, hand: HandPose, is_shut: bool, offset_m: float = 0.0) -> RobotState:
        joints = inverse.solve({side: hand}, np.zeros(len(JOINTS)))
        joints[GRIP[side]] = SHUT_RAD if is_shut else OPEN_RAD
        x, y, heading = MEETING_POSES[robot]
        return RobotState(0.0, x + offset_m, y, heading, joints=joints)

    moments = []
    for number, (giver_shut, taker_shut, back_m) in enumerate(steps):
        wrong = off if number == 2 else {}
        taker = taking.moved(-back_m)
        taker = taker._replace(z=taker.z + wrong.get("z", 0.0), yaw=wrong.get("yaw", 0.0))
        giver = state(GIVER, GIVING, giving.moved(-back_m), giver_shut)
        moments.append(Moment(0.5 * number, giver, state(TAKER, TAKING, taker, taker_shut, wrong.get("x", 0.0))))
    return moments


def test_a_hand_over_as_it_should_be() -> None:
    seen = facts(play((False, False, 0.1), GIVES, BOTH, BOTH, TAKES, APART))
    assert (seen.gripped_s, seen.released_s, seen.is_taken) == (1.0, 2.0, True)
    assert (seen.distance_error_m, seen.height_error_m, seen.angle_error_rad) == pytest.approx((0, 0, 0), abs=1e-4)
    assert seen.end_distance_m == pytest.approx(HAND_DISTANCE_M + 0.2, abs=1e-4)
    assert faults(seen) == []


@pytest.mark.parametrize(
    ("steps", "off", "fault"),
    [
        ((GIVES, BOTH, BOTH, APART), {"x": 0.008}, "the hands were 8.0 mm from where the sheet's ends are"),
        ((GIVES, BOTH, BOTH, APART), {"x": -0.008}, "the hands were 8.0 mm from where the sheet's ends are"),
        ((GIVES, BOTH, BOTH, APART), {"z": 0.007}, "one hand was 7.0 mm over the other"),
        ((GIVES, BOTH, BOTH, APART), {"yaw": math.radians(5)}, "the hands were 5.0 deg misaligned"),
        ((GIVES, NOBODY, TAKES, APART), {}, "the taker's gripper was not shut before the giver's opened"),
        ((GIVES, BOTH, (True, True, 0.1)), {}, "the taker's gripper was not shut before the giver's opened"),
        ((GIVES, BOTH, TAKES), {}, "the hands were not drawn back"),
        ((GIVES, BOTH, TAKES, (False, False, 0.1)), {}, "the taker does not hold the sheet in the end"),
    ],
)
def test_a_hand_over_as_it_should_not_be(steps: Sequence[Step], off: dict[str, float], fault: str) -> None:
    found = faults(facts(play(*steps, **off)))
    assert found == [fault] if (BOTH in steps and TAKES in steps) or off else fault in found


# ---- a run ----


@pytest.mark.system
@pytest.mark.timeout(3 * LIMIT_S)
def test_actual_robots_in_servers_that_run(tmp_path: Path) -> None:
    """On the paper's scene: what it prints and writes."""
    (tmp_path / "system").mkdir()
    options = ("--building", str(sample_path(BUILDING)), "--subnets", CHANNEL)
    name, printed, environment = tmp_path / "hand-over-actual", list[str](), {**os.environ, "PYTHONPATH": str(ROOT)}
    with running_system(tmp_path / "system", *options) as (system, _):
        arguments = (str(tmp_path), "--actual", "--naming", str(system.naming))
        command = module_command("robocorba.clients.hand_over", *arguments)
        with LoggedProcess(tmp_path / "errors", *command, cwd=tmp_path, env=environment) as process:
            while line := process.read_line(LIMIT_S):
                printed.append(line.rstrip("\n"))
            assert (process.wait(LIMIT_S), process.log_tail()) == (0, ""), "\n".join(printed)
    logged = [line.split(ICON, 1)[1] for line in printed if ICON in line]
    order = ["A  say hand_over.ready", "B  gripper left close", "B  say hand_over.gripped", "A  gripper right open"]
    assert [line for line in logged if line in order] == order
    check_joints(name.with_suffix(".csv"))
    recording = Recording(name.with_suffix(".mcap"))
    assert recording.is_complete and recording.floors == [FLOOR]
    bodies = {body.name for _, views in recording.sampled(1.0) for body in views[FLOOR].bodies.values()}
    assert {GIVER, TAKER} <= bodies
    check_film(name.with_suffix(".mp4"))


def check_joints(file: Path) -> None:
    """Once more, from what was written: who had the sheet when, and where the hands were then."""
    with file.open(newline="") as source:
        rows = list(csv.DictReader(source))

    def state(row: dict[str, str], robot: str) -> RobotState:
        assert row["robot"] == robot
        x, y, heading = (float(row[name]) for name in ("x", "y", "heading"))
        return RobotState(0.0, x, y, heading, joints=np.array([float(row[name]) for name in JOINTS]))

    moments = [
        Moment(float(giver["seconds"]), state(giver, GIVER), state(taker, TAKER))
        for giver, taker in zip(rows[::2], rows[1::2], strict=True)
    ]
    assert len(moments) > 100
    shut = [(is_shut(moment.giver, GIVING), is_shut(moment.taker, TAKING)) for moment in moments]
    assert [each for each, _ in groupby(shut)] == [(False, False), (True, False), (True, True), (False, True)]
    found = facts(moments)
    assert faults(found) == []
    assert found.end_distance_m > HAND_DISTANCE_M + 2 * BASE_RETREAT_M


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

"""The checker: its findings about arms and base, and its notes on what it can't check."""

from __future__ import annotations

import math
from collections.abc import Callable
from unittest.mock import MagicMock

import numpy as np
import pytest

from robocorba.errors.paths import NoPath
from robocorba.errors.robots import InvalidProgram
from robocorba.map_editor.samples import load_sample
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.programs.checker import MAX_ICONS_CHECKED, Start, check
from robocorba.robot.programs.hands import home
from robocorba.robot.programs.icons import (
    Branch,
    CloserThan,
    Destination,
    FartherThan,
    Gripper,
    HandOver,
    Holding,
    Icon,
    Lumbar,
    MbaseBy,
    MbasePath,
    MbaseTo,
    MbaseVelocity,
    MhandJoints,
    MhandOffset,
    MhandPose,
    MhandPosture,
    MoveTable,
    Repeat,
    Result,
    Say,
    StopIfCloser,
    Wait,
    WaitUntil,
)
from robocorba.robot.programs.program import Program, checked
from robocorba.robot.programs.report import CheckReport

Checking = Callable[..., CheckReport]
LOBBY = Start(Place("L1", 17.0, 4.0), 0.0)
#: Their straight way from home leads an arm into the body, though both ends are clear.
THROUGH_THE_BODY = (-0.76, -0.24, 2.0, 1.32, -0.76, -0.08, 0.18)
INTO_THE_BODY = (0.43, -0.86, 1.63, 2.11, -0.6, 0.32, -0.73)
ASIDE = (0.0, -0.9, 0.0, 0.0, 0.0, 0.0, 0.0)

READY, LEFT_READY, CARRY = MhandPosture("both", "ready"), MhandPosture("left", "ready"), MhandPosture("left", "carry")
UP = MhandOffset("left", dz=0.02)
BACK, TURN = MbaseTo(17.0, 4.0), MbaseBy(turn=0.5)
GUARDED = StopIfCloser("laser", 0.3, (MbasePath("L1", 17.0, 2.5, heading=0.0),))
UPSTAIRS, AFTERWARDS = MbasePath("L3", 21.25, 5), MbaseTo(21.25, 4)
THREE = ["icons[0]", "icons[1]", "icons[2]"]
TWICE_GUARDED = StopIfCloser("laser", 0.3, (StopIfCloser("left", 0.3, GUARDED.icons),))


@pytest.fixture(scope="module")
def kinematics() -> InverseKinematics:
    return InverseKinematics()


@pytest.fixture(scope="module")
def planner() -> PathPlanner:
    return PathPlanner(load_sample("five-floors"))


def program(*icons: Icon) -> Program:
    return checked(Program(name="a", icons=icons))


@pytest.fixture
def checking(kinematics: InverseKinematics, planner: PathPlanner) -> Checking:
    return lambda *icons, start=LOBBY: check(program(*icons), kinematics, planner, start)


def wrong(report: CheckReport) -> list[tuple[str, str]]:
    return [(finding.icon, finding.parameter) for finding in report.findings]


def notes(report: CheckReport) -> list[str]:
    return [note.icon for note in report.notes if note.icon]


@pytest.mark.parametrize(
    ("icons", "parameter", "what"),
    [
        ((MhandPose("left", 1.4, 0.2, 1.0),), "x, y, z", "the left hand"),
        ((MhandPose("both", 0.4, 1.9, 1.0),), "x, y, z", "hand"),
        ((MhandOffset("right", dx=1.0),), "dx, dy, dz", "the right hand"),
        ((MhandPosture("left", "wave"),), "posture", "unknown posture 'wave'; known are home"),
        ((MhandJoints("left", INTO_THE_BODY),), "joints", "collides with"),
        ((MhandJoints("left", THROUGH_THE_BODY),), "joints", "during the motion"),
        ((MhandPosture("both", "reach"), Lumbar(0.0, 2.0)), "lower, upper", "collides with"),
        ((MhandPose("left", 0.4, 0.2, 1.0, roll=0.0),), "pitch", "is missing"),
        ((Gripper("left", "open", force=5),), "force", "only valid with the action close"),
        ((Gripper("left", "open", object="cup"),), "object", "only valid with the action close"),
        ((MbasePath("L9", 1, 1),), "floor", "there is no floor 'L9'"),
        ((MbasePath("L3", 8, 0.1),), "x, y", "is not free"),
        ((MbasePath("L1", 1e5, 12),), "x, y", "outside"),
        ((MbaseTo(4, 4),), "x, y", "straight line"),
        ((MbaseTo(14, 12.2),), "x, y", "straight line"),
        ((MbaseBy(ahead=900),), "ahead, left", "outside"),
        ((MbaseBy(left=900),), "ahead, left", "outside"),
        ((MbaseVelocity(0.9, 0.9, 0, 1),), "ahead, left", "above the limit of 1 m/s"),
        ((WaitUntil(CloserThan("front", 1.5), 1),), "condition.distance", "beyond the range of front, 1 m"),
        ((WaitUntil(FartherThan("proximity", 2), 1),), "condition.distance", "the range of proximity"),
        ((StopIfCloser("left", 1.5, (Wait(1),)),), "distance", "the range of left"),
    ],
)
def test_a_robot_that_can_not(icons: tuple[Icon, ...], parameter: str, what: str, checking: Checking) -> None:
    report = checking(Branch(Holding("left"), (Wait(1), *icons)))
    assert wrong(report) == [(f"icons[0].then[{len(icons)}]", parameter)]
    assert what in report.findings[0].reason
    with pytest.raises(InvalidProgram) as refused:
        report.require_valid()
    assert (refused.value.icon, refused.value.parameter) == (f"icons[0].then[{len(icons)}]", parameter)


@pytest.mark.parametrize(
    ("icons", "unknown"),
    [
        (
            (
                *(READY, MhandPose("left", 0.45, 0.2, 0.9), READY, MhandPose("both", 0.42, 0.2, 0.88, 0.0, 0.0, 0.0)),
                *(MhandOffset("both", dx=0.03), Gripper("both", "close", force=5), Lumbar(0.0, 0.1)),
            ),
            [],
        ),
        # A way is judged from where the program has brought the arm.
        (tuple(MhandJoints("left", to) for to in (ASIDE, (0.0, -0.9, *THROUGH_THE_BODY[2:]), THROUGH_THE_BODY)), []),
        # After a branch only what both ways agree on is known: the posture makes it known again.
        ((Branch(Holding("left"), (CARRY,), (LEFT_READY,)), UP, LEFT_READY, UP), ["icons[1]", "icons[2]"]),
        ((Branch(Holding("left"), (LEFT_READY,), (LEFT_READY, Say("empty"))), UP), []),
        # A repeat that goes on is followed twice; the arm would be too short the third time.
        ((READY, Repeat(100, (MhandOffset("left", dx=0.06),)), UP), ["icons[1]", "icons[2]"]),
        ((READY, Repeat(100, (CARRY, LEFT_READY)), UP), []),
        (
            (
                *(MbasePath("L3", 21.25, 5.0, heading=-1.57), MbaseTo(21.25, 4.0), MbaseBy(ahead=0.3, left=0.2)),
                MbasePath("L1", 17.0, 4.0),
            ),
            [],
        ),
        # Nobody knows where a drive begins; one along a path ends where it says.
        ((MbaseVelocity(0.1, 0, 0, 1), BACK, UPSTAIRS, AFTERWARDS), ["icons[1]", "icons[2]"]),
        ((MoveTable("table", Destination("L1", 20, 4)), BACK, UPSTAIRS, AFTERWARDS), THREE),
        ((HandOver("sheet", "B"), BACK, UPSTAIRS, AFTERWARDS), THREE),
        # A relative drive needs a heading.
        ((MbasePath("L1", 17, 4), MbaseBy(ahead=0.5)), ["icons[1]"]),
        ((MbasePath("L1", 17, 4), TURN, MbaseTo(17, 3)), []),
        # Turned about, ahead is where it came from.
        ((MbaseBy(turn=math.pi), MbaseBy(ahead=4)), []),
        # What a sensor may have stopped is unknown unless its result is asked for.
        ((GUARDED, Branch(Result("stopped"), (BACK,))), ["icons[1].then[0]"]),
        ((GUARDED, Branch(Result("done"), (BACK,))), []),
        ((GUARDED, Branch(Result("timed_out"), (BACK,), (BACK,))), ["icons[1].then[0]", "icons[1].otherwise[0]"]),
        # A result is of the icon just before, and of no other: an outer one, a repeat, a wait.
        ((TWICE_GUARDED, Branch(Result("done"), (BACK,))), ["icons[1].then[0]"]),
        ((Repeat(2, (GUARDED,)), Branch(Result("done"), (BACK,))), ["icons[0].icons[0].icons[0]", "icons[1].then[0]"]),
        ((GUARDED, Wait(1), Branch(Result("done"), (BACK,))), ["icons[2].then[0]"]),
        # What a branch leaves as it was stays known.
        ((Branch(Holding("left"), (Say("holding"),)), MbaseTo(17, 3)), []),
    ],
)
def test_what_is_known_of_arms_and_base(icons: tuple[Icon, ...], unknown: list[str], checking: Checking) -> None:
    report = checking(*icons)
    assert (wrong(report), notes(report)) == ([], unknown)


def test_a_hand_is_judged_from_the_joints_that_the_robot_has_and_leaves_them(checking: Checking) -> None:
    joints = home()
    joints[:7] = THROUGH_THE_BODY
    before = joints.copy()
    assert checking(MhandJoints("left", THROUGH_THE_BODY), start=Start(joints=joints)).is_valid
    assert checking(READY, start=Start(joints=home())).is_valid
    assert np.array_equal(joints, before)


@pytest.mark.parametrize("joints", [np.zeros(0), np.zeros(7), np.full(18, np.nan)])
def test_a_robot_without_such_arms_has_a_finding(joints: Floats, checking: Checking) -> None:
    for icon in (READY, MhandOffset("left", dx=0.01), Lumbar(0.0, 0.1), Gripper("left", "open")):
        ((path, _),) = wrong(checking(icon, start=Start(joints=joints)))
        assert path == "icons[0]"
    assert checking(Wait(1.0), start=Start(joints=joints)).is_valid


def test_a_check_without_a_robot_model_notes_it_and_one_of_deep_repeats_ends_soon() -> None:
    report = check(program(MhandPose("left", 2.0, 2.0, 2.0)))
    assert report.is_valid
    assert any("no robot model" in note.what for note in report.notes)
    icons: tuple[Icon, ...] = ()
    for _ in range(7):
        icons = (Repeat(1000, (MbaseBy(ahead=0.1), *icons, *[MbaseBy(turn=0.1)] * 120)),)
    report = check(program(*icons), start=LOBBY)
    assert any(str(MAX_ICONS_CHECKED) in note.what for note in report.notes)


def test_what_fails_in_the_second_round_and_a_start_that_is_not_free_are_found(checking: Checking) -> None:
    report = checking(READY, Repeat(2, (MhandOffset("left", dx=0.15),)))
    assert wrong(report) == [("icons[1].icons[0]", "dx, dy, dz")]
    report = checking(MbasePath("L3", 21.25, 5.0), start=Start(Place("L1", 0.1, 4.0)))
    assert wrong(report) == [("icons[0]", "")]
    assert "start L1" in report.findings[0].reason


def moved_to(x: float, y: float, size_m: float = 1.2, name: str = "table 1") -> Start:
    """The robot in the lobby, and all movable objects of L1: one box at (x, y) [m]."""
    half = size_m / 2
    corners = ((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half))
    return LOBBY._replace(obstacles=TemporaryObstacles((("L1", corners),), ("L1",), (name,)))


def test_an_object_is_named_where_it_stands_now(checking: Checking) -> None:
    (inside,) = checking(MbasePath("L1", 17, 2), start=moved_to(17, 2)).findings
    assert inside.reason.startswith("goal L1:17,2 is not free: 0.000 m to table 1, which stands there now")
    (beside,) = checking(MbasePath("L1", 17, 2), start=moved_to(17.8, 2)).findings
    assert "0.200 m to table 1, which" in beside.reason
    (closed,) = checking(MbasePath("L1", 6.5, 4.6), start=moved_to(6.5, 8)).findings  # the door of room 101
    assert (closed.icon, closed.parameter) == ("icons[0]", "x, y")
    assert "object 'table 1' on L1: stands in the way now" in closed.reason
    (straight,) = checking(MbaseTo(17, 1.2), start=moved_to(17, 2.4, 0.6)).findings
    assert straight.reason.endswith("is blocked by table 1")
    place_of_table_2 = MbasePath("L1", 29.6, 2.2)
    (on_map,) = checking(place_of_table_2).findings
    assert "object cafe-table-2," in on_map.reason and "now" not in on_map.reason
    assert checking(place_of_table_2, start=moved_to(33, 5.5, name="cafe-table-2")).is_valid


def test_a_robot_at_a_target_is_noted(checking: Checking) -> None:
    (disc,) = moved_to(17, 2).obstacles.forbidden_areas
    start = LOBBY._replace(robots=TemporaryObstacles((disc,), (), ("R2",)))
    report = checking(MbasePath("L1", 17.5, 2.5), MbaseTo(17, 1.2), BACK, start=start)
    assert report.is_valid
    there = "robot R2 stands at its target now"
    assert [(note.icon, note.what) for note in report.notes if note.icon] == [("icons[0]", there), ("icons[1]", there)]


def test_what_the_program_itself_moves_or_the_robot_touches_blocks_no_drive(checking: Checking) -> None:
    carry, drive = MoveTable("table 1", Destination("L1", 20, 4)), MbasePath("L1", 17, 2)
    assert checking(carry, drive, start=moved_to(17, 2)).is_valid
    assert checking(Gripper("left", "close"), drive, start=moved_to(17, 2)).is_valid
    assert wrong(checking(carry, drive, start=moved_to(17, 2, name="other"))) == [("icons[1]", "x, y")]
    assert checking(MbasePath("L1", 17, 6), start=moved_to(17, 4 - 0.6 - 0.395)).is_valid
    assert wrong(checking(MbasePath("L1", 17, 6), start=moved_to(17, 3.2))) == [("icons[0]", "")]


def test_a_planner_that_finds_no_way() -> None:
    planner = MagicMock()
    planner.paths.side_effect = NoPath("nothing leads there")
    report = check(program(MbasePath("L1", 1, 1), MbasePath("L1", 2, 2)), None, planner, LOBBY)
    assert wrong(report) == [("icons[0]", "x, y"), ("icons[1]", "x, y")]
    with pytest.raises(InvalidProgram, match=r"icons\[0\].x, y: nothing leads there"):
        report.require_valid()

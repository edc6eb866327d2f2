"""The checker: its findings about arms and base, and its notes on what it can't check."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.paths import NoPath
from robocorba.errors.robots import InvalidProgram
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.maps.samples import load_sample
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathRequest, Place
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.programs.checker import MAX_ICONS_CHECKED, UNKNOWN_START, Start, check
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.hands import home
from robocorba.programs.icons import CloserThan, Destination, FartherThan, Holding, Result
from robocorba.programs.report import CheckReport
from robocorba.spatial.arrays import Floats

Build = Callable[[ProgramBuilder], object]
LOBBY = Start(Place("L1", 17.0, 4.0), 0.0)
#: Their straight way from home leads an arm into the body, though both ends are clear.
THROUGH_THE_BODY = (-0.76, -0.24, 2.0, 1.32, -0.76, -0.08, 0.18)
INTO_THE_BODY = (0.43, -0.86, 1.63, 2.11, -0.6, 0.32, -0.73)


@pytest.fixture(scope="module")
def kinematics() -> InverseKinematics:
    return InverseKinematics()


@pytest.fixture(scope="module")
def planner() -> PathPlanner:
    return PathPlanner(load_sample("five-floors"))


def built(build: Build) -> ProgramBuilder:
    builder = ProgramBuilder("a")
    build(builder)
    return builder


def wrong(report: CheckReport) -> list[tuple[str, str]]:
    return [(finding.icon, finding.parameter) for finding in report.findings]


def notes(report: CheckReport) -> list[str]:
    return [note.icon for note in report.notes if note.icon]


# ---- arms ----


@pytest.fixture
def arms(kinematics: InverseKinematics) -> Callable[[Build], CheckReport]:
    return lambda build: check(built(build).program(), kinematics)


def test_a_hand_gets_where_it_can(arms: Callable[[Build], CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        a.mhand_posture("both", "ready").mhand_pose("left", 0.45, 0.2, 0.9).mhand_posture("both", "ready")
        a.mhand_pose("both", 0.42, 0.2, 0.88, 0.0, 0.0, 0.0).mhand_offset("both", dx=0.03)
        a.gripper("both", "close", force=5).lumbar(0.0, 0.1)

    report = arms(build)
    assert report.is_valid
    assert notes(report) == []


@pytest.mark.parametrize(
    ("build", "parameter", "what"),
    [
        (lambda a: a.mhand_pose("left", 1.4, 0.2, 1.0), "x, y, z", "the left hand"),
        (lambda a: a.mhand_pose("both", 0.4, 1.9, 1.0), "x, y, z", "hand"),
        (lambda a: a.mhand_offset("right", dx=1.0), "dx, dy, dz", "the right hand"),
        (lambda a: a.mhand_posture("left", "wave"), "posture", "unknown posture 'wave'; known are home"),
        (lambda a: a.mhand_joints("left", INTO_THE_BODY), "joints", "collides with"),
        (lambda a: a.mhand_joints("left", THROUGH_THE_BODY), "joints", "during the motion"),
        (lambda a: a.mhand_posture("both", "reach").lumbar(0.0, 2.0), "lower, upper", "collides with"),
        (lambda a: a.mhand_pose("left", 0.4, 0.2, 1.0, roll=0.0), "pitch", "is missing"),
        (lambda a: a.gripper("left", "open", force=5), "force", "only valid with the action close"),
        (lambda a: a.gripper("left", "open", object="cup"), "object", "only valid with the action close"),
    ],
)
def test_a_hand_that_can_not(build: Build, parameter: str, what: str, arms: Callable[[Build], CheckReport]) -> None:
    report = arms(build)
    last = len(built(build).program().icons) - 1
    assert wrong(report) == [(f"icons[{last}]", parameter)]
    assert what in report.findings[0].reason


def test_a_way_is_judged_from_where_the_program_has_brought_the_arm(arms: Callable[[Build], CheckReport]) -> None:
    assert not arms(lambda a: a.mhand_joints("left", THROUGH_THE_BODY)).is_valid
    safely = [0.0, -0.9, *THROUGH_THE_BODY[2:]]
    assert arms(
        lambda a: (
            a.mhand_joints("left", [0.0, -0.9, 0, 0, 0, 0, 0])
            .mhand_joints("left", safely)
            .mhand_joints("left", THROUGH_THE_BODY)
        )
    ).is_valid


def test_a_hand_is_judged_from_the_joints_that_the_robot_has(kinematics: InverseKinematics) -> None:
    joints = home()
    joints[:7] = THROUGH_THE_BODY
    program = built(lambda a: a.mhand_joints("left", THROUGH_THE_BODY)).program()
    assert check(program, kinematics, start=Start(joints=joints)).is_valid
    assert not check(program, kinematics).is_valid


@pytest.mark.parametrize("joints", [np.zeros(0), np.zeros(7), np.full(18, np.nan)])
@pytest.mark.parametrize(
    "build",
    [
        lambda a: a.mhand_posture("both", "ready"),
        lambda a: a.mhand_offset("left", dx=0.01),
        lambda a: a.lumbar(0.0, 0.1),
        lambda a: a.gripper("left", "open"),
    ],
)
def test_a_robot_without_such_arms_has_a_finding(build: Build, joints: Floats, kinematics: InverseKinematics) -> None:
    report = check(built(build).program(), kinematics, start=Start(joints=joints))
    ((icon, _),) = wrong(report)
    assert icon == "icons[0]"
    assert check(built(lambda a: a.wait(1.0)).program(), kinematics, start=Start(joints=joints)).is_valid


def test_after_a_branch_only_what_both_ways_agree_on_is_known(arms: Callable[[Build], CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        with a.branch(Holding("left")):
            a.mhand_posture("left", "carry")
        with a.otherwise():
            a.mhand_posture("left", "ready")
        a.mhand_offset("left", dz=0.02)  # icons[1]: nobody knows from where
        a.mhand_posture("left", "ready")  # icons[2]: nor its way
        a.mhand_offset("left", dz=0.02)  # icons[3]: known again

    report = arms(build)
    assert report.is_valid
    assert notes(report) == ["icons[1]", "icons[2]"]

    def agreeing(a: ProgramBuilder) -> None:
        with a.branch(Holding("left")):
            a.mhand_posture("left", "ready")
        with a.otherwise():
            a.mhand_posture("left", "ready").say("empty")
        a.mhand_offset("left", dz=0.02)

    assert notes(arms(agreeing)) == []


def test_a_repeat_that_goes_on_is_followed_twice(arms: Callable[[Build], CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        a.mhand_posture("both", "ready")
        with a.repeat(100):
            a.mhand_offset("left", dx=0.06)  # the arm would be too short the third time
        a.mhand_offset("left", dx=-0.01)

    report = arms(build)
    assert report.is_valid
    assert notes(report) == ["icons[1]", "icons[2]"]

    def far(a: ProgramBuilder) -> None:
        a.mhand_posture("both", "ready")
        with a.repeat(2):
            a.mhand_offset("left", dx=0.15)

    assert wrong(arms(far)) == [("icons[1].icons[0]", "dx, dy, dz")]

    def back_and_forth(a: ProgramBuilder) -> None:
        a.mhand_posture("both", "ready")
        with a.repeat(100):
            a.mhand_posture("left", "carry").mhand_posture("left", "ready")
        a.mhand_offset("left", dz=0.02)

    assert notes(arms(back_and_forth)) == []


def test_without_a_robot_model_the_arms_are_not_checked() -> None:
    report = check(built(lambda a: a.mhand_pose("left", 2, 2, 2)).program())
    assert report.is_valid
    assert any("no robot model" in note.what for note in report.notes)


def test_a_check_ends_soon_also_where_repeats_are_deep(arms: Callable[[Build], CheckReport]) -> None:
    def deep(a: ProgramBuilder, levels: int) -> None:
        with a.repeat(1000):
            a.mbase_by(ahead=0.1)
            if levels:
                deep(a, levels - 1)
            for _ in range(120):
                a.mbase_by(turn=0.1)

    report = check(built(lambda a: deep(a, 6)).program(), start=LOBBY)
    assert any(str(MAX_ICONS_CHECKED) in note.what for note in report.notes)


# ---- the base ----


@pytest.fixture
def base(planner: PathPlanner) -> Callable[..., CheckReport]:
    return lambda build, start=LOBBY: check(built(build).program(), None, planner, start)


def test_a_base_gets_where_it_can(base: Callable[..., CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        a.mbase_path("L3", 21.25, 5.0, heading=-1.57).mbase_to(21.25, 4.0).mbase_by(ahead=0.3, left=0.2)
        a.mbase_path("L1", 17.0, 4.0)

    report = base(build)
    assert report.is_valid
    assert notes(report) == []


@pytest.mark.parametrize(
    ("build", "parameter", "what"),
    [
        (lambda a: a.mbase_path("L9", 1, 1), "floor", "there is no floor 'L9'"),
        (lambda a: a.mbase_path("L3", 8, 0.1), "x, y", "is not free"),
        (lambda a: a.mbase_path("L1", 1e5, 12), "x, y", "outside"),
        (lambda a: a.mbase_to(4, 4), "x, y", "straight line"),
        (lambda a: a.mbase_to(14, 12.2), "x, y", "straight line"),
        (lambda a: a.mbase_by(ahead=900), "ahead, left", "outside"),
        (lambda a: a.mbase_by(left=900), "ahead, left", "outside"),
        (lambda a: a.mbase_velocity(0.9, 0.9, 0, 1), "ahead, left", "above the limit of 1 m/s"),
        (lambda a: a.wait_until(CloserThan("front", 1.5), 1), "condition.distance", "beyond the range of front, 1 m"),
        (
            lambda a: a.wait_until(FartherThan("proximity", 2), 1),
            "condition.distance",
            "the range of proximity",
        ),
    ],
)
def test_a_base_that_can_not(build: Build, parameter: str, what: str, base: Callable[..., CheckReport]) -> None:
    report = base(lambda a: build(a.wait(1)))
    assert wrong(report) == [("icons[1]", parameter)]
    assert what in report.findings[0].reason


def test_a_sensor_stop_beyond_the_sensor_is_found(base: Callable[..., CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        with a.stop_if_closer("left", 1.5):
            a.wait(1)

    assert wrong(base(build)) == [("icons[0]", "distance")]


def test_a_start_that_is_not_free_is_found_by_the_icon_that_leaves_it(base: Callable[..., CheckReport]) -> None:
    report = base(lambda a: a.mbase_path("L3", 21.25, 5.0), Start(Place("L1", 0.1, 4.0)))
    assert wrong(report) == [("icons[0]", "")]
    assert "start L1" in report.findings[0].reason


def test_where_nobody_knows_where_a_drive_begins_it_says_so(base: Callable[..., CheckReport]) -> None:
    for lose in (
        lambda a: a.mbase_velocity(0.1, 0, 0, 1),
        lambda a: a.move_table("table", Destination("L1", 20, 4)),
        lambda a: a.hand_over("sheet", "B"),
    ):
        report = base(lambda a, lose=lose: lose(a).mbase_to(17, 4).mbase_path("L3", 21.25, 5).mbase_to(21.25, 4))
        assert report.is_valid
        assert {"icons[1]", "icons[2]"} <= set(notes(report))
        assert "icons[3]" not in notes(report)
    report = base(lambda a: a.mbase_to(17, 4).mbase_path("L3", 8, 0.1).mbase_by(ahead=1), UNKNOWN_START)
    assert wrong(report) == [("icons[1]", "x, y")]
    assert notes(report) == ["icons[0]", "icons[1]", "icons[2]"]


def test_a_relative_drive_needs_a_heading(base: Callable[..., CheckReport]) -> None:
    assert notes(base(lambda a: a.mbase_path("L1", 17, 4).mbase_by(ahead=0.5))) == ["icons[1]"]
    assert notes(base(lambda a: a.mbase_path("L1", 17, 4).mbase_by(turn=0.5).mbase_to(17, 3))) == []
    # Turned about, ahead is where it came from.
    assert base(lambda a: a.mbase_by(turn=math.pi).mbase_by(ahead=4)).is_valid
    assert not base(lambda a: a.mbase_by(turn=math.pi / 2).mbase_by(ahead=14)).is_valid


def guarded(a: ProgramBuilder, condition: Result) -> None:
    with a.stop_if_closer("laser", 0.3):
        a.mbase_path("L1", 17.0, 2.5, heading=0.0)
    with a.branch(condition):
        a.mbase_to(17.0, 4.0)


def test_what_a_sensor_may_have_stopped_is_unknown_unless_its_result_is_asked(base: Callable[..., CheckReport]) -> None:
    stopped = base(lambda a: guarded(a, Result("stopped")))
    assert notes(stopped) == ["icons[1].then[0]"]
    done = base(lambda a: guarded(a, Result("done")))
    assert notes(done) == []
    assert stopped.is_valid and done.is_valid

    def not_timed_out(a: ProgramBuilder) -> None:
        guarded(a, Result("timed_out"))
        with a.otherwise():  # done or stopped
            a.mbase_to(17.0, 4.0)

    assert notes(base(not_timed_out)) == ["icons[1].then[0]", "icons[1].otherwise[0]"]


def test_a_result_tells_of_the_icon_just_before_and_of_no_other(base: Callable[..., CheckReport]) -> None:
    def inside(a: ProgramBuilder) -> None:
        with a.stop_if_closer("laser", 0.3), a.stop_if_closer("left", 0.3):
            a.mbase_path("L1", 17.0, 2.5, heading=0.0)
        with a.branch(Result("done")):  # of the outer one; the inner one may have stopped
            a.mbase_to(17.0, 4.0)

    def repeated(a: ProgramBuilder) -> None:
        with a.repeat(2), a.stop_if_closer("laser", 0.3):
            a.mbase_path("L1", 17.0, 2.5, heading=0.0)
        with a.branch(Result("done")):  # of the repeat
            a.mbase_to(17.0, 4.0)

    def later(a: ProgramBuilder) -> None:
        guarded(a, Result("timed_out"))
        a.wait(1)
        with a.branch(Result("done")):  # of the wait
            a.mbase_to(17.0, 4.0)

    for build, last in ((inside, 1), (repeated, 1), (later, 3)):
        assert f"icons[{last}].then[0]" in notes(base(build))


def test_what_a_branch_leaves_as_it_was_stays_known(base: Callable[..., CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        with a.branch(Holding("left")):
            a.say("holding")
        a.mbase_to(17, 3)

    assert notes(base(build)) == []


def moved_to(x: float, y: float, size_m: float = 1.2, name: str = "table 1") -> Start:
    """The robot in the lobby, and all movable objects of L1: one box at (x, y) [m]."""
    half = size_m / 2
    corners = ((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half))
    return LOBBY._replace(obstacles=TemporaryObstacles((("L1", corners),), ("L1",), (name,)))


def test_an_object_is_named_where_it_stands_now(base: Callable[..., CheckReport]) -> None:
    (inside,) = base(lambda a: a.mbase_path("L1", 17, 2), moved_to(17, 2)).findings
    assert inside.reason.startswith("goal L1:17,2 is not free: 0.000 m to table 1, which stands there now")
    (beside,) = base(lambda a: a.mbase_path("L1", 17, 2), moved_to(17.8, 2)).findings
    assert "0.200 m to table 1, which" in beside.reason
    (closed,) = base(lambda a: a.mbase_path("L1", 6.5, 4.6), moved_to(6.5, 8)).findings  # the door of room 101
    assert (closed.icon, closed.parameter) == ("icons[0]", "x, y")
    assert "object 'table 1' on L1: stands in the way now" in closed.reason
    (straight,) = base(lambda a: a.mbase_to(17, 1.2), moved_to(17, 2.4, 0.6)).findings
    assert straight.reason.endswith("is blocked by table 1")


def test_a_robot_at_a_target_is_noted(base: Callable[..., CheckReport]) -> None:
    (disc,) = moved_to(17, 2).obstacles.forbidden_areas
    start = LOBBY._replace(robots=TemporaryObstacles((disc,), (), ("R2",)))
    report = base(lambda a: a.mbase_path("L1", 17.5, 2.5).mbase_to(17, 1.2).mbase_to(17, 4), start)
    assert report.is_valid
    assert [(note.icon, note.what) for note in report.notes if note.icon] == [
        ("icons[0]", "robot R2 stands at its target now"),
        ("icons[1]", "robot R2 stands at its target now"),
    ]


def test_an_object_that_was_moved_is_no_more_where_the_map_has_it(base: Callable[..., CheckReport]) -> None:
    def build(a: ProgramBuilder) -> None:
        a.mbase_path("L1", 29.6, 2.2)  # the place of cafe-table-2

    (on_map,) = base(build).findings
    assert "object cafe-table-2," in on_map.reason and "now" not in on_map.reason
    assert base(build, moved_to(33, 5.5, name="cafe-table-2")).is_valid


def test_what_the_program_itself_moves_blocks_no_later_drive(base: Callable[..., CheckReport]) -> None:
    def carried(a: ProgramBuilder) -> None:
        a.move_table("table 1", Destination("L1", 20, 4)).mbase_path("L1", 17, 2)

    def gripped(a: ProgramBuilder) -> None:
        a.gripper("left", "close").mbase_path("L1", 17, 2)

    assert base(carried, moved_to(17, 2)).is_valid
    assert base(gripped, moved_to(17, 2)).is_valid
    assert wrong(base(carried, moved_to(17, 2, name="other"))) == [("icons[1]", "x, y")]


def test_a_robot_that_touches_an_object_may_leave_it(base: Callable[..., CheckReport]) -> None:
    assert base(lambda a: a.mbase_path("L1", 17, 6), moved_to(17, 4 - 0.6 - 0.395)).is_valid
    assert wrong(base(lambda a: a.mbase_path("L1", 17, 6), moved_to(17, 3.2))) == [("icons[0]", "")]


class _NoWay:
    def paths(self, request: PathRequest) -> list[Path]:
        raise NoPath("nothing leads there")


def test_a_planner_that_finds_no_way() -> None:
    program = built(lambda a: a.mbase_path("L1", 1, 1).mbase_path("L1", 2, 2)).program()
    assert wrong(check(program, None, _NoWay(), LOBBY)) == [("icons[0]", "x, y"), ("icons[1]", "x, y")]
    with pytest.raises(InvalidProgram, match=r"icons\[0\].x, y: nothing leads there"):
        check(program, None, _NoWay(), LOBBY).require_valid()


# ---- any program ----


class Fault(NamedTuple):
    build: Build
    parameter: str


REACH = st.floats(1.3, 2.0)
SIDES = ("left", "right", "both")
FAULTS = st.one_of(
    st.builds(lambda x: Fault(lambda a: a.mhand_pose("left", x, 0.2, 1.0), "x, y, z"), REACH),
    st.builds(lambda y: Fault(lambda a: a.mhand_pose("right", 0.2, -y, 1.0, 0, 0, 0), "x, y, z"), REACH),
    st.builds(lambda z: Fault(lambda a: a.mhand_pose("both", 0.2, 0.3, -z), "x, y, z"), REACH),
    st.builds(lambda dz: Fault(lambda a: a.mhand_offset("both", dz=dz), "dx, dy, dz"), REACH),
    st.builds(lambda name: Fault(lambda a: a.mhand_posture("both", name), "posture"), st.text("xyz", min_size=1)),
    st.builds(lambda side: Fault(lambda a: a.mhand_joints(side, INTO_THE_BODY), "joints"), st.sampled_from(SIDES)),
    st.builds(lambda y: Fault(lambda a: a.mbase_path("L2", 5.0, y), "x, y"), st.floats(-0.3, 0.3)),
    st.builds(lambda x: Fault(lambda a: a.mbase_path("L2", x, 3.0), "x, y"), st.floats(50, 1e5)),
    st.builds(lambda name: Fault(lambda a: a.mbase_path(name, 5.0, 4.0), "floor"), st.text("xyz", min_size=1)),
    st.builds(lambda v: Fault(lambda a: a.mbase_velocity(v, -v, 0.0, 1.0), "ahead, left"), st.floats(0.72, 1.0)),
    st.builds(lambda d: Fault(lambda a: a.wait_until(CloserThan("back", d), 1.0), "condition.distance"), REACH),
)
#: Leave the arms in the home posture or near it, and the base somewhere free.
HARMLESS = st.sampled_from(
    [
        lambda a: a.wait(1.0),
        lambda a: a.say("here", {"x": 1}),
        lambda a: a.mhand_posture("both", "home"),
        lambda a: a.gripper("left", "open"),
        lambda a: a.mbase_path("L1", 17.0, 4.0, heading=0.0),
        lambda a: a.mbase_path("L3", 21.25, 5.0, heading=0.0),
        lambda a: a.mbase_by(turn=0.3),
    ]
)
BLOCKS = {
    "then": lambda a: a.branch(Holding("left")),
    "icons": lambda a: a.repeat(2),
}


@settings(deadline=None, max_examples=100, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_malformed_programs_that_only_a_check_can_tell(
    kinematics: InverseKinematics, planner: PathPlanner, data: st.DataObject
) -> None:
    builder, path = ProgramBuilder("a"), ""
    blocks = data.draw(st.lists(st.sampled_from(sorted(BLOCKS)), max_size=3))
    fault = data.draw(FAULTS)

    def fill(inside: list[str], name: str) -> str:
        before = data.draw(st.lists(HARMLESS, max_size=4))
        for build in before:
            build(builder)
        here = f"{name}[{len(before)}]"
        if not inside:
            fault.build(builder)
            return here
        with BLOCKS[inside[0]](builder):
            return f"{here}.{fill(inside[1:], inside[0])}"

    path = fill(blocks, "icons")
    found = builder.check(kinematics, planner, LOBBY)
    assert wrong(found) == [(path, fault.parameter)]
    with pytest.raises(InvalidProgram) as refused:
        found.require_valid()
    assert (refused.value.icon, refused.value.parameter) == (path, fault.parameter)


def test_the_joints_of_a_start_are_left_as_they_are(kinematics: InverseKinematics) -> None:
    joints = home()
    check(built(lambda a: a.mhand_posture("both", "ready")).program(), kinematics, start=Start(joints=joints))
    assert np.array_equal(joints, home())

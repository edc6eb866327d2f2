"""The steps of a SubPlan in the simulated building, the part of a robot that does them, and clocks."""

from __future__ import annotations

import contextlib
import math
import time
from functools import partial
from pathlib import Path
from unittest.mock import DEFAULT, MagicMock, Mock

import pytest

from robocorba.errors.robots import RideLost, RobotLost, ServerAway
from robocorba.errors.simulation import InvalidReservation
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.map_editor.samples import load_sample
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock, SteadyClock
from robocorba.missions.execution import ABORT_BACK_M, StepExecutor
from robocorba.missions.leader_areas import LeaderAreas
from robocorba.missions.member import Member, MemberPolicy
from robocorba.missions.messages import Assignment
from robocorba.missions.subplan import BackOff, CallCabin, Carry, Reserve, Ride, SubPlan, TakeHold
from robocorba.missions.trajectory import Trajectory
from robocorba.planning.planner import PathPlanner
from robocorba.robot.robot import Robot
from robocorba.simulation.registry import Pose
from tests.robot.collision_avoidance.crowd import Crowd
from tests.robot.collision_avoidance.test_giving_way import room
from tests.robot.stepped_robot import Session, SteppedRobot, World

BOX = MapObject("box", BoxShape((0.6, 0.6)), (2.0, 1.0), height=0.8, movable=True)
CARRY = Carry(rows=Trajectory([(2.0, 1.0, 0.0), (2.5, 1.0, 0.0)]).to_rows(), place=(-0.92, 0.0, 0.0))
HOLD = TakeHold(thing="box", at=(2.0, 1.0, 0.0), x=1.7, y=1.0, height_m=0.7)


def at_the_box() -> Crowd:
    return Crowd(room(6.0, 2.0, BOX), {"A": (1.08, 1.0, 0.0)})


def face_to_face() -> Crowd:
    return Crowd(room(8.0, 2.0), {"A": (1.0, 1.0, 0.0), "B": (7.0, 1.0, 0.0)})


def executor_of(robot: Robot) -> StepExecutor:
    return StepExecutor(robot, CarryProgress(), LeaderClock(), lambda thing: None)


@pytest.mark.parametrize("step", [CARRY, Ride(elevator="E1", destination="L2")], ids=lambda step: type(step).__name__)
def test_losing_the_grip_ends_the_step(step: Carry | Ride) -> None:
    def carry(robot: Robot) -> None:
        executor = executor_of(robot)
        executor.execute(HOLD)
        assert robot.session.latest.holding == "box"
        robot.session.release()
        robot.session.state()
        executor.execute(step)

    assert at_the_box().run(60.0, A=carry) == {"A": "lost its hold of box"}


def test_carriers_drive_into_a_cabin_only_while_they_have_a_ride(tmp_path: Path) -> None:
    building = load_sample("five-floors")
    world = World(building, tmp_path)
    x, y = building.elevators["E1"].at
    session = Session(world, Pose("L1", x, y - 2.35, math.pi / 2))
    robot = SteppedRobot(world, session, PathPlanner(building))
    executor = executor_of(robot)  # type: ignore[arg-type]
    executor.execute(CallCabin(elevator="E1", destination="L2", party="p", size=1))
    session.cancel_elevator()
    session.state()
    way = Trajectory([(x, y - 2.35, math.pi / 2), (x, y, math.pi / 2)])
    with pytest.raises(RideLost, match="E1: the ride was lost while the robot drove in"):
        executor.execute(Carry(rows=way.to_rows(), place=(0.0, 0.0, 0.0)))
    world.close()


def test_a_robot_lets_go_after_an_abort_once_the_server_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    crowd = at_the_box()

    def abort(robot: Robot) -> None:
        executor = executor_of(robot)
        executor.execute(HOLD)
        for name in ("release", "cancel_elevator"):
            answers = [ServerAway("away")] * 2 + [DEFAULT] * 1000
            call = MagicMock(wraps=getattr(robot.session, name), side_effect=answers)
            monkeypatch.setattr(robot.session, name, call)
        executor.end_safely()

    assert crowd.run(60.0, A=abort) == {}
    assert crowd.robots["A"].session.latest.holding == ""
    assert crowd.at("A")[0] == pytest.approx(1.08 - ABORT_BACK_M, abs=0.01)


def test_areas_that_were_reserved_with_the_plan_keep_their_turn_and_others_wait_for_a_limited_time() -> None:
    crowd, granted = face_to_face(), list[tuple[float, float]]()
    west, east = ((0.0, 0.1), (2.0, 0.1), (2.0, 1.9)), ((3.0, 0.1), (5.0, 0.1), (5.0, 1.9))
    a, b = crowd.robots["A"].session, crowd.robots["B"].session
    assert a.reserve_one_of([[("L1", west)], [("L1", east)]], 60.0) == 0
    b.reserve([("L1", west)], 60.0)

    def reserve(robot: Robot, area: tuple[tuple[float, float], ...]) -> None:
        executor_of(robot).execute(Reserve(areas=(("L1", area),), hold_s=60.0, limit_s=2.0))
        granted.append(area[0])

    assert crowd.run(20.0, A=partial(reserve, area=west)) == {}  # not behind B
    assert crowd.run(20.0, A=partial(reserve, area=east)) == {}  # another way: not what was reserved
    assert crowd.run(20.0, B=partial(reserve, area=west)) == {}
    assert crowd.run(20.0, A=partial(reserve, area=west)) == {"A": "the path's areas were not granted within 2 s"}
    assert granted == [west[0], east[0], west[0]]


@pytest.mark.parametrize(
    ("error", "goes_on"),
    [
        (InvalidReservation("areas[0]", "A has not reserved it"), True),  # since its floor was renamed during the ride
        (InvalidReservation("robot", "A has no reservation"), False),
    ],
)
def test_a_ride_ends_also_on_a_floor_that_got_another_name(error: InvalidReservation, goes_on: bool) -> None:
    robot = MagicMock()
    executor = executor_of(robot)
    areas = tuple((floor, ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))) for floor in ("L1", "L2"))
    executor.execute(Reserve(areas=areas, hold_s=60.0))
    robot.session.keep_areas.side_effect = error
    with contextlib.nullcontext() if goes_on else pytest.raises(InvalidReservation):
        executor.execute(Ride(elevator="E1", destination="L2"))
    assert robot.session.keep_areas.call_args.args == (areas[1:],)


def test_what_was_moved_is_not_gripped_and_a_robot_backs_off_as_far_as_there_is_room() -> None:
    def grip(robot: Robot) -> None:
        StepExecutor(robot, CarryProgress(), LeaderClock(), lambda thing: (0.92, 0.05, 0.0)).execute(HOLD)

    assert at_the_box().run(20.0, A=grip) == {"A": "box was moved to (2.00, 1.05) after planning"}
    crowd = Crowd(room(6.0, 2.0), {"A": (0.55, 1.0, 0.0)})
    assert crowd.run(60.0, A=lambda robot: executor_of(robot).execute(BackOff(distance_m=0.3))) == {}
    assert crowd.touched == []
    assert crowd.at("A")[0] == pytest.approx(0.42, abs=0.005)


def test_a_part_that_ends_before_its_first_step_has_begun_none() -> None:
    crowd = Crowd(room(4.0, 2.0), {"A": (1.0, 1.0, 0.0)})
    subplan = SubPlan("A", "helper", (BackOff(distance_m=0.3),))
    task = Assignment(mission="m.1", leader="B", term=1, phases=("backing off",), subplan=subplan)
    member = Member(task, crowd.robots["A"], lambda thing: None, MemberPolicy(end_order_timeout_s=0.0))

    def take_part(robot: Robot) -> None:
        robot.execution.abort("emergency stop")
        member.run()

    assert crowd.run(20.0, A=take_part) == {}
    assert (member.report.reason, member.report.icons_done) == ("emergency stop", 0)  # unsigned in robot.idl


@pytest.mark.parametrize("failures", [[ServerAway("restarting")] * 2 + [None], [RobotLost("logged off")]])
def test_areas_are_given_back_once_the_server_is_back(failures: list[Exception | None]) -> None:
    """Else they would keep other missions waiting for ten minutes. A robot that was logged off has none."""
    session = Mock()
    session.release_areas.side_effect = failures
    LeaderAreas(session).release()
    assert session.release_areas.call_count == len(failures)


HOUR_S = 3600.0


@pytest.mark.parametrize("jump_s", [-HOUR_S, HOUR_S, -50 * 365 * 24 * HOUR_S])
def test_time_passes_steadily_while_the_clock_is_set(monkeypatch: pytest.MonkeyPatch, jump_s: float) -> None:
    own, leaders = SteadyClock(), LeaderClock()
    before, ordered, wall = own.now(), leaders.now(), time.time
    monkeypatch.setattr(time, "time", lambda: wall() + jump_s)
    assert 0.0 <= own.now() - before < HOUR_S / 2
    assert 0.0 <= leaders.now() - ordered < HOUR_S / 2
    own.synchronize()
    assert abs(own.now() - before - jump_s) < HOUR_S / 2

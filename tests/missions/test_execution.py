"""The steps of a SubPlan in the simulated building."""

from __future__ import annotations

import contextlib
import math
from functools import partial
from pathlib import Path
from unittest.mock import DEFAULT, MagicMock

import pytest

from robocorba.errors.robots import RideLost, ServerAway
from robocorba.errors.simulation import InvalidReservation
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.map_editor.samples import load_sample
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.execution import ABORT_BACK_M, StepExecutor
from robocorba.missions.subplan import BackOff, CallCabin, Carry, Reserve, Ride, TakeHold
from robocorba.missions.trajectory import Trajectory
from robocorba.planning.planner import PathPlanner
from robocorba.robot.robot import Robot
from robocorba.simulation.registry import Pose
from tests.robot.collision_avoidance.crowd import Crowd
from tests.robot.collision_avoidance.test_giving_way import room
from tests.robot.stepped_robot import Session, SteppedRobot, World

BOX = MapObject("box", BoxShape((0.6, 0.6)), (2.0, 1.0), height=0.8, movable=True)
CARRY = Carry(rows=Trajectory([(2.0, 1.0, 0.0), (2.5, 1.0, 0.0)]).to_rows(), place=(-0.92, 0.0, 0.0))


def executor_of(robot: Robot) -> StepExecutor:
    return StepExecutor(robot, CarryProgress(), LeaderClock(), lambda thing: None)


@pytest.mark.parametrize("step", [CARRY, Ride(elevator="E1", destination="L2")], ids=lambda step: type(step).__name__)
def test_losing_the_grip_ends_the_step(step: Carry | Ride) -> None:
    crowd = Crowd(room(6.0, 2.0, BOX), {"A": (1.08, 1.0, 0.0)})

    def carry(robot: Robot) -> None:
        executor = executor_of(robot)
        executor.execute(TakeHold(thing="box", at=(2.0, 1.0, 0.0), x=1.7, y=1.0, height_m=0.7))
        assert robot.session.latest.holding == "box"
        robot.session.release()
        robot.session.state()
        executor.execute(step)

    assert crowd.run(60.0, A=carry) == {"A": "lost its hold of box"}


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
    crowd = Crowd(room(6.0, 2.0, BOX), {"A": (1.08, 1.0, 0.0)})

    def abort(robot: Robot) -> None:
        executor = executor_of(robot)
        executor.execute(TakeHold(thing="box", at=(2.0, 1.0, 0.0), x=1.7, y=1.0, height_m=0.7))
        for name in ("release", "cancel_elevator"):
            call = MagicMock(
                wraps=getattr(robot.session, name), side_effect=[ServerAway("away")] * 2 + [DEFAULT] * 1000
            )
            monkeypatch.setattr(robot.session, name, call)
        executor.end_safely()

    assert crowd.run(60.0, A=abort) == {}
    assert crowd.robots["A"].session.latest.holding == ""
    assert crowd.at("A")[0] == pytest.approx(1.08 - ABORT_BACK_M, abs=0.01)


def test_overlapping_reservations_are_granted_one_after_the_other() -> None:
    crowd = Crowd(room(8.0, 2.0), {"A": (1.0, 1.0, 0.0), "B": (7.0, 1.0, 0.0)})
    ours: dict[str, tuple[float, float]] = {}

    def pass_by(robot: Robot, name: str, ahead_m: float) -> None:
        executor = executor_of(robot)
        west, east = (2.0, 5.0) if name == "A" else (3.0, 6.0)
        area = ((west, 0.1), (east, 0.1), (east, 1.9), (west, 1.9))
        executor.execute(Reserve(areas=(("L1", area),), hold_s=60.0, limit_s=60.0))
        begun = crowd.time
        robot.drive_by(ahead_m, 0.0, 0.0, 0.3)
        ours[name] = begun, crowd.time
        executor.release_reservations()

    assert crowd.run(60.0, A=partial(pass_by, name="A", ahead_m=0.5), B=partial(pass_by, name="B", ahead_m=0.6)) == {}
    first, second = sorted(ours.values())
    assert second[0] >= first[1]
    assert crowd.robots["A"].session.reservation() is None


def test_waiting_for_a_reservation_has_a_limit() -> None:
    crowd = Crowd(room(8.0, 2.0), {"A": (1.0, 1.0, 0.0), "B": (7.0, 1.0, 0.0)})
    area = ((2.0, 0.1), (5.0, 0.1), (5.0, 1.9), (2.0, 1.9))
    crowd.robots["B"].session.reserve([("L1", area)], 60.0)

    def reserve(robot: Robot) -> None:
        executor_of(robot).execute(Reserve(areas=(("L1", area),), hold_s=60.0, limit_s=2.0))

    assert crowd.run(20.0, A=reserve) == {"A": "the path's areas were not granted within 2 s"}


def test_areas_that_were_reserved_with_the_plan_keep_their_turn() -> None:
    crowd = Crowd(room(8.0, 2.0), {"A": (1.0, 1.0, 0.0), "B": (7.0, 1.0, 0.0)})
    west, east = ((0.0, 0.1), (2.0, 0.1), (2.0, 1.9)), ((3.0, 0.1), (5.0, 0.1), (5.0, 1.9))
    a, b = crowd.robots["A"].session, crowd.robots["B"].session
    assert a.reserve_one_of([[("L1", west)], [("L1", east)]], 60.0) == 0
    b.reserve([("L1", west)], 60.0)
    granted: list[tuple[float, float]] = []

    def reserve(robot: Robot, area: tuple[tuple[float, float], ...]) -> None:
        executor_of(robot).execute(Reserve(areas=(("L1", area),), hold_s=60.0, limit_s=2.0))
        granted.append(area[0])

    assert crowd.run(20.0, A=partial(reserve, area=west)) == {}  # not behind B
    assert crowd.run(20.0, A=partial(reserve, area=east)) == {}  # another way: not what was reserved
    assert crowd.run(20.0, B=partial(reserve, area=west)) == {}
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


def test_an_object_moved_after_planning_is_not_gripped() -> None:
    crowd = Crowd(room(6.0, 2.0, BOX), {"A": (1.08, 1.0, 0.0)})

    def grip(robot: Robot) -> None:
        executor = StepExecutor(robot, CarryProgress(), LeaderClock(), lambda thing: (0.92, 0.05, 0.0))
        executor.execute(TakeHold(thing="box", at=(2.0, 1.0, 0.0), x=1.7, y=1.0, height_m=0.7))

    assert crowd.run(20.0, A=grip) == {"A": "box was moved to (2.00, 1.05) after planning"}


def test_a_robot_backs_off_as_far_as_there_is_room() -> None:
    crowd = Crowd(room(6.0, 2.0), {"A": (0.55, 1.0, 0.0)})

    def back_off(robot: Robot, distance_m: float) -> None:
        executor_of(robot).execute(BackOff(distance_m=distance_m))

    assert crowd.run(60.0, A=partial(back_off, distance_m=0.3)) == {}
    assert crowd.touched == []
    assert crowd.at("A")[0] == pytest.approx(0.42, abs=0.005)

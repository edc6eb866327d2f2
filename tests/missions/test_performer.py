"""How a robot does its steps, in the simulated building."""

from __future__ import annotations

from functools import partial

import pytest

from robocorba.control import course
from robocorba.control.robot import Robot
from robocorba.maps.model import BoxShape, MapObject
from robocorba.missions.clock import LeaderClock
from robocorba.missions.performer import Performer
from robocorba.missions.rhythm import Rhythm
from robocorba.missions.subplan import BackOff, Carry, Ride, TakeHold
from robocorba.missions.trajectory import Trajectory
from tests.control.crowd import Crowd
from tests.control.test_giving_way import room

BOX = MapObject("box", BoxShape((0.6, 0.6)), (2.0, 1.0), height=0.8, movable=True)
CARRY = Carry(rows=Trajectory([(2.0, 1.0, 0.0), (2.5, 1.0, 0.0)]).to_rows(), place=(-0.92, 0.0, 0.0))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(course, "LOOK_S", 0.002)


def performer(robot: Robot) -> Performer:
    return Performer(robot, Rhythm(), LeaderClock(), lambda thing: None)


@pytest.mark.parametrize("step", [CARRY, Ride(elevator="E1", destination="L2")], ids=lambda step: type(step).__name__)
def test_a_grip_that_is_lost_ends_the_step(step: Carry | Ride) -> None:
    crowd = Crowd(room(6.0, 2.0, BOX), {"A": (1.08, 1.0, 0.0)})

    def carry(robot: Robot) -> None:
        part = performer(robot)
        part.do(TakeHold(thing="box", x=1.7, y=1.0, height_m=0.7))
        assert robot.session.latest.holding == "box"
        robot.session.release()
        robot.session.state()
        part.do(step)

    assert crowd.run(60.0, A=carry) == {"A": "lost its hold of box"}


def test_who_has_no_room_behind_backs_off_as_far_as_there_is() -> None:
    crowd = Crowd(room(6.0, 2.0), {"A": (0.55, 1.0, 0.0)})

    def back_off(robot: Robot, distance_m: float) -> None:
        performer(robot).do(BackOff(distance_m=distance_m))

    assert crowd.run(60.0, A=partial(back_off, distance_m=0.3)) == {}
    assert crowd.touched == []
    assert crowd.at("A")[0] == pytest.approx(0.42, abs=0.005)

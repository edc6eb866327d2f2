"""A robot as a component, without CORBA and without a robot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from robocorba.bridges.openrtm.connections import Connection
from robocorba.bridges.openrtm.data_ports import DATAFLOW, IN_PORT, OUT_PORT, DataType, InvalidValue
from robocorba.bridges.openrtm.life_cycle import ReturnCode, State
from robocorba.bridges.openrtm.robot_component import DataTypes, Ranges, RobotComponent, TimedPose, TimedText, Velocity
from robocorba.errors.robots import IllegalOrder
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_view import RobotPlace
from tests.bridges.openrtm.ports import LocalPeer, Objects

PLACE = RobotPlace("A", "L1", 2.0, 3.0, 0.0, 0.5, (0.0, 0.0, 0.0))


def kept(name: str) -> DataType[Any]:
    """Values that stay as they are, in place of bytes."""
    return DataType(f"IDL:RTC/{name}:1.0", lambda value, is_little: value, lambda data, is_little: data)


class Robot:
    """Takes orders. stop: why its emergency stop can't be ended."""

    def __init__(self) -> None:
        self.orders: list[tuple[Velocity, float]] = []
        self.stop = ""

    def drive(self, velocity: Velocity, valid_s: float) -> None:
        self.orders.append((velocity, valid_s))

    def reset_stop(self) -> None:
        if self.stop:
            raise IllegalOrder("restart", self.stop)


class Shown:
    """A component, and what its ports offer now."""

    def __init__(self) -> None:
        self.robot, self.objects = Robot(), Objects()
        types = DataTypes(kept("Pose"), kept("Text"), kept("Ranges"), kept("Velocity"))
        self.component = RobotComponent("A", "A 1", types, self.objects, self.robot)
        self._offered: dict[str, str] = {}
        for port in self.component.ports:
            own = LocalPeer(port)
            assert own.connections
            flow = port.dataflows[-1]
            code, made = own.connections.connect(Connection("", "", (own,), {DATAFLOW: flow}))
            assert code is ReturnCode.OK
            self._offered[port.name] = made.properties[IN_PORT if flow == "push" else OUT_PORT]

    def put(self, velocity: Velocity) -> bool:
        return bool(self.objects.served[self._offered["A.velocity"]](velocity))

    def out(self, port: str) -> Any:
        return self.objects.served[self._offered[f"A.{port}"]]()


def scan_of(mount: tuple[float, float, float] = (0.1, 0.0, 0.0)) -> RobotScan:
    hits = np.array([True, False])
    at, counts = Pose("L1", 2.0, 3.0, 0.5), (0.0, 0.0, 0.0, 0)
    return RobotScan("A 1", 4.0, at, mount, -1.0, 2.0, 8.0, 0.1, counts, hits * 2.0, hits)


def test_only_an_active_component_of_a_running_context_sends_and_drives() -> None:
    shown, speed = Shown(), (0.2, 0.0, 0.1)
    component = shown.component
    component.show(0.0, 7.0, PLACE)
    component.show_scan(scan_of(), 10.0)
    assert shown.put(speed)
    assert [shown.out(port) for port in ("pose", "floor", "range")] == [None] * 3
    assert shown.robot.orders == []

    assert component.life_cycle.activate() is ReturnCode.OK
    component.show(1.0, 8.0, PLACE)
    component.show_scan(scan_of(), 10.0)
    assert shown.put(speed)
    assert shown.out("pose") == TimedPose(8.0, 2.0, 3.0, 0.5)
    assert shown.out("floor") == TimedText(8.0, "L1")
    ranges = shown.out("range")
    assert isinstance(ranges, Ranges) and ranges.scan.time == 4.0 and ranges.rate_hz == 10.0
    component.show_scan(scan_of((-0.1, 0.0, math.pi)), 10.0)  # of another sensor
    assert shown.out("range").scan.mount == (0.1, 0.0, 0.0)
    assert shown.robot.orders == [(speed, 0.5)]

    assert [component.stop(), component.stop()] == [ReturnCode.OK, ReturnCode.PRECONDITION_NOT_MET]
    component.show(2.0, 9.0, PLACE)
    assert shown.put(speed)
    assert shown.out("pose").time_s == 8.0
    assert shown.robot.orders[1:] == [((0.0, 0.0, 0.0), 0.5)]  # it stands
    assert [component.start(), component.start()] == [ReturnCode.OK, ReturnCode.PRECONDITION_NOT_MET]


def test_poses_come_at_the_rate() -> None:
    shown = Shown()
    shown.component.life_cycle.activate()
    assert shown.component.set_rate(2.0) is ReturnCode.OK
    times = []
    for step in range(41):  # 2 s, looked at 20 times a second
        shown.component.show(step / 20, step / 20, PLACE)
        times.append(shown.out("pose").time_s)
    assert len(set(times)) == 5
    for wrong in (0.0, -1.0, math.nan, math.inf, 1000.0):
        assert shown.component.set_rate(wrong) is ReturnCode.BAD_PARAMETER
    assert shown.component.rate_hz == 2.0


def test_the_validity_of_velocities_is_a_parameter() -> None:
    shown = Shown()
    component = shown.component
    component.life_cycle.activate()
    assert component.configuration == {"velocity_valid_for": "0.5"}
    component.configure({"velocity_valid_for": "2"})
    shown.put((0.1, 0.0, 0.0))
    assert shown.robot.orders == [((0.1, 0.0, 0.0), 2.0)]
    for wrong in ({"velocity_valid_for": value} for value in ("x", "nan", "0", "9", object())):
        with pytest.raises(InvalidValue):
            component.configure(wrong)
    with pytest.raises(InvalidValue, match="there is no parameter speed"):
        component.configure({"velocity_valid_for": "1", "speed": "1"})
    assert component.configuration == {"velocity_valid_for": "2"}  # none was set


def test_a_component_that_ends_leaves_nothing_and_stands_if_it_was_driven() -> None:
    shown = Shown()
    life = shown.component.life_cycle
    for act in (life.activate, life.deactivate, life.activate):
        act()
    assert not any(shown.put((wrong, 0.0, 0.0)) for wrong in (math.nan, math.inf))
    assert shown.robot.orders == []
    shown.put((0.1, 0.0, 0.0))
    shown.component.close()
    assert not shown.objects.served
    assert life.state is State.INACTIVE
    assert shown.robot.orders[-1] == ((0.0, 0.0, 0.0), 0.5)


# ---- the life cycle alone ----

STAND = (0.0, 0.0, 0.0), 0.5
OK, REFUSED = ReturnCode.OK, ReturnCode.PRECONDITION_NOT_MET


def test_each_operation_is_allowed_in_one_state() -> None:
    shown = Shown()
    life = shown.component.life_cycle
    assert life.state is State.INACTIVE
    assert [life.deactivate(), life.reset(), life.fail("why")] == [REFUSED] * 3
    assert life.activate() is OK
    assert life.is_active
    assert [life.activate(), life.reset()] == [REFUSED] * 2
    shown.put((0.1, 0.0, 0.0))
    assert life.fail("emergency stop") is OK
    assert shown.robot.orders[1:] == [STAND]
    assert (life.state, life.reason) == (State.ERROR, "emergency stop")
    assert [life.activate(), life.deactivate(), life.fail("again")] == [REFUSED] * 3
    shown.robot.stop = "still pressed"
    assert (life.reset(), life.state) == (ReturnCode.ERROR, State.ERROR)
    assert "still pressed" in life.reason
    shown.robot.stop = ""
    assert (life.reset(), life.state, life.reason) == (OK, State.INACTIVE, "")
    life.activate()
    shown.put((0.1, 0.0, 0.0))
    assert [life.deactivate(), life.state] == [OK, State.INACTIVE]
    assert shown.robot.orders[3:] == [STAND]


@pytest.mark.parametrize("kind", [ReturnCode, State])
def test_numbers_are_those_of_the_idl(kind: type[ReturnCode] | type[State]) -> None:
    assert [one.value for one in kind] == list(range(len(kind)))

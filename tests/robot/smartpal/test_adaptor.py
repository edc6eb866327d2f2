"""The hardware adaptor on units of this process, some of which hang or fail: what no real robot does on demand."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from robocorba.errors.robots import AdaptorFailed, UnitFailed
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot import smartpal_adaptor
from robocorba.robot.kinematics.smartpal import JOINT_SPEED, JOINTS, Side
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.smartpal_adaptor import SmartPalAdaptor
from tests.waits import work_for

ARGUMENTS = ["--naming", "127.0.0.1:1"]


class Units:
    """Units without faults by default. `calls`: all calls in order. `hold`: calls to jog the base wait for it."""

    names = ("Mobility", "MnpR", "MnpL", "GripperR", "GripperL", "Lumbar")

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.hold = threading.Event()
        self.hold.set()
        self.jogging = threading.Event()
        self.deaf: set[str] = set()
        self.never_ready: set[str] = set()
        self.delay_s = 0.0
        self.odometry = 1.0, 2.0, 0.5
        self.asked: list[str] = []

    def is_ready(self, unit: str) -> bool:
        return unit not in self.never_ready

    def make_ready(self, unit: str) -> None:
        pass

    def check(self, unit: str) -> None:
        if unit in self.never_ready:
            raise UnitFailed(unit, 0x15, "fever")

    def stop(self, unit: str) -> None:
        if unit in self.deaf:
            raise AdaptorFailed(f"{unit} does not answer")
        self.calls.append(("stop", unit))

    def pose(self) -> tuple[float, float, float]:
        work_for(self.delay_s)
        return self.odometry

    def arm(self, side: Side) -> Floats:
        self.asked.append(side.value)
        work_for(self.delay_s)
        return np.full(7, 0.1 if side is Side.LEFT else 0.2)

    def lumbar(self) -> Floats:
        self.asked.append("lumbar")
        return np.array([0.0, 0.3])

    def grip(self, side: Side) -> float:
        return -0.4 if side is Side.LEFT else -0.5

    def jog_base(self, ahead: float, left: float, turn: float) -> None:
        self.jogging.set()
        assert self.hold.wait(60.0)
        self.calls.append(("jog", ahead, left, turn))

    def __getattr__(self, order: str) -> Any:
        return lambda *arguments: self.calls.append((order, *arguments))


@pytest.fixture
def units() -> Units:
    return Units()


@pytest.fixture
def adaptor(units: Units) -> SmartPalAdaptor:
    made = SmartPalAdaptor(lambda naming: units)
    assert made.start(ARGUMENTS)
    return made


def orders(units: Units, name: str) -> list[tuple[Any, ...]]:
    return [order for order in units.calls if order[0] == name]


@pytest.mark.parametrize("delay_s", [0.0, 0.01])
def test_read_puts_the_joints_in_order(units: Units, adaptor: SmartPalAdaptor, delay_s: float) -> None:
    """Also side by side, where units answer late."""
    units.delay_s = delay_s
    state = RobotState()
    for _ in range(4):
        assert adaptor.read(state)
    assert (state.x, state.y, state.heading) == (1.0, 2.0, 0.5)
    assert state.joints.tolist() == [*[0.1] * 7, *[0.2] * 7, 0.0, 0.3, -0.4, -0.5]
    assert state.velocity == (0.0, 0.0, 0.0)


def test_arms_get_what_is_wanted_and_what_takes_back_the_error(units: Units, adaptor: SmartPalAdaptor) -> None:
    adaptor.read(RobotState())
    joints, moving = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
    joints[:14] = [*[0.15] * 7, *[0.2] * 7]
    moving[0], joints[7] = 0.3, 2.0
    assert adaptor.write(ActorCommand(joints=joints, joint_velocities=moving))
    left, right = (order[2] for order in orders(units, "jog_arm"))
    assert left == pytest.approx([0.3 + smartpal_adaptor.GAIN * 0.05, *[smartpal_adaptor.GAIN * 0.05] * 6])
    assert right == pytest.approx([JOINT_SPEED[7], *[0.0] * 6])


def test_what_stands_is_neither_told_so_again_nor_asked_for_each_time(units: Units, adaptor: SmartPalAdaptor) -> None:
    still = np.zeros(len(JOINTS))
    still[:14] = [*[0.1] * 7, *[0.2] * 7]
    state = RobotState()
    for _ in range(10):
        adaptor.read(state)
        adaptor.write(ActorCommand((0.2, 0.0, 0.0), still, np.zeros(len(JOINTS))))
    assert len(orders(units, "jog")) == 10
    assert len(orders(units, "jog_arm")) == 2
    assert units.asked.count("left") <= 4

    moving = np.zeros(len(JOINTS))
    moving[0] = 0.1
    adaptor.write(ActorCommand((0.0, 0.0, 0.0), still, moving))
    units.asked.clear()
    for _ in range(10):
        adaptor.read(state)
        adaptor.write(ActorCommand((0.0, 0.0, 0.0), still, np.zeros(len(JOINTS))))
    assert units.asked.count("left") == 10
    assert orders(units, "jog")[-1] == ("jog", 0.0, 0.0, 0.0)
    assert len(orders(units, "jog")) == 11
    assert [order[1] for order in orders(units, "jog_arm")[2:]] == [Side.LEFT, Side.LEFT]


def test_what_is_told_only_when_it_changes(units: Units, adaptor: SmartPalAdaptor) -> None:
    """Targets of lumbar and grippers, and how long jogs hold; without joints only the base is told."""
    joints = np.zeros(len(JOINTS))
    for _ in range(3):
        adaptor.write(ActorCommand(joints=joints))
    assert (len(orders(units, "move_lumbar")), len(orders(units, "move_grip"))) == (1, 2)
    joints[-1] = -0.5
    adaptor.write(ActorCommand(joints=joints))
    assert len(orders(units, "move_lumbar")) == 1
    assert [order[1:3] for order in orders(units, "move_grip")][2:] == [(Side.RIGHT, -0.5)]
    units.calls.clear()
    adaptor.write(ActorCommand((0.1, 0.0, 0.2)))
    assert units.calls == [("jog", 0.1, 0.0, 0.2)]
    for valid_s in (0.1, 0.2, 0.2, 60.0):
        adaptor.write(ActorCommand(valid_s=valid_s))
    assert [order[1] for order in orders(units, "set_jog_timeout")] == [0.2, smartpal_adaptor.MAX_JOG_S]


def test_stop_does_not_wait_for_a_write_that_hangs(units: Units, adaptor: SmartPalAdaptor) -> None:
    units.hold.clear()
    with ThreadPoolExecutor() as threads:
        writing = threads.submit(adaptor.write, ActorCommand((0.3, 0.0, 0.0)))
        assert units.jogging.wait(60.0)
        units.calls.clear()
        assert adaptor.stop()
        assert {order[1] for order in orders(units, "stop")} == set(Units.names)
        units.hold.set()
    assert not writing.result()  # the jog came through after all: it was taken back
    assert not orders(units, "jog_arm")
    jogged = units.calls.index(("jog", 0.3, 0.0, 0.0))
    assert ("stop", "Mobility") in units.calls[jogged:]


def test_a_stop_names_who_did_not_and_stops_the_others(units: Units, adaptor: SmartPalAdaptor) -> None:
    units.deaf = {"MnpR"}
    units.calls.clear()
    with pytest.raises(AdaptorFailed, match="MnpR does not answer"):
        adaptor.stop()
    assert {order[1] for order in orders(units, "stop")} == set(Units.names) - {"MnpR"}
    assert not adaptor.stop()


def test_a_robot_that_does_not_get_ready(units: Units) -> None:
    units.never_ready = {"Lumbar"}
    adaptor = SmartPalAdaptor(lambda naming: units, start_limit_s=0.2)
    with pytest.raises(UnitFailed, match="fever"):
        adaptor.start(ARGUMENTS)
    assert not adaptor.read(RobotState())
    units.never_ready = set()
    assert adaptor.start(ARGUMENTS)


def places(units: Units) -> list[tuple[Any, ...]]:
    return [order[1:] for order in orders(units, "set_pose")]


def test_the_odometry_goes_on_by_where_a_former_process_has_left_the_robot(units: Units) -> None:
    units.odometry = 7.3, 8.0, 0.9
    left = SmartPalAdaptor(lambda naming: units, lambda: (7.0, 8.0, 0.9), last_pose=(7.0, 8.0, 0.9))
    assert left.start(ARGUMENTS)
    assert places(units) == []
    left.stop()
    units.odometry = 0.0, 0.0, 0.0  # it was switched off meanwhile
    for arguments, pose in ((ARGUMENTS, (7.0, 8.0, 0.9)), ([*ARGUMENTS, "--pose=1,2,0.3"], (1.0, 2.0, 0.3))):
        adaptor = SmartPalAdaptor(lambda naming: units, lambda: (7.0, 8.0, 0.9), last_pose=(7.0, 8.0, 0.9))
        assert adaptor.start(arguments)
        adaptor.stop()
        assert places(units)[-1] == pose

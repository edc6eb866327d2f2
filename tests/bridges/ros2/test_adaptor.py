"""The adaptor of robots that speak ROS 2, without ROS: messages in, velocities out."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocorba.bridges.ros2 import adaptor as module
from robocorba.bridges.ros2 import lasers as lasers_module
from robocorba.bridges.ros2.adaptor import Ros2Adaptor
from robocorba.bridges.ros2.lasers import Lasers
from robocorba.errors.robots import AdaptorFailed, RobotLost
from robocorba.errors.sensing import UnknownSensor
from robocorba.errors.services import ServiceError
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, ActorCommand, RobotState, Velocity
from robocorba.simulation.sensing.scan import Mount
from testkit.processes import eventually


def stamped(time_s: float, **fields: Any) -> Any:
    stamp = SimpleNamespace(sec=int(time_s), nanosec=round((time_s % 1.0) * 1e9))
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), **fields)


def posed(x: float, y: float, heading: float) -> Any:
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
    return SimpleNamespace(pose=SimpleNamespace(position=SimpleNamespace(x=x, y=y), orientation=turn))


def odometry(time_s: float, x: float, y: float, heading: float, ahead: float = 0.0) -> Any:
    moving = SimpleNamespace(linear=SimpleNamespace(x=ahead, y=0.0), angular=SimpleNamespace(z=0.0))
    return stamped(time_s, pose=posed(x, y, heading), twist=SimpleNamespace(twist=moving))


def scan(distances: Sequence[float], **fields: Any) -> Any:
    usual = {"angle_min": -0.5, "angle_increment": 0.5, "range_min": 0.2, "range_max": 6.0}
    return stamped(7.5, ranges=distances, **{**usual, **fields})


class Robot:
    """What an adaptor sees of a robot: a node whose topics are called by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *arrives: tuple[str, Any]) -> None:
        self.take: dict[str, Callable[[Any], None]] = {}
        self.published: list[Any] = []
        self.timers: list[Callable[[], None]] = []
        self.domain, self.starts, self.closed = 5, 0, 0
        self.arrives = list(arrives)
        self.node = SimpleNamespace(create_timer=lambda period_s, look: self.timers.append(look))
        monkeypatch.setattr(module, "ros_node", lambda domain, name: self)
        monkeypatch.setattr(module, "_subscribe", self.subscribe)
        monkeypatch.setattr(module, "_velocities", lambda *topic: (self.published.append, lambda: None))

    def start(self) -> None:
        for topic, message in self.arrives:
            self.take[topic](message)

    def close(self) -> None:
        self.closed += 1

    def subscribe(self, node: Any, topic: str, type: str, take: Callable[[Any], None]) -> None:
        self.take[topic] = take


def at(adaptor: Ros2Adaptor) -> tuple[float, ...]:
    state = RobotState()
    assert adaptor.read(state)
    return round(state.x, 6), round(state.y, 6), round(state.heading, 6)


def test_odometry_goes_on_from_where_the_robot_is_and_localization_corrects_it(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, ("odom", odometry(1.0, 10.0, 0.0, math.pi / 2)))
    adaptor = Ros2Adaptor("A", lambda: (2.0, 3.0, 0.0))
    assert not adaptor.read(RobotState()) and not adaptor.write(ActorCommand()) and not adaptor.stop()
    assert adaptor.start(["--localization", "amcl"]) and not adaptor.start([])
    assert at(adaptor) == (2.0, 3.0, 0.0)
    robot.take["odom"](odometry(2.0, 10.0, 0.4, math.pi, ahead=0.5))
    state = RobotState()
    adaptor.read(state)
    assert (state.time, state.velocity, at(adaptor)) == (2.0, (0.5, 0.0, 0.0), (2.4, 3.0, round(math.pi / 2, 6)))
    robot.take["amcl"](stamped(1.5, pose=posed(2.3, 3.1, math.pi / 4)))  # half way between both
    assert at(adaptor) == (2.5, 3.1, round(math.pi / 2, 6))
    for broken in (odometry(3.0, math.nan, 1.0, 0.0), odometry(3.0, 1.0, math.inf, 0.0)):
        robot.take["odom"](broken)
    robot.take["amcl"](stamped(1.5, pose=posed(math.nan, 3.1, 0.0)))
    assert at(adaptor) == (2.5, 3.1, round(math.pi / 2, 6))
    # Later starts: it has moved a little while nobody looked; then its odometry begins again.
    assert adaptor.stop()
    eventually(lambda: robot.closed == 1, what="it has left the network")
    robot.arrives = [("odom", odometry(9.0, 9.9, 0.4, math.pi))]
    assert adaptor.start([]) and at(adaptor) == (2.5, 3.2, round(math.pi / 2, 6))
    adaptor.stop()
    robot.arrives = [("odom", odometry(0.1, 0.0, 0.0, 0.0))]
    assert adaptor.start([]) and at(adaptor) == (2.5, 3.2, round(math.pi / 2, 6))
    for first, wanted in ((["--pose=7,8,0"], (7.0, 8.0, 0.0)), ([], (4.0, 4.0, 0.0))):
        robot = Robot(monkeypatch, ("odom", odometry(1.0, 10.0, 0.0, 1.0)))
        again = Ros2Adaptor("A", lambda: (2.0, 3.0, 0.0), last_pose=(4.0, 4.0, 0.0))
        assert again.start(first) and at(again) == wanted


def test_velocities_end_with_their_time_and_a_standing_robot_is_left_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, ("odom", odometry(1.0, 0.0, 0.0, 0.0)))
    adaptor = Ros2Adaptor("A", lambda: (0.0, 0.0, 0.0))
    adaptor.start([])
    (look,) = robot.timers
    stand, drive = ActorCommand(), ActorCommand((0.3, 0.1, 0.0))
    for command in (stand, drive, drive, stand, stand):
        assert adaptor.write(command)
    look()
    assert robot.published == [drive.velocity, drive.velocity, stand.velocity]
    adaptor.write(ActorCommand(drive.velocity, valid_s=-1.0))
    look(), look()
    adaptor.write(drive)
    look()
    adaptor.stop()
    assert robot.published[3:] == [drive.velocity, stand.velocity, drive.velocity, stand.velocity]
    adaptor.start([])
    monkeypatch.setattr(module, "SILENT_S", -1.0)
    with pytest.raises(RobotLost, match=r"its odometry has been silent for 0\.\d s"):
        adaptor.read(RobotState())


def test_nothing_is_published_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, ("odom", odometry(1.0, 0.0, 0.0, 0.0)))
    adaptor = Ros2Adaptor("A", lambda: (0.0, 0.0, 0.0))

    def publish(velocity: Velocity) -> None:
        if any(velocity):
            stopping.start()
            stopping.join(0.2)  # as far as it gets
        robot.published.append(velocity)

    monkeypatch.setattr(module, "_velocities", lambda *topic: (publish, lambda: None))
    stopping = threading.Thread(target=adaptor.stop)
    adaptor.start([])
    adaptor.write(ActorCommand((0.3, 0.0, 0.0)))
    stopping.join(20.0)
    assert robot.published == [(0.3, 0.0, 0.0), ZERO_VELOCITY]
    eventually(lambda: robot.closed == 1, what="it has left the network")
    assert not adaptor.write(ActorCommand((0.3, 0.0, 0.0)))
    robot.timers[0]()
    assert len(robot.published) == 2


def test_what_is_missing_or_wrong_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(monkeypatch, ("r1/scan", scan([1.0] * 20)))
    adaptor = Ros2Adaptor("A", lambda: (0.0, 0.0, 0.0), start_limit_s=0.1)
    with pytest.raises(
        RobotLost, match=r"nothing came on odom, scan \(step: 20 rays .*\) within 0.1 s in domain 5, na"
    ):
        adaptor.start(["--scan", "scan", "--namespace", "r1"])
    assert robot.closed == 1 and not adaptor.read(RobotState())

    def fail(domain: int | None, name: str) -> None:
        raise ServiceError("ROS 2 is not installed in this Python")

    monkeypatch.setattr(module, "ros_node", fail)
    with pytest.raises(AdaptorFailed, match="ROS 2 is not installed"):
        adaptor.start([])
    for wrong in (["--scan=a@1,2"], ["--scan=a", "--scan=a"], ["--pose=1,2,inf"], ["--domain", "x"], ["--speed", "1"]):
        with pytest.raises(AdaptorFailed, match="the adaptor's arguments"):
            adaptor.start(wrong)


def test_scans_are_a_robots_senses(monkeypatch: pytest.MonkeyPatch) -> None:
    lasers = Lasers({"front": Mount(0.2, 0.0, 0.0), "/back": Mount(-0.2, 0.0, math.pi)})
    assert lasers.missing == ["front", "/back"]
    front, back = lasers.receivers().values()
    front(scan([1.0, math.inf, math.nan]))
    back(scan([1.0, 2.0, 3.0, 4.0], angle_min=0.5, angle_increment=-0.25))
    assert lasers.missing == []
    first, second = lasers.sensors
    assert (first.name, first.mount, second.name) == ("laser", Mount(0.2, 0.0, 0.0), "laser_2")
    assert np.allclose(second.spec.fan.angles, [-0.25, 0.0, 0.25, 0.5]), "upside down"
    assert lasers.ranges("laser_2").distances.tolist() == [4.0, 3.0, 2.0, 1.0]
    assert (lasers.ranges("laser").time, lasers.ranges("laser").distances.tolist()) == (7.5, [1.0, 6.0, 6.0])
    for sent, understood in (
        ([-math.inf, 0.0, 9.0], [0.2, 6.0, 6.0]),
        ([2.0], [2.0, 6.0, 6.0]),
        ([2.0] * 9, [2.0] * 3),
    ):
        front(scan(sent))
        assert lasers.ranges("laser").distances.tolist() == understood
    assert lasers.readings() == ()
    with pytest.raises(UnknownSensor, match="laser_3"):
        lasers.ranges("laser_3")
    monkeypatch.setattr(lasers_module, "FROZEN_S", -1.0)
    with pytest.raises(AdaptorFailed, match="laser has measured nothing for"):
        lasers.ranges("laser")

"""Reports of joint angles: when they have changed, and again after a failure."""

from __future__ import annotations

import numpy as np

from robocorba.errors.robots import RobotLost
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.posture_report import MIN_CHANGE_RAD, REFRESH_S, PostureReport
from tests.clock import Clock


class Robot:
    """A robot whose reports a test reads."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.joints = np.zeros(3)
        self.is_away = False
        self.reported: list[list[float]] = []
        self.report = PostureReport(self.read, self.receive, self.clock)

    def read(self) -> Floats:
        return self.joints

    def receive(self, joints: Floats) -> None:
        if self.is_away:
            raise RobotLost("nobody answers")
        self.reported.append(joints.tolist())

    def update(self) -> int:
        """The number of reports by an update a tenth of a second later."""
        self.clock.now += 0.1
        before = len(self.reported)
        self.report.update()
        return len(self.reported) - before


def test_changed_angles_are_reported_and_repeated_for_a_server_that_restarted_or_was_away() -> None:
    robot = Robot()
    assert [robot.update() for _ in range(3)] == [1, 0, 0]
    robot.joints = np.array([0.0, 2 * MIN_CHANGE_RAD, 0.0])
    assert [robot.update() for _ in range(2)] == [1, 0]
    robot.joints = robot.joints + MIN_CHANGE_RAD / 2
    assert robot.update() == 0
    assert robot.reported[-1] == [0.0, 2 * MIN_CHANGE_RAD, 0.0]
    for _ in range(10):
        robot.joints = robot.joints + MIN_CHANGE_RAD / 4
        robot.update()
    assert len(robot.reported) == 5
    for joints in ([], [0.0, float("nan"), 0.0]):
        robot.joints = np.array(joints)
        assert robot.update() == 0
    robot = Robot()
    robot.update()
    robot.clock.now += REFRESH_S
    assert robot.update() == 1
    robot.joints = np.ones(3)
    robot.is_away = True
    assert robot.update() == 0  # it disturbs nobody
    robot.is_away, robot.joints = False, np.zeros(3)  # as before the failure
    assert [robot.update() for _ in range(2)] == [1, 0]

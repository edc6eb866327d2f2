"""A carrier follows its leader's orders, keeps its place beside the body, and brings one back that was moved."""

from __future__ import annotations

import math

import pytest

from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.spatial.frames import into, out_of, turned
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.missions.carry_control import (
    GOAL_M,
    GOAL_RAD,
    MAX_ERROR_M,
    MAX_MOVED_M,
    RETURN_SPEED_M_S,
    UNKNOWN_AFTER_S,
    CarryMotion,
)
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.trajectory import Trajectory
from robocorba.robot.motion.motion import MotionCommand
from robocorba.robot.motion.robot_state import RobotState

#: Control interval [s].
CYCLE_S = 0.02
#: Where the carrier is planned, in the frame of the body.
PLACE = (-1.0, 0.2, 0.0)


class Clock(LeaderClock):
    """The leader's clock, which the test sets [s]."""

    time = 100.0

    def now(self) -> float:
        return self.time


class Carrier:
    """A base without inertia that holds a body at a grip, beside a trajectory that stands at its middle."""

    def __init__(self) -> None:
        self.clock, self.progress = Clock(), CarryProgress()
        self.trajectory = Trajectory([(0.0, 0.0, 0.0), (4.0, 1.0, 1.0)], [PLACE])
        self.middle_s = self.trajectory.duration / 2
        self.motion = CarryMotion(self.trajectory, PLACE, self.progress, self.clock, lambda: 0.0)
        (self.x, self.y, self.heading), _ = self.trajectory.carrier(self.middle_s, PLACE)
        self.max_speed_m_s, self.began = 0.0, self.clock.time
        self.progress.hold(self.middle_s)
        self.order(0.0)

    def order(self, rate: float) -> None:
        """The leader's order for the trajectory, from now on."""
        self.progress.follow(self.clock.time, self.middle_s, rate, self.clock.time)

    def put(self, body: Pose2D, place: Pose2D) -> None:
        """The base holds a body with this pose at a place that is known from now on."""
        self.x, self.y = out_of(place[0], place[1], body)
        self.heading = body[2] + place[2]
        self.motion.place = place

    @property
    def body(self) -> Pose2D:
        """Of the body in the base's hands."""
        place = self.motion.place
        return *out_of(*into(0.0, 0.0, place), (self.x, self.y, self.heading)), self.heading - place[2]

    def run(self, cycles: int, rate: float = 0.0) -> MotionCommand | None:
        """Follow the commands, while the leader orders `rate`."""
        since, command = self.clock.time, None
        for _ in range(cycles):
            self.progress.follow(since, self.middle_s, rate, self.clock.time)
            state = RobotState(self.clock.time, self.x, self.y, self.heading)
            command = self.motion.command(state, self.clock.time - self.began)
            if command is None:
                return None
            ahead, left, turn = command[0]
            dx, dy = turned(ahead, left, self.heading)
            self.max_speed_m_s = max(self.max_speed_m_s, math.hypot(dx, dy))
            self.x, self.y = self.x + dx * CYCLE_S, self.y + dy * CYCLE_S
            self.heading += turn * CYCLE_S
            self.clock.time += CYCLE_S
        return command


@pytest.mark.parametrize(
    "deviation", [(0.05, -0.05, 0.05), (0.0, 0.0, 0.5), (0.3, 0.2, -0.3), (-0.4, 0.5, 0.2)], ids=str
)
def test_a_body_that_was_moved_is_brought_back_to_its_path(deviation: Pose2D) -> None:
    """As after the death of a carrier whose hands the body has turned around."""
    carrier = Carrier()
    planned, _ = carrier.trajectory.at(carrier.middle_s)
    x, y, heading = (a + b for a, b in zip(planned, deviation, strict=True))
    carrier.put((x, y, heading), (PLACE[0] + 0.02, PLACE[1] - 0.03, PLACE[2] + 0.1))
    carrier.run(1)
    assert carrier.motion.error_m > GOAL_M  # so the leader waits
    assert carrier.body == pytest.approx((x, y, heading), abs=0.01)  # it does not jump
    carrier.run(1000)
    assert carrier.body == pytest.approx(planned, abs=0.005)
    assert carrier.motion.error_m < GOAL_M
    assert carrier.max_speed_m_s < 1.2 * RETURN_SPEED_M_S
    assert carrier.run(2000, rate=1.0) is None
    x, y, heading = carrier.trajectory.goal
    assert carrier.body[:2] == pytest.approx((x, y), abs=GOAL_M)
    assert carrier.body[2] == pytest.approx(heading, abs=GOAL_RAD)


def test_a_body_that_is_far_off_its_path_and_a_carrier_off_its_place_end_the_carry() -> None:
    carrier = Carrier()
    carrier.run(1)
    carrier.x -= MAX_ERROR_M + 0.01
    with pytest.raises(MotionFailed, match=r"0.26 m off its place beside the object; the limit is 0.25 m"):
        carrier.run(1)
    carrier = Carrier()
    (x, y, heading), _ = carrier.trajectory.at(carrier.middle_s)
    carrier.put((x - MAX_MOVED_M - 0.01, y, heading), (PLACE[0], PLACE[1], PLACE[2]))
    with pytest.raises(MotionFailed, match=r"the object is 0.81 m off its path; the limit is 0.8 m"):
        carrier.run(1)


# ---- by the orders of its leader ----


def test_a_carrier_whose_state_is_unknown_falls_behind() -> None:
    """So the leader stops the carry before the carrier is too far from its place to go on."""
    clock, progress = Clock(), CarryProgress()
    progress.hold(1.0)
    trajectory = Trajectory([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)], [(-1.0, 0.0, 0.0)])
    motion = CarryMotion(trajectory, (-1.0, 0.0, 0.0), progress, clock, lambda: 0.0)

    def wait(seconds: float) -> None:
        for _ in range(round(seconds / 0.1) + 1):
            clock.time += seconds / (round(seconds / 0.1) + 1)
            progress.follow(since=100.0, trajectory_s=1.0, rate=1.0, sent=clock.time)

    assert motion.error_m == 0.0
    wait(0.0)
    (x, y, heading), _ = trajectory.carrier(1.0, (-1.0, 0.0, 0.0))
    assert motion.command(RobotState(0.0, x, y, heading), 0.0)
    wait(UNKNOWN_AFTER_S / 2)
    assert motion.error_m == pytest.approx(0.0, abs=1e-9)
    wait(1.0)
    assert motion.error_m > LeaderPolicy().stop_error_m
    (x, y, heading), _ = trajectory.carrier(trajectory.duration, (-1.0, 0.0, 0.0))
    wait(trajectory.duration)
    assert motion.command(RobotState(0.0, x, y, heading), 0.0) is None
    wait(10.0)
    assert motion.error_m == pytest.approx(0.0, abs=1e-9)  # it has arrived

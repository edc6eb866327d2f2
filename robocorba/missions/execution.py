"""The execution layer: how a robot does each step of its SubPlan."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable
from functools import singledispatchmethod
from typing import Any

from robocorba.control.robot import Robot
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MotionFailed, Unreachable
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import ARM, GRIP, LUMBAR, OPEN_RAD, SHUT_RAD, Side
from robocorba.kinematics.tasks import POSTURES, grip_table
from robocorba.maps.polygons import FloorArea
from robocorba.missions import subplan
from robocorba.missions.carrying import CarryMotion
from robocorba.missions.clock import LeaderClock
from robocorba.missions.rhythm import Rhythm
from robocorba.missions.trajectory import Trajectory
from robocorba.simulation.elevator import Phase
from robocorba.spatial.frames import Frame, into, out_of

#: Slow near others, m/s; and how far apart two hands hold an edge, m.
NEAR_SPEED, HANDS_APART_M = 0.2, 0.4
#: An object that is farther from where it was when the plan was made has to be planned for anew, m and rad.
MOVED_M, MOVED_RAD = 0.03, math.radians(3)
#: Where an object is in the frame of the robot, x, y and heading; None where nobody knows it.
Places = Callable[[str], Frame | None]

_log = logging.getLogger(__name__)


class Performer:
    """Does steps on a robot. where: as far as it is known, what is as old of both."""

    def __init__(self, robot: Robot, rhythm: Rhythm, clock: LeaderClock, where: Places) -> None:
        self._robot, self._rhythm, self._clock, self._where = robot, rhythm, clock, where
        self.carry: CarryMotion | None = None
        #: Where the grip is in the frame of the object, and ahead of the base, m.
        self._grip_in_thing: tuple[float, float] | None = None
        self._hand_m: tuple[float, float] = (0.0, 0.0)
        self._thing = ""
        #: Areas that we have reserved, one a floor of the way.
        self._areas: tuple[FloorArea, ...] = ()

    @property
    def error_m(self) -> float:
        """How far the robot is from where it shall be while it carries."""
        return self.carry.error_m if self.carry else 0.0

    @singledispatchmethod
    def do(self, step: Any) -> None:
        """A step, to its end. Raises RobotError, SimulationError, PathError."""
        raise NotImplementedError(type(step).__name__)

    @do.register
    def _(self, step: subplan.Wait) -> None:
        pass

    @do.register
    def _(self, step: subplan.Reserve) -> None:
        session = self._robot.session
        session.release_areas()  # of a mission before
        self._areas = step.areas
        session.reserve(step.areas, step.hold_s)

        def is_ours() -> bool:
            found = session.reservation()
            if found is None:
                raise MotionFailed("the areas of the way were reserved, and are not any more")
            return found.granted

        if not self._robot.wait(step.limit_s, is_ours):
            raise MotionFailed(f"others had not gone by after {step.limit_s:g} s")

    @do.register
    def _(self, step: subplan.Gather) -> None:
        self._posture("tuck")
        self._robot.drive_path(step.floor, step.x, step.y, step.heading, looks_around=True)

    @do.register
    def _(self, step: subplan.Approach) -> None:
        self._robot.drive_to(step.x, step.y, step.heading, NEAR_SPEED)

    @do.register
    def _(self, step: subplan.TakeHold) -> None:
        self._check_place(step)
        state = self._robot.controller.state
        ahead_m = math.dist((state.x, state.y), (step.x, step.y))
        self._hands_at(ahead_m, step.height_m)
        self._robot.grip(tuple(Side), SHUT_RAD, 5.0)
        self._robot.hold(step.thing, step.x, step.y)
        self._thing = step.thing
        self._remember_grip(step)

    @do.register
    def _(self, step: subplan.Carry) -> None:
        trajectory = Trajectory.from_rows(step.rows)
        self.carry = CarryMotion(trajectory, step.place, self._rhythm, self._clock, self._slipped_m)
        self._robot.move(self.carry)

    @do.register
    def _(self, step: subplan.CallCabin) -> None:
        self._robot.call_elevator(step.elevator, step.destination, step.party, step.size)

    @do.register
    def _(self, step: subplan.Ride) -> None:
        otherwise = f"{step.elevator} did not arrive at {step.destination}"
        self._robot.wait_for_ride(Phase.ALIGHTING, otherwise, self._check_hold)
        if self._areas:
            self._areas = self._areas[1:]
            self._robot.session.keep_areas(self._areas)

    @do.register
    def _(self, step: subplan.PutDown) -> None:
        self.let_go()
        self._robot.grip(tuple(Side), OPEN_RAD)

    @do.register
    def _(self, step: subplan.BackOff) -> None:
        self._robot.drive_by(-step.distance_m, 0.0, 0.0, NEAR_SPEED, as_far_as_free=True)
        self._posture("tuck")

    @do.register
    def _(self, step: subplan.Reach) -> None:
        side = Side(step.hand)
        joints = self._robot.kinematics.solve(side, HandPose(*step.pose), self._robot.joints, lumbar_helps=True)
        self._robot.joints_along([joints])

    @do.register
    def _(self, step: subplan.Grip) -> None:
        self._robot.grip((Side(step.hand),), SHUT_RAD if step.closes else OPEN_RAD)

    def let_go(self) -> None:
        """Of what is held in the building; also of a robot that is stopped."""
        self._thing = ""
        self._robot.session.release()

    def give_back(self) -> None:
        """What we have reserved of the building, however the mission ended."""
        if self._areas:
            self._areas = ()
            with contextlib.suppress(RoboCorbaError):
                self._robot.session.release_areas()

    def end_safely(self) -> None:
        """After a mission that was broken off: put down, step back, take the arms in, as far as it can be done."""
        with contextlib.suppress(RoboCorbaError):
            was_holding = bool(self._robot.session.state().holding)
            self.let_go()
            self._robot.session.give_up_elevator()
            if was_holding:
                self._robot.grip(tuple(Side), OPEN_RAD)
                with contextlib.suppress(MotionFailed):
                    self._robot.drive_by(-0.2, 0.0, 0.0, NEAR_SPEED, as_far_as_free=True)
            self._posture("tuck")

    def _posture(self, name: str) -> None:
        joints = self._robot.joints
        for side in Side:
            joints[ARM[side]] = POSTURES[name]
        joints[LUMBAR] = 0.0
        self._robot.joints_along([joints])

    def _hands_at(self, ahead_m: float, height_m: float) -> None:
        """Both hands level at an edge; as near to it as they get where they can't reach it so."""
        joints = self._robot.joints
        joints[[GRIP[side] for side in Side]] = OPEN_RAD
        hands = grip_table(height_m, ahead_m, HANDS_APART_M)
        try:
            joints = self._robot.kinematics.solve_both(*hands, joints, lumbar_helps=True)
        except Unreachable as too_far:
            _log.warning("the hands don't reach the edge at %.2f m: %s", height_m, too_far)
            for side in Side:
                joints[ARM[side]] = POSTURES["reach"]
        self._robot.joints_along([joints])

    def _remember_grip(self, step: subplan.TakeHold) -> None:
        """Where the object is held, in its own frame and in the robot's: they must stay together."""
        at, state = self._where(step.thing), self._robot.controller.state
        self._hand_m = into(step.x, step.y, (state.x, state.y, state.heading))
        self._grip_in_thing = into(*self._hand_m, at) if at else None

    def _check_place(self, step: subplan.TakeHold) -> None:
        """Raise MotionFailed where the object is known not to stand where the plan has it any more."""
        seen, state = self._where(step.thing), self._robot.controller.state
        if seen is None:
            return
        x, y = out_of(seen[0], seen[1], (state.x, state.y, state.heading))
        turned = math.remainder(seen[2] + state.heading - step.at[2], math.tau)
        if math.dist((x, y), step.at[:2]) > MOVED_M or abs(turned) > MOVED_RAD:
            raise MotionFailed(f"{step.thing} was moved to ({x:.2f}, {y:.2f}) meanwhile")

    def _slipped_m(self) -> float:
        """How far the object is from the hand that holds it, by what is known of it now. Raises MotionFailed."""
        self._check_hold()
        at = self._where(self._thing) if self._thing else None
        if at is None or self._grip_in_thing is None:
            return 0.0
        return math.dist(out_of(*self._grip_in_thing, at), self._hand_m)

    def _check_hold(self) -> None:
        """Raise MotionFailed where the building knows better what the hands hold."""
        if self._thing and self._robot.session.latest.holding != self._thing:
            raise MotionFailed(f"lost its hold of {self._thing}")


def seen_from(thing: Frame, robot: Frame) -> Frame:
    """A pose of the building in the frame of a robot."""
    return *into(thing[0], thing[1], robot), math.remainder(thing[2] - robot[2], math.tau)

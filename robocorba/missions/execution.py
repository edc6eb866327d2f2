"""The execution layer: carries out the steps of a SubPlan on a robot."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable
from functools import singledispatchmethod
from typing import Any

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MotionFailed, Unreachable
from robocorba.errors.simulation import InvalidReservation
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.frames import Frame, into, out_of
from robocorba.missions import subplan
from robocorba.missions.carry_control import CarryMotion
from robocorba.missions.carry_progress import CarryProgress
from robocorba.missions.clock import LeaderClock
from robocorba.missions.trajectory import Trajectory
from robocorba.robot.elevator_rides import WhileRiding
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, GRIP, LUMBAR, OPEN_RAD, SHUT_RAD, Side
from robocorba.robot.kinematics.tasks import POSTURES, grip_table
from robocorba.robot.robot import Robot
from robocorba.robot.session import once_back
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.physics import HANDS_APART_M

#: Speed limit near the object and other robots.
NEAR_SPEED_M_S = 0.2
#: Distance that a robot backs off from the object after an abort [m].
ABORT_BACK_M = 0.2
#: The pose of an object in the robot's frame (x, y, heading), None if unknown.
ObjectLocator = Callable[[str], Frame | None]

_log = logging.getLogger(__name__)


class StepExecutor:
    """Does steps on a robot. locate: must take robot and object from the same simulation step. driving_posture: of the
    arms, a name in POSTURES."""

    def __init__(
        self,
        robot: Robot,
        progress: CarryProgress,
        clock: LeaderClock,
        locate: ObjectLocator,
        driving_posture: str = "tuck",
    ) -> None:
        self._robot, self._progress, self._clock, self._locate = robot, progress, clock, locate
        self._driving_posture = driving_posture
        self.carry: CarryMotion | None = None
        #: The grip point in the frames of the object and of the robot [m].
        self._grip_in_object: tuple[float, float] | None = None
        self._hand_m = (0.0, 0.0)
        #: Its pose in the frame of the carried body, if that is not its place in the plan any more.
        self._place: Frame | None = None
        #: What it holds; empty for nothing.
        self.held = ""
        #: The elevator that it drives into next; empty for none, and once the ride has begun.
        self._boards = ""
        #: Reserved areas, one for each remaining floor of the path.
        self._areas: tuple[FloorArea, ...] = ()

    @property
    def error_m(self) -> float:
        """Distance of the base from its setpoint while carrying [m]."""
        return self.carry.error_m if self.carry else 0.0

    @singledispatchmethod
    def execute(self, step: Any) -> None:
        """Do a step to its end. Raises RobotError, SimulationError, PathError."""
        raise NotImplementedError(type(step).__name__)

    @execute.register
    def _idle(self, step: subplan.Idle) -> None:
        pass

    @execute.register
    def _reserve(self, step: subplan.Reserve) -> None:
        session = self._robot.session
        self._areas = step.areas
        try:
            session.keep_areas(step.areas)  # the leader has them already
        except InvalidReservation:
            session.release_areas()
            session.reserve(step.areas, step.hold_s)

        def is_granted() -> bool:
            found = session.reservation()
            if found is None:
                raise MotionFailed("the reservation of the path's areas was lost")
            return found.granted

        with self._robot.execution.awaiting(lambda: "reserved areas"):
            is_reserved = self._robot.wait(step.limit_s, is_granted)
        if not is_reserved:
            raise MotionFailed(f"the path's areas were not granted within {step.limit_s:g} s")

    @execute.register
    def _gather(self, step: subplan.Gather) -> None:
        self._tuck_arms()
        self._robot.drive_path(step.floor, step.x, step.y, step.heading, around_obstacles=True)

    @execute.register
    def _approach(self, step: subplan.Approach) -> None:
        self._robot.drive_to(step.x, step.y, step.heading, NEAR_SPEED_M_S)

    @execute.register
    def _take_hold(self, step: subplan.TakeHold) -> None:
        self._check_place(step)
        state = self._robot.controller.state
        self._hands_at(math.dist((state.x, state.y), (step.x, step.y)), step.height_m)
        self._robot.grip(tuple(Side), SHUT_RAD, 5.0)
        self._robot.hold(step.thing, step.x, step.y)
        self.held = step.thing
        self._remember_grip(step)

    @execute.register
    def _carry(self, step: subplan.Carry) -> None:
        trajectory = Trajectory.from_rows(step.rows)
        self.carry = CarryMotion(trajectory, step.place, self._progress, self._clock, self._slip_m)
        if self._place:
            self.carry.place = self._place
        session = self._robot.session
        self._robot.move(WhileRiding(self.carry, session, self._boards) if self._boards else self.carry)

    @execute.register
    def _call_cabin(self, step: subplan.CallCabin) -> None:
        self._robot.call_elevator(step.elevator, step.destination, step.party, step.size, step.boarding_s)
        self._boards = step.elevator

    @execute.register
    def _ride(self, step: subplan.Ride) -> None:
        self._boards, otherwise = "", f"{step.elevator} did not arrive at {step.destination}"
        self._robot.wait_for_ride(RidePhase.ALIGHTING, otherwise, check=self._check_hold)
        if self._areas:
            self._areas = self._areas[1:]
            try:
                self._robot.session.keep_areas(self._areas)
            except InvalidReservation as error:
                if error.field == "robot":
                    raise
                _log.info("all areas are kept, since a floor has another name now: %s", error)

    @execute.register
    def _put_down(self, step: subplan.PutDown) -> None:
        self.let_go()
        self._robot.grip(tuple(Side), OPEN_RAD)

    @execute.register
    def _back_off(self, step: subplan.BackOff) -> None:
        self._robot.drive_by(-step.distance_m, 0.0, 0.0, NEAR_SPEED_M_S, until_blocked=True)
        self._tuck_arms()

    @execute.register
    def _reach(self, step: subplan.Reach) -> None:
        side = Side(step.hand)
        joints = self._robot.kinematics.solve({side: HandPose(*step.pose)}, self._robot.joints, use_lumbar=True)
        self._robot.move_joints_along([joints])

    @execute.register
    def _grip(self, step: subplan.Grip) -> None:
        self._robot.grip((Side(step.hand),), SHUT_RAD if step.closes else OPEN_RAD)

    def let_go(self) -> None:
        """Release the held object in the simulation; works on a stopped robot, too."""
        self.held = ""
        self._robot.session.release()

    def measure_place(self) -> None:
        """After another carrier has let go: carry the object from where it is held now. Its hands may have given way a
        little."""
        if self.held and (pose := self._locate(self.held)):
            self._place = *into(0.0, 0.0, pose), -pose[2]
            if self.carry:
                self.carry.place = self._place

    def reserve_again(self, step: subplan.Reserve, floors_left: int, is_reserved: bool) -> None:
        """Reserve the last areas of a step in place of a robot that is gone, without waiting for them. is_reserved:
        whether its reservation has been taken over. Raises SimulationError, RobotLost."""
        areas = step.areas[-floors_left:]
        if not is_reserved:
            self._robot.session.reserve(areas, step.hold_s)
        self._areas = areas

    def release_reservations(self) -> None:
        """Release all reserved areas."""
        if self._areas:
            self._areas = ()
            with contextlib.suppress(RoboCorbaError):
                self._robot.session.release_areas()

    def end_safely(self) -> None:
        """After an abort: put down the object, back off and tuck the arms, as far as possible. Waits for a simulation
        server that is away, since the object would stay in the hands."""
        session = self._robot.session
        with contextlib.suppress(RoboCorbaError):
            was_holding = bool(once_back(session.state).holding)
            once_back(self.let_go)
            once_back(session.cancel_elevator)
            if was_holding:
                self._robot.grip(tuple(Side), OPEN_RAD)
                with contextlib.suppress(MotionFailed):
                    self._robot.drive_by(-ABORT_BACK_M, 0.0, 0.0, NEAR_SPEED_M_S, until_blocked=True)
            self._tuck_arms()

    def _tuck_arms(self) -> None:
        joints = self._robot.joints
        for side in Side:
            joints[ARM[side]] = POSTURES[self._driving_posture]
        joints[LUMBAR] = 0.0
        self._robot.move_joints_along([joints])

    def _hands_at(self, ahead_m: float, height_m: float) -> None:
        """Bring both hands level to an edge; if it is out of reach, into the posture `reach`."""
        joints = self._robot.joints
        joints[[GRIP[side] for side in Side]] = OPEN_RAD
        hands = grip_table(height_m, ahead_m, HANDS_APART_M)
        try:
            joints = self._robot.kinematics.solve(hands, joints, use_lumbar=True)
        except Unreachable as error:
            _log.warning("the hands cannot reach the edge at height %.2f m: %s", height_m, error)
            for side in Side:
                joints[ARM[side]] = POSTURES["reach"]
        self._robot.move_joints_along([joints])

    def _remember_grip(self, step: subplan.TakeHold) -> None:
        """Store the grip point in the frames of the object and of the robot; the two must stay together."""
        pose, state = self._locate(step.thing), self._robot.controller.state
        self._hand_m = into(step.x, step.y, (state.x, state.y, state.heading))
        self._grip_in_object = into(*self._hand_m, pose) if pose else None

    def _check_place(self, step: subplan.TakeHold) -> None:
        """Raise MotionFailed if the object has moved from its pose in the plan, by more than 3 cm or 3 degrees."""
        seen, state = self._locate(step.thing), self._robot.controller.state
        if seen is None:
            return
        x, y = out_of(seen[0], seen[1], (state.x, state.y, state.heading))
        turned = math.remainder(seen[2] + state.heading - step.at[2], math.tau)
        if math.dist((x, y), step.at[:2]) > 0.03 or abs(turned) > math.radians(3):
            raise MotionFailed(f"{step.thing} was moved to ({x:.2f}, {y:.2f}) after planning")

    def _slip_m(self) -> float:
        """Current distance of the grip point from the hand [m]. Raises MotionFailed."""
        self._check_hold()
        pose = self._locate(self.held) if self.held else None
        if pose is None or self._grip_in_object is None:
            return 0.0
        return math.dist(out_of(*self._grip_in_object, pose), self._hand_m)

    def _check_hold(self) -> None:
        """Raise MotionFailed if the simulation no longer has the robot hold the object."""
        if self.held and not self._robot.session.latest.holding:  # by whatever name, which an edit may have changed
            raise MotionFailed(f"lost its hold of {self.held}")


def pose_in_robot_frame(pose: Frame, robot: Frame) -> Frame:
    """A pose of the building's frame in the frame of a robot."""
    return *into(pose[0], pose[1], robot), math.remainder(pose[2] - robot[2], math.tau)

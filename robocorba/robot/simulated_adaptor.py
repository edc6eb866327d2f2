"""The adaptor of the virtual SmartPal: its body at the simulation server, and the virtual controller of its joints."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.sensing import SensorBehind
from robocorba.errors.simulation import SimulationError
from robocorba.robot.adaptor import SIMULATION_SERVER, RobotAdaptor
from robocorba.robot.kinematics.smartpal import JOINT_ACCELERATION, JOINT_LOWER, JOINT_SPEED, JOINT_UPPER, JOINTS
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.senses import Ranges, RangeSensor, Reading, Senses, usual_sensors
from robocorba.robot.session import BuildingSession
from robocorba.robot.virtual_controller import VirtualController


def adaptor(context: AdaptorContext) -> RobotAdaptor:
    """The entry point `simulated` of the adaptors."""
    return SimulatedAdaptor(context.session)


class SimulatedSenses(Senses):
    """The virtual sensors of a robot that is its body in the building, and the body's collisions as its bumper."""

    def __init__(self, session: BuildingSession) -> None:
        self._session, self._sensors = session, usual_sensors()

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return self._sensors

    def ranges(self, name: str) -> Ranges:
        sensor, now = self.sensor(name), self._session.latest
        try:
            return Ranges(now.time, self._session.scan(now.at, sensor.mount, sensor.spec))
        except (SensorBehind, UnknownFloor) as error:
            raise AdaptorFailed(str(error)) from None

    def readings(self) -> Sequence[Reading]:
        now = self._session.latest
        return [Reading("bumper", "contacts", now.time, float(now.collisions))]


class SimulatedAdaptor(RobotAdaptor):
    """The joints follow the simulation's time, also when it runs faster or slower or is paused."""

    is_in_building = True
    waits_for = SIMULATION_SERVER

    def __init__(self, session: BuildingSession) -> None:
        self._session = session
        self.senses = SimulatedSenses(session)
        self._is_started = False
        self._lock = threading.Lock()
        self._time = 0.0
        self._joints = VirtualController(
            np.zeros(len(JOINTS)), JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, JOINT_ACCELERATION
        )

    def start(self, argv: Sequence[str]) -> bool:
        if self._is_started:
            return False
        if argv:
            raise AdaptorFailed(f"the virtual robot takes no arguments, such as {argv[0][:80]!r}")
        try:
            self._session.log_on()
        except (SimulationError, UnknownFloor) as error:
            raise AdaptorFailed(f"the simulation server refuses the robot: {error}") from None
        self._time = self._session.state().time
        self._is_started = True
        return True

    def stop(self) -> bool:
        if not self._is_started:
            return False
        self._is_started = False
        with self._lock:
            self._joints.stop()
        self._session.brake()
        return True

    def read(self, state: RobotState) -> bool:
        if not self._is_started:
            return False
        seen = self._session.state()
        state.time, state.velocity = seen.time, seen.velocity
        state.x, state.y, state.heading = seen.at.x, seen.at.y, seen.at.heading
        with self._lock:
            self._follow(seen.time)
            state.joints, state.joint_velocities = self._joints.joints.copy(), self._joints.velocities.copy()
        return True

    def write(self, command: ActorCommand) -> bool:
        if not self._is_started:
            return False
        if len(command.joints):
            with self._lock:
                self._joints.command(command.joints, command.joint_velocities, self._time + command.valid_s)
        self._session.command(command.velocity, command.valid_s)
        if not self._is_started:  # another thread has stopped the robot, perhaps before this command arrived
            self._session.brake()
        return self._is_started

    def _follow(self, now: float) -> None:
        """Move the joints by steps of at most 0.01 s; after a server that did not answer for long, by 0.2 s in all."""
        passed = max(0.0, min(now - self._time, 0.2))  # the server may have restored an older state
        steps = int(np.ceil(passed / 0.01))
        for step in range(steps):
            self._joints.advance(now - passed + passed * (step + 1) / steps, passed / steps)
        self._time = now

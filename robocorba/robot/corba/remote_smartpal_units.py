"""Client of a SmartPal's units for the hardware adaptor. It converts between metres and radians, which RoboCorba uses,
and the robot's millimetres and degrees; no other client code converts units."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import numpy as np
from omniORB import CORBA

from robocorba.errors.robots import AdaptorFailed, RobotLost, UnitFailed
from robocorba.errors.services import NotBound, NotReachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame
from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.robot.corba.senses import RemoteSenses
from robocorba.robot.kinematics.smartpal import Side
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.senses import Senses
from robocorba.robot.smartpal_adaptor import SmartPalAdaptor
from robocorba.robot.smartpal_stand_in.codes import AxesState, MobilityState, ReturnCode
from robocorba.stubs import RoboCorba, YeRTUnitMobility, _GlobalIDL
from robocorba.system.settings import Address

#: Timeout of a call [s].
CALL_TIMEOUT_S = 0.3
_MM = 1000.0

#: By our name of a unit: its name in the root context of the robot's naming service, and its interface.
_BOUND = {
    "Mobility": ("Mobility.Unit", YeRTUnitMobility.mobility),
    "MnpR": ("MnpR", _GlobalIDL.ArmUnit),
    "MnpL": ("MnpL", _GlobalIDL.ArmUnit),
    "GripperR": ("GripperR", _GlobalIDL.GripperUnit),
    "GripperL": ("GripperL", _GlobalIDL.GripperUnit),
    "Lumbar": ("Lumbar", _GlobalIDL.LumbarUnit),
}
_ARMS = {Side.LEFT: "MnpL", Side.RIGHT: "MnpR"}
_GRIPPERS = {Side.LEFT: "GripperL", Side.RIGHT: "GripperR"}

#: States in which a unit is stopped and accepts commands, and others in which it accepts them.
_MOBILITY_STOPPED = {MobilityState.READY, MobilityState.CAUTION}
_AXES_STOPPED = {AxesState.READY, AxesState.CAUTION}
_MOBILITY_WORKS = {*_MOBILITY_STOPPED, MobilityState.BUSY}
_AXES_WORK = {*_AXES_STOPPED, AxesState.BUSY, AxesState.JOG_BUSY, AxesState.DIRECT_BUSY}
#: Meanings of an arm's return codes.
_REASONS: dict[int, str] = {
    ReturnCode.FAILED: "it failed",
    ReturnCode.WRONG_STATE: "not in this state",
    ReturnCode.OUT_OF_RANGE: "a value is out of range",
    ReturnCode.SERVO_OFF: "its servo is off",
    ReturnCode.QUEUE_FULL: "its motion queue is full",
    ReturnCode.TOO_FAST: "over its greatest velocity",
    ReturnCode.TOO_MUCH_ACCELERATION: "over its greatest acceleration",
    ReturnCode.OVERLOAD: "its load estimate",
    ReturnCode.COMMAND_QUEUE_FULL: "its command queue is full",
}


class RemoteSmartPalUnits:
    """The SmartPalUnits of the robot whose naming service listens at `naming`. Raises AdaptorFailed if a unit can't be
    resolved.

    Every method raises UnitFailed with the return or state code if a unit refuses, and AdaptorFailed if it does not
    answer within CALL_TIMEOUT_S. Thread-safe."""

    def __init__(self, orb: Orb, naming: Address) -> None:
        self._units: dict[str, Any] = {}
        for unit, (name, interface) in _BOUND.items():
            try:
                self._units[unit] = orb.resolve_in_other_naming_service(naming, name, interface, CALL_TIMEOUT_S)
            except NotReachable as error:
                raise AdaptorFailed(str(error)) from None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._units)

    # ---- all units ----

    def is_ready(self, unit: str) -> bool:
        """Whether the unit is stopped and accepts commands."""
        if unit == "Mobility":
            return self._state(unit)[0] in _MOBILITY_STOPPED
        if unit in _GRIPPERS.values():
            return bool(self._call(unit, "isServoOn")) and not self._alarms(unit)
        return self._state(unit)[0] in _AXES_STOPPED

    def make_ready(self, unit: str) -> None:
        """Clear the unit's alarms, switch its power and servo on. Refusals are ignored, since a unit may depend on one
        that is made ready later."""
        if unit == "Mobility":
            if self._state(unit)[0] == MobilityState.LOCKED:
                self._call(unit, "unlock")
            steps: Sequence[tuple[Any, ...]] = (("clearAlarm",), ("setPower", True), ("setServo", True))
        elif unit in _GRIPPERS.values():
            steps = (("clearAlarms",), ("servoOn",))
        else:
            steps = (("clearAlarms",), ("powerOn",), ("servoOn",))
        for step in steps:
            self._call(unit, *step)

    def check(self, unit: str) -> None:
        """Raise UnitFailed unless the unit accepts commands."""
        if unit in _GRIPPERS.values():
            if not self._call(unit, "isServoOn"):
                self._refuse(unit, ReturnCode.FAILED, "its servo is off")
            return
        state, text = self._state(unit)
        if state not in (_MOBILITY_WORKS if unit == "Mobility" else _AXES_WORK):
            self._refuse(unit, state, text)

    def stop(self, unit: str) -> None:
        self._order(unit, "stop")

    # ---- the base ----

    def pose(self) -> Frame:
        """x, y [m] and heading [rad] by odometry."""
        x, y, theta = self._position("Mobility", "getPosition")
        return x / _MM, y / _MM, math.radians(theta)

    def set_pose(self, x: float, y: float, heading: float) -> None:
        """Set the odometry to x, y [m] and heading [rad]."""
        self._order("Mobility", "setPosition", x * _MM, y * _MM, math.degrees(heading))

    def set_base_limits(self, speed: float, turn: float, acceleration: float, turn_acceleration: float) -> None:
        """[m/s], [rad/s], [m/s^2], [rad/s^2]."""
        self._order("Mobility", "setVelocity", speed * _MM, math.degrees(turn))
        self._order("Mobility", "setAcceleration", acceleration * _MM, math.degrees(turn_acceleration))

    def jog_base(self, ahead: float, left: float, turn: float) -> None:
        """ahead and left [m/s], turn [rad/s], in the base's frame."""
        self._order("Mobility", "moveJog", ahead * _MM, left * _MM, math.degrees(turn))

    # ---- the arms ----

    def set_jog_timeout(self, timeout_s: float) -> None:
        """Timeout of the base's and the arms' jogs."""
        for unit in ("Mobility", *_ARMS.values()):
            self._order(unit, "setJogTimeout", round(timeout_s * 1000))

    def set_arm_acceleration(self, time_s: float) -> None:
        """Time from standstill to full speed."""
        for unit in _ARMS.values():
            self._order(unit, "setJointAcceleration", round(time_s * 1000))

    def arm(self, side: Side) -> Floats:
        """Joint angles (7,) [rad]."""
        code, joints = self._call(_ARMS[side], "getFeedbackPos", _GlobalIDL.JOINT)
        if code != 0:
            self._refuse(_ARMS[side], code, _REASONS.get(code, ""))
        return np.radians(joints)

    def jog_arm(self, side: Side, velocities: Floats) -> None:
        """Joint velocities (7,) [rad/s]."""
        self._order(_ARMS[side], "moveJogJoint", np.degrees(velocities).tolist())

    # ---- lumbar and grippers ----

    def lumbar(self) -> Floats:
        """Joint angles (2,) [rad]."""
        return np.radians(self._position("Lumbar", "getFeedback"))

    def move_lumbar(self, lower: float, upper: float, speed: float, acceleration: float) -> None:
        """[rad], [rad/s], [rad/s^2]."""
        self._order("Lumbar", "move", *map(math.degrees, (lower, upper, speed, acceleration)))

    def grip(self, side: Side) -> float:
        """Angle [rad]; open is negative."""
        return math.radians(*self._position(_GRIPPERS[side], "getFeedback"))

    def move_grip(self, side: Side, position: float, speed: float, acceleration: float) -> None:
        """[rad], [rad/s], [rad/s^2]."""
        self._order(_GRIPPERS[side], "move", *map(math.degrees, (position, speed, acceleration)))

    # ---- calls ----

    def _call(self, unit: str, operation: str, *arguments: Any) -> Any:
        """Repeat a call that timed out because this process was paused: the unit may have answered. Every operation
        reads or sets values, so the repetition is harmless."""
        began = time.monotonic()
        try:
            return self._call_once(unit, operation, *arguments)
        except AdaptorFailed:
            # A call was late because of a pause if it exceeds its timeout by 0.05 s. After more than a second it is not
            # repeated: the robot must not continue an old motion.
            if not CALL_TIMEOUT_S + 0.05 < time.monotonic() - began < 1.0:
                raise
            return self._call_once(unit, operation, *arguments)

    def _call_once(self, unit: str, operation: str, *arguments: Any) -> Any:
        try:
            return getattr(self._units[unit], operation)(*arguments)
        except CORBA.SystemException as error:
            raise AdaptorFailed(f"{unit} does not answer ({describe(error)})") from None

    def _order(self, unit: str, operation: str, *arguments: Any) -> None:
        answer = self._call(unit, operation, *arguments)
        if isinstance(answer, bool):
            if not answer:
                self._refuse(unit, ReturnCode.FAILED, f"it refuses {operation}")
        elif answer not in (ReturnCode.OK, ReturnCode.SPEED_WARNING, ReturnCode.ACCELERATION_WARNING):
            self._refuse(unit, answer, f"it refuses {operation}: {_REASONS.get(answer, 'unknown return code')}")

    def _position(self, unit: str, operation: str) -> list[float]:
        done, *position = self._call(unit, operation)
        if not done:
            self._refuse(unit, ReturnCode.FAILED, "it does not report its position")
        return position

    def _state(self, unit: str) -> tuple[int, str]:
        _, state, text = self._call(unit, "getState")
        return state, text

    def _alarms(self, unit: str) -> list[Any]:
        """Those of its first four that are no warnings."""
        return [alarm for alarm in self._call(unit, "getActiveAlarm", 4)[2] if alarm.type != _GlobalIDL.WARNING]

    def _refuse(self, unit: str, code: int, reason: str) -> NoReturn:
        """Raise UnitFailed with the unit's alarms, or else with its state."""
        alarms = self._alarms(unit)
        if alarms:
            listed = ", ".join(f"alarm {alarm.code:#x} {alarm.description}" for alarm in alarms)
            raise UnitFailed(unit, int(code), f"{reason}; {listed}")
        if unit not in _GRIPPERS.values():
            reason = f"{reason}; it is {self._state(unit)[1]}"
        raise UnitFailed(unit, int(code), reason)


def adaptor(context: AdaptorContext) -> SmartPalAdaptor:
    """The entry point `smartpal` of the adaptors."""

    def body_pose() -> Frame:
        at = context.session.latest.at
        return at.x, at.y, at.heading

    last_pose = context.last_pose and context.last_pose[1:]
    return SmartPalAdaptor(units_at(context.orb), body_pose, senses_at(context.orb), last_pose=last_pose)


def units_at(orb: Orb) -> Callable[[str], RemoteSmartPalUnits]:
    """A function that resolves the units of the robot whose naming service listens at HOST:PORT; it raises
    InvalidSetting."""
    return lambda naming: RemoteSmartPalUnits(orb, Address.parse(naming, "--naming"))


def senses_at(orb: Orb) -> Callable[[str], Senses | None]:
    """A function that resolves what the robot whose naming service listens at HOST:PORT senses: `Sensors`, None if that
    is not bound. It raises AdaptorFailed, RobotLost."""

    def find(naming: str) -> Senses | None:
        interface = RoboCorba.RobotSensors
        try:
            found = orb.resolve_in_other_naming_service(Address.parse(naming), "Sensors", interface, CALL_TIMEOUT_S)
        except NotBound:
            return None
        except NotReachable as error:
            raise RobotLost(str(error)) from None
        return RemoteSenses(orb, orb.uri(found), is_clock_ours=True)

    return find

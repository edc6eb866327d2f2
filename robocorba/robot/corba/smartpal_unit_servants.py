"""Servants of the units of the stand-in for a SmartPal, with SmartPal's public interface, and of its faults."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from omniORB import CORBA

from robocorba.robot.smartpal_stand_in.arm import Arm
from robocorba.robot.smartpal_stand_in.axes import AxesUnit
from robocorba.robot.smartpal_stand_in.codes import Alarm, AlarmType, ReturnCode
from robocorba.robot.smartpal_stand_in.faults import Faults, InvalidFault
from robocorba.robot.smartpal_stand_in.gripper import StandInGripper
from robocorba.robot.smartpal_stand_in.lumbar import StandInLumbar
from robocorba.robot.smartpal_stand_in.mobility import WHEELS, Mobility
from robocorba.robot.smartpal_stand_in.unit import VERSION, Unit
from robocorba.stubs import (
    RoboCorba,
    RoboCorba__POA,
    YeRTUnitMobility__POA,
    _GlobalIDL,
    _GlobalIDL__POA,
)

Servant = TypeVar("Servant", bound=type)


def _with_network_faults(servant: Servant) -> Servant:
    """Apply the network faults to each call of a unit's servant; a lost call raises COMM_FAILURE."""

    def guarded(operation: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(operation)
        def call(self: Any, *arguments: Any) -> Any:
            if not self._faults.delivers(self._unit.name):
                raise CORBA.COMM_FAILURE(0, CORBA.COMPLETED_MAYBE)
            return operation(self, *arguments)

        return call

    for name, operation in vars(servant).copy().items():
        if not name.startswith("_"):
            setattr(servant, name, guarded(operation))
    return servant


def _is_ok(answer: ReturnCode) -> bool:
    return answer is ReturnCode.OK


def _accepts(operation: Callable[..., ReturnCode]) -> Callable[..., bool]:
    """A method of a servant that calls this operation of its unit; returns whether the unit accepts it."""

    def method(self: Any, *arguments: Any) -> bool:
        return getattr(self._unit, operation.__name__)(*arguments) is ReturnCode.OK

    return method


def _answers(operation: Callable[..., ReturnCode]) -> Callable[..., ReturnCode]:
    """As `_accepts`, but returns the unit's answer."""

    def method(self: Any, *arguments: Any) -> Any:
        return getattr(self._unit, operation.__name__)(*arguments)

    return method


def _alarms(unit: Unit, max_count: int) -> tuple[int, list[Any]]:
    types = {
        AlarmType.FAULT: _GlobalIDL.FAULT,
        AlarmType.WARNING: _GlobalIDL.WARNING,
        AlarmType.UNKNOWN: _GlobalIDL.UNKNOWN,
    }
    alarms = unit.active_alarms(max_count)
    return len(alarms), [_GlobalIDL.Alarm(alarm.code, types[alarm.type], alarm.description) for alarm in alarms]


def _state_text(state: Any) -> str:
    return str(state.name.replace("_", " ").capitalize())


@_with_network_faults
class MobilityServant(YeRTUnitMobility__POA.mobility):
    """YeRTUnitMobility::mobility."""

    def __init__(self, unit: Mobility, faults: Faults) -> None:
        self._unit, self._faults = unit, faults

    stop = _accepts(Mobility.stop)
    clearAlarm = _accepts(Mobility.clear_alarms)
    pause = _accepts(Mobility.pause)
    resume = _accepts(Mobility.resume)
    unlock = _accepts(Mobility.unlock)
    setPosition = _accepts(Mobility.set_position)
    setVelocity = _accepts(Mobility.set_velocity)
    setAcceleration = _accepts(Mobility.set_acceleration)
    setJogTimeout = _accepts(Mobility.set_jog_timeout)
    moveJog = _accepts(Mobility.jog)
    moveLinear = _accepts(Mobility.move_by)
    moveLinearAbs = _accepts(Mobility.move_to)
    moveCircular = _accepts(Mobility.move_around)
    moveWagon = _accepts(Mobility.move_wagon)

    def setPower(self, on: bool) -> bool:
        return _is_ok(self._unit.power_on() if on else self._unit.power_off())

    def setServo(self, on: bool) -> bool:
        return _is_ok(self._unit.servo_on() if on else self._unit.servo_off())

    def getVersion(self) -> tuple[bool, str]:
        return True, VERSION

    def getServoStatus(self, axis: int) -> tuple[bool, bool]:
        return axis < WHEELS, axis < WHEELS and self._unit.is_servo_on

    def getActiveAlarm(self, max_count: int) -> tuple[bool, int, list[Any]]:
        return (True, *_alarms(self._unit, max_count))

    def getPosition(self) -> tuple[bool, float, float, float]:
        return (True, *self._unit.position)

    def getState(self) -> tuple[bool, int, str]:
        state = self._unit.mobility_state
        return True, int(state), _state_text(state)

    def moveForward(self, distance: float) -> bool:
        return _is_ok(self._unit.move_by(distance, 0.0, 0.0))

    def moveTurn(self, angle: float) -> bool:
        return _is_ok(self._unit.move_by(0.0, 0.0, angle))

    def moveTurnContinuous(self, angle: float) -> bool:
        return _is_ok(self._unit.move_by(0.0, 0.0, angle, is_continuous=True))

    def moveContinuous(self, x: float, y: float, theta: float) -> bool:
        return _is_ok(self._unit.move_by(x, y, theta, is_continuous=True))

    def moveWagonAbs(self, x: float, y: float) -> bool:
        return _is_ok(self._unit.move_wagon(x, y, is_absolute=True))

    def getBatteryVoltage(self) -> tuple[bool, int]:
        return True, self._unit.battery_v


@_with_network_faults
class ArmServant(_GlobalIDL__POA.ArmUnit):
    """ArmUnit."""

    def __init__(self, unit: Arm, faults: Faults) -> None:
        self._unit, self._faults = unit, faults

    abort = _answers(Arm.stop)
    stop = _answers(Arm.stop)
    pause = _answers(Arm.pause)
    resume = _answers(Arm.resume)
    powerOn = _answers(Arm.power_on)
    powerOff = _answers(Arm.power_off)
    servoOn = _answers(Arm.servo_on)
    servoOff = _answers(Arm.servo_off)
    clearAlarms = _answers(Arm.clear_alarms)
    moveJogJoint = _answers(Arm.jog_joints)
    moveJointAbs = _answers(Arm.move_joints)
    setJogTimeout = _answers(Arm.set_jog_timeout)
    setJointAcceleration = _answers(Arm.set_joint_acceleration)

    def getActiveAlarm(self, max_count: int) -> tuple[int, int, list[Any]]:
        return (ReturnCode.OK, *_alarms(self._unit, max_count))

    def getCommandPos(self, frame: Any) -> tuple[int, list[float]]:
        return ReturnCode.OK, self._in_frame(frame, self._unit.command)

    def getFeedbackPos(self, frame: Any) -> tuple[int, list[float]]:
        return ReturnCode.OK, self._in_frame(frame, self._unit.feedback)

    def _in_frame(self, frame: Any, joints: list[float]) -> list[float]:
        return joints if frame == _GlobalIDL.JOINT else self._unit.control_point(joints)

    def getJointAcceleration(self) -> tuple[int, int]:
        return ReturnCode.OK, self._unit.joint_acceleration_ms

    def getLinearAcceleration(self) -> tuple[int, Any]:
        return ReturnCode.OK, _GlobalIDL.Acceleration(*self._unit.line_acceleration_ms)

    def getJointSoftLimit(self) -> tuple[int, list[Any]]:
        return ReturnCode.OK, [_GlobalIDL.LimitValue(upper, lower) for upper, lower in self._unit.soft_limits]

    def getMaxJointVelocity(self) -> tuple[int, list[float]]:
        return ReturnCode.OK, self._unit.max_speed_deg

    def getMaxJointAcceleration(self) -> tuple[int, list[float]]:
        return ReturnCode.OK, self._unit.max_acceleration_deg

    def getMotionRate(self) -> tuple[int, int]:
        return ReturnCode.OK, self._unit.motion_rate

    def getState(self) -> tuple[int, int, str]:
        state = self._unit.state
        return ReturnCode.OK, int(state), _state_text(state)

    def getVersion(self) -> tuple[int, str]:
        return ReturnCode.OK, VERSION

    def isMoving(self) -> bool:
        return self._unit.is_moving

    def isPowerOn(self) -> bool:
        return self._unit.is_power_on

    def isServoOn(self) -> bool:
        return self._unit.is_servo_on

    def moveJogLinear(self, frame: Any, speeds: Any, redundancy_speed: float) -> int:
        velocity = (speeds.x, speeds.y, speeds.z, speeds.rx, speeds.ry, speeds.rz)
        return self._unit.jog_line(frame == _GlobalIDL.TOOL, velocity, redundancy_speed)

    def moveJointRel(self, positions: Sequence[float], speed: float) -> int:
        return self._unit.move_joints(positions, speed, is_relative=True)

    def moveLinearAbs(self, frame: Any, position: Any, redundancy: float, speed: Any) -> int:
        speeds = speed.translation, speed.rotation
        return self._unit.move_line(frame == _GlobalIDL.TOOL, _position(position), redundancy, speeds)

    def moveLinearRel(self, frame: Any, position: Any, redundancy: float, speed: Any) -> int:
        speeds = speed.translation, speed.rotation
        return self._unit.move_line(frame == _GlobalIDL.TOOL, _position(position), redundancy, speeds, is_relative=True)

    def setControlPointOffset(self, offset: Any) -> int:
        return self._unit.set_control_point_offset(_position(offset))

    def setLinearAcceleration(self, times: Any) -> int:
        return self._unit.set_line_acceleration(times.translation, times.rotation)


def _position(position: Any) -> tuple[float, ...]:
    return position.px, position.py, position.pz, position.rx, position.ry, position.rz


def _soft_limits(unit: AxesUnit) -> tuple[bool, int, list[Any]]:
    limits = [_GlobalIDL.AxisLimit(axis, *limit) for axis, limit in enumerate(unit.soft_limits)]
    return True, len(limits), limits


class _AxesServant:
    """Base of the servants of gripper and lumbar."""

    _unit: StandInGripper | StandInLumbar
    _faults: Faults

    servoOn = _accepts(AxesUnit.servo_on)
    servoOff = _accepts(AxesUnit.servo_off)
    pause = _accepts(AxesUnit.pause)
    resume = _accepts(AxesUnit.resume)
    stop = _accepts(AxesUnit.stop)
    abort = _accepts(AxesUnit.stop)
    clearAlarms = _accepts(AxesUnit.clear_alarms)

    def isPowerOn(self) -> bool:
        return self._unit.is_power_on

    def isServoOn(self) -> bool:
        return self._unit.is_servo_on

    def isMoving(self) -> bool:
        return self._unit.is_moving

    def getActiveAlarm(self, max_count: int) -> tuple[bool, int, list[Any]]:
        return (True, *_alarms(self._unit, max_count))

    def getSoftLimit(self) -> tuple[bool, int, list[Any]]:
        return _soft_limits(self._unit)

    def getVersion(self) -> tuple[bool, str]:
        return True, VERSION


_with_network_faults(_AxesServant)


@_with_network_faults
class GripperServant(_AxesServant, _GlobalIDL__POA.GripperUnit):
    """GripperUnit."""

    def __init__(self, unit: StandInGripper, faults: Faults) -> None:
        self._unit, self._faults = unit, faults

    def move(self, position: float, speed: float, acceleration: float) -> bool:
        return _is_ok(self._unit.move([position], speed, acceleration))

    def getFeedback(self) -> tuple[bool, float]:
        return True, self._unit.feedback[0]

    def getCommand(self) -> tuple[bool, float]:
        return True, self._unit.command[0]


@_with_network_faults
class LumbarServant(_AxesServant, _GlobalIDL__POA.LumbarUnit):
    """LumbarUnit."""

    def __init__(self, unit: StandInLumbar, faults: Faults) -> None:
        self._unit: StandInLumbar = unit
        self._faults = faults

    powerOn = _accepts(StandInLumbar.power_on)
    powerOff = _accepts(StandInLumbar.power_off)
    moveCooperative = _accepts(StandInLumbar.move_cooperative)

    def getState(self) -> tuple[bool, int, str]:
        state = self._unit.state
        return True, int(state), _state_text(state)

    def getNumberOfAxes(self) -> int:
        return len(self._unit.soft_limits)

    def move(self, lower: float, upper: float, speed: float, acceleration: float) -> bool:
        return _is_ok(self._unit.move([lower, upper], speed, acceleration))

    def moveLowerAxis(self, position: float, speed: float, acceleration: float) -> bool:
        return _is_ok(self._unit.move([position, None], speed, acceleration))

    def moveUpperAxis(self, position: float, speed: float, acceleration: float) -> bool:
        return _is_ok(self._unit.move([None, position], speed, acceleration))

    def getFeedback(self) -> tuple[bool, float, float]:
        lower, upper = self._unit.feedback
        return True, lower, upper

    def getCommand(self) -> tuple[bool, float, float]:
        lower, upper = self._unit.command
        return True, lower, upper


class FaultsServant(RoboCorba__POA.SmartPalFaults):
    """RoboCorba::SmartPalFaults."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults

    def alarm(self, unit: str, code: int, type: Any, description: str) -> None:
        _switch(self._faults.alarm, unit, Alarm(code, AlarmType(type._v), description[:200]))

    def stuck(self, unit: str, on: bool) -> None:
        _switch(self._faults.stuck, unit, on)

    def lost(self, unit: str, on: bool) -> None:
        _switch(self._faults.lost, unit, on)

    def slowNetwork(self, delay: float) -> None:
        _switch(self._faults.slow_network, delay)

    def emergencySwitch(self, pressed: bool) -> None:
        self._faults.emergency_switch(pressed)

    def none(self) -> None:
        self._faults.none()


def _switch(switch: Callable[..., None], *arguments: Any) -> None:
    try:
        switch(*arguments)
    except InvalidFault as error:
        raise RoboCorba.InvalidFault(error.field, error.reason) from None

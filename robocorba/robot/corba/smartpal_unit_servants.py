"""Servants of the units of the stand-in for a SmartPal, with SmartPal's public interface, and of its faults."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from omniORB import CORBA

from robocorba.robot.smartpal_stand_in.arm import Arm
from robocorba.robot.smartpal_stand_in.axes import AxesUnit
from robocorba.robot.smartpal_stand_in.codes import Alarm, AlarmType, ReturnCode
from robocorba.robot.smartpal_stand_in.faults import Faults, InvalidFault
from robocorba.robot.smartpal_stand_in.mobility import WHEELS, Mobility
from robocorba.robot.smartpal_stand_in.unit import VERSION, Unit
from robocorba.stubs import RoboCorba, RoboCorba__POA, YeRTUnitMobility__POA, _GlobalIDL, _GlobalIDL__POA


def _asks(operation: Callable[..., Any]) -> Callable[..., Any]:
    """A method of a servant, which answers by its unit; a call that the network loses raises COMM_FAILURE."""

    def method(self: Any, *arguments: Any) -> Any:
        if not self._faults.delivers(self._unit.name):
            raise CORBA.COMM_FAILURE(0, CORBA.COMPLETED_MAYBE)
        return operation(self._unit, *arguments)

    return method


def _orders(operation: str) -> Callable[..., ReturnCode]:
    """The same for an order to the unit, by its name; returns the unit's answer."""
    return _asks(lambda unit, *arguments: getattr(unit, operation)(*arguments))


def _accepts(operation: str | Callable[..., ReturnCode]) -> Callable[..., bool]:
    """The same; returns whether the unit accepts the order."""

    def is_accepted(unit: Unit, *arguments: Any) -> bool:
        order = getattr(unit, operation) if isinstance(operation, str) else partial(operation, unit)
        return order(*arguments) is ReturnCode.OK

    return _asks(is_accepted)


def _alarms(unit: Unit, max_count: int) -> tuple[int, list[Any]]:
    types = {
        AlarmType.FAULT: _GlobalIDL.FAULT,
        AlarmType.WARNING: _GlobalIDL.WARNING,
        AlarmType.UNKNOWN: _GlobalIDL.UNKNOWN,
    }
    alarms = unit.active_alarms(max_count)
    return len(alarms), [_GlobalIDL.Alarm(alarm.code, types[alarm.type], alarm.description) for alarm in alarms]


def _state(unit: Unit) -> tuple[int, str]:
    state = unit.mobility_state if isinstance(unit, Mobility) else unit.state
    return int(state), str(state.name.replace("_", " ").capitalize())


class _UnitServant:
    """Base of the servants of all units."""

    def __init__(self, unit: Unit, faults: Faults) -> None:
        self._unit, self._faults = unit, faults


class MobilityServant(_UnitServant, YeRTUnitMobility__POA.mobility):
    """YeRTUnitMobility::mobility."""

    stop = _accepts("stop")
    clearAlarm = _accepts("clear_alarms")
    pause = _accepts("pause")
    resume = _accepts("resume")
    unlock = _accepts("unlock")
    setPower = _accepts(lambda unit, on: unit.power_on() if on else unit.power_off())
    setServo = _accepts(lambda unit, on: unit.servo_on() if on else unit.servo_off())
    setPosition = _accepts("set_position")
    setVelocity = _accepts("set_velocity")
    setAcceleration = _accepts("set_acceleration")
    setJogTimeout = _accepts("set_jog_timeout")
    moveJog = _accepts("jog")
    moveLinear = _accepts("move_by")
    moveLinearAbs = _accepts("move_to")
    moveCircular = _accepts("move_around")
    moveWagon = _accepts("move_wagon")
    moveWagonAbs = _accepts(lambda unit, x, y: unit.move_wagon(x, y, is_absolute=True))
    moveForward = _accepts(lambda unit, distance: unit.move_by(distance, 0.0, 0.0))
    moveTurn = _accepts(lambda unit, angle: unit.move_by(0.0, 0.0, angle))
    moveTurnContinuous = _accepts(lambda unit, angle: unit.move_by(0.0, 0.0, angle, is_continuous=True))
    moveContinuous = _accepts(lambda unit, x, y, theta: unit.move_by(x, y, theta, is_continuous=True))
    getVersion = _asks(lambda unit: (True, VERSION))
    getServoStatus = _asks(lambda unit, axis: (axis < WHEELS, axis < WHEELS and unit.is_servo_on))
    getActiveAlarm = _asks(lambda unit, max_count: (True, *_alarms(unit, max_count)))
    getPosition = _asks(lambda unit: (True, *unit.position))
    getState = _asks(lambda unit: (True, *_state(unit)))
    getBatteryVoltage = _asks(lambda unit: (True, unit.battery_v))


def _position_in(frame: Any, unit: Arm, joints: list[float]) -> tuple[int, list[float]]:
    return ReturnCode.OK, joints if frame == _GlobalIDL.JOINT else unit.control_point(joints)


def _jog_line(unit: Arm, frame: Any, speeds: Any, redundancy_speed: float) -> ReturnCode:
    velocity = (speeds.x, speeds.y, speeds.z, speeds.rx, speeds.ry, speeds.rz)
    return unit.jog_line(frame == _GlobalIDL.TOOL, velocity, redundancy_speed)


def _move_line(
    unit: Arm, frame: Any, position: Any, redundancy: float, speed: Any, is_relative: bool = False
) -> ReturnCode:
    speeds = speed.translation, speed.rotation
    return unit.move_line(frame == _GlobalIDL.TOOL, _position(position), redundancy, speeds, is_relative)


def _position(position: Any) -> tuple[float, ...]:
    return position.px, position.py, position.pz, position.rx, position.ry, position.rz


class ArmServant(_UnitServant, _GlobalIDL__POA.ArmUnit):
    """ArmUnit."""

    abort = _orders("stop")
    stop = _orders("stop")
    pause = _orders("pause")
    resume = _orders("resume")
    powerOn = _orders("power_on")
    powerOff = _orders("power_off")
    servoOn = _orders("servo_on")
    servoOff = _orders("servo_off")
    clearAlarms = _orders("clear_alarms")
    moveJogJoint = _orders("jog_joints")
    moveJogLinear = _asks(_jog_line)
    moveJointAbs = _orders("move_joints")
    moveJointRel = _asks(lambda unit, positions, speed: unit.move_joints(positions, speed, is_relative=True))
    moveLinearAbs = _asks(_move_line)
    moveLinearRel = _asks(partial(_move_line, is_relative=True))
    setJogTimeout = _orders("set_jog_timeout")
    setJointAcceleration = _orders("set_joint_acceleration")
    setLinearAcceleration = _asks(lambda unit, times: unit.set_line_acceleration(times.translation, times.rotation))
    setControlPointOffset = _asks(lambda unit, offset: unit.set_control_point_offset(_position(offset)))
    getActiveAlarm = _asks(lambda unit, max_count: (ReturnCode.OK, *_alarms(unit, max_count)))
    getCommandPos = _asks(lambda unit, frame: _position_in(frame, unit, unit.command))
    getFeedbackPos = _asks(lambda unit, frame: _position_in(frame, unit, unit.feedback))
    getJointAcceleration = _asks(lambda unit: (ReturnCode.OK, unit.joint_acceleration_ms))
    getLinearAcceleration = _asks(lambda unit: (ReturnCode.OK, _GlobalIDL.Acceleration(*unit.line_acceleration_ms)))
    getJointSoftLimit = _asks(lambda unit: (ReturnCode.OK, [_GlobalIDL.LimitValue(*each) for each in unit.soft_limits]))
    getMaxJointVelocity = _asks(lambda unit: (ReturnCode.OK, unit.max_speed_deg))
    getMaxJointAcceleration = _asks(lambda unit: (ReturnCode.OK, unit.max_acceleration_deg))
    getMotionRate = _asks(lambda unit: (ReturnCode.OK, unit.motion_rate))
    getState = _asks(lambda unit: (ReturnCode.OK, *_state(unit)))
    getVersion = _asks(lambda unit: (ReturnCode.OK, VERSION))
    isMoving = _asks(lambda unit: unit.is_moving)
    isPowerOn = _asks(lambda unit: unit.is_power_on)
    isServoOn = _asks(lambda unit: unit.is_servo_on)


def _soft_limits(unit: AxesUnit) -> tuple[bool, int, list[Any]]:
    limits = [_GlobalIDL.AxisLimit(axis, *limit) for axis, limit in enumerate(unit.soft_limits)]
    return True, len(limits), limits


class _AxesServant(_UnitServant):
    """Base of the servants of gripper and lumbar."""

    servoOn = _accepts("servo_on")
    servoOff = _accepts("servo_off")
    pause = _accepts("pause")
    resume = _accepts("resume")
    stop = _accepts("stop")
    abort = _accepts("stop")
    clearAlarms = _accepts("clear_alarms")
    isPowerOn = _asks(lambda unit: unit.is_power_on)
    isServoOn = _asks(lambda unit: unit.is_servo_on)
    isMoving = _asks(lambda unit: unit.is_moving)
    getActiveAlarm = _asks(lambda unit, max_count: (True, *_alarms(unit, max_count)))
    getSoftLimit = _asks(_soft_limits)
    getVersion = _asks(lambda unit: (True, VERSION))
    getFeedback = _asks(lambda unit: (True, *unit.feedback))
    getCommand = _asks(lambda unit: (True, *unit.command))


class GripperServant(_AxesServant, _GlobalIDL__POA.GripperUnit):
    """GripperUnit."""

    move = _accepts(lambda unit, position, speed, acceleration: unit.move([position], speed, acceleration))


class LumbarServant(_AxesServant, _GlobalIDL__POA.LumbarUnit):
    """LumbarUnit."""

    powerOn = _accepts("power_on")
    powerOff = _accepts("power_off")
    moveCooperative = _accepts("move_cooperative")
    move = _accepts(lambda unit, lower, upper, speed, acceleration: unit.move([lower, upper], speed, acceleration))
    moveLowerAxis = _accepts(lambda unit, to, speed, acceleration: unit.move([to, None], speed, acceleration))
    moveUpperAxis = _accepts(lambda unit, to, speed, acceleration: unit.move([None, to], speed, acceleration))
    getState = _asks(lambda unit: (True, *_state(unit)))
    getNumberOfAxes = _asks(lambda unit: len(unit.soft_limits))


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

"""Values of data ports of OpenRTM as CDR: the types of BasicDataType.idl and its neighbours in OpenRTM-aist."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import omniORB
from omniORB import CORBA

from robocorba.bridges.openrtm.data_ports import DataType, InvalidValue
from robocorba.bridges.openrtm.robot_component import DataTypes, Ranges, TimedPose, TimedText, Velocity
from robocorba.stubs import RTC

Value = TypeVar("Value")


def _cdr(typecode: Any, struct: Callable[[Value], Any], value: Callable[[Any], Value] | None = None) -> DataType[Value]:
    """struct, value: convert a value to a struct of the IDL, and back; a type of out ports only needs no `value`."""

    def encode(given: Value, is_little: bool) -> bytes:
        return bytes(omniORB.cdrMarshal(typecode, struct(given), int(is_little)))

    def decode(data: bytes, is_little: bool) -> Value:
        assert value, "a type of out ports"
        try:
            return value(omniORB.cdrUnmarshal(typecode, data, int(is_little)))
        except CORBA.SystemException as error:
            raise InvalidValue(f"{len(data)} bytes are no {typecode.id()}: {error}") from None

    return DataType(typecode.id(), encode, decode)


def _pose(value: TimedPose) -> Any:
    return RTC.TimedPose2D(_time(value.time_s), RTC.Pose2D(RTC.Point2D(value.x, value.y), value.heading))


def _text(value: TimedText) -> Any:
    return RTC.TimedString(_time(value.time_s), value.text)


def _velocity(value: Velocity) -> Any:
    return RTC.TimedVelocity2D(_time(0.0), RTC.Velocity2D(*value))


def _velocity_of(struct: Any) -> Velocity:
    return struct.data.vx, struct.data.vy, struct.data.va


def _ranges(value: Ranges) -> Any:
    scan = value.scan
    x, y, heading = scan.mount
    pose = RTC.Pose3D(RTC.Point3D(x, y, 0.0), RTC.Orientation3D(0.0, 0.0, heading))
    last_rad = scan.first_rad + scan.step_rad * (len(scan.distances) - 1)
    nearest, farthest = scan.rim_m, scan.rim_m + scan.range_m
    return RTC.RangeData(
        _time(scan.time),
        (scan.distances + scan.rim_m).tolist(),
        RTC.RangerGeometry(RTC.Geometry3D(pose, RTC.Size3D(0.0, 0.0, 0.0)), []),
        RTC.RangerConfig(scan.first_rad, last_rad, scan.step_rad, nearest, farthest, 0.0, value.rate_hz),
    )


def _time(time_s: float) -> Any:
    rest_s, seconds = math.modf(max(0.0, time_s))
    return RTC.Time(int(seconds), int(rest_s * 1e9))


DATA_TYPES = DataTypes(
    _cdr(RTC._tc_TimedPose2D, _pose),
    _cdr(RTC._tc_TimedString, _text),
    _cdr(RTC._tc_RangeData, _ranges),
    _cdr(RTC._tc_TimedVelocity2D, _velocity, _velocity_of),
)

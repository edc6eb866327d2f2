"""Values of data ports of OpenRTM as CDR: the types of BasicDataType.idl and its neighbours in OpenRTM-aist."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import omniORB
from omniORB import CORBA

from robocorba.bridges.openrtm.data_ports import InvalidValue
from robocorba.bridges.openrtm.robot_component import DataTypes, Ranges, TimedPose, TimedText, Velocity
from robocorba.stubs import RTC

Value = TypeVar("Value")


class _CdrType(Generic[Value]):
    """A data type (robocorba.bridges.openrtm.data_ports.DataType).

    struct, value: convert a value to a struct of the IDL, and back; a type of out ports only needs no `value`."""

    def __init__(
        self, typecode: Any, struct: Callable[[Value], Any], value: Callable[[Any], Value] | None = None
    ) -> None:
        self._typecode, self._struct, self._value = typecode, struct, value
        self.id: str = typecode.id()

    def encode(self, value: Value, is_little: bool) -> bytes:
        return bytes(omniORB.cdrMarshal(self._typecode, self._struct(value), int(is_little)))

    def decode(self, data: bytes, is_little: bool) -> Value:
        assert self._value, "a type of out ports"
        try:
            return self._value(omniORB.cdrUnmarshal(self._typecode, data, int(is_little)))
        except CORBA.SystemException as error:
            raise InvalidValue(f"{len(data)} bytes are no {self.id}: {error}") from None


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
    _CdrType(RTC._tc_TimedPose2D, _pose),
    _CdrType(RTC._tc_TimedString, _text),
    _CdrType(RTC._tc_RangeData, _ranges),
    _CdrType(RTC._tc_TimedVelocity2D, _velocity, _velocity_of),
)

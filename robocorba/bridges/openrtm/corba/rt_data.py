"""Values of data ports of OpenRTM as CDR: the types of BasicDataType.idl and its neighbours in OpenRTM-aist."""

from __future__ import annotations

import math
from typing import Any, Generic, TypeVar

import omniORB
from omniORB import CORBA

from robocorba.bridges.openrtm.data_ports import InvalidData
from robocorba.bridges.openrtm.robot_component import DataTypes, Ranges, TimedPose, TimedText, Velocity
from robocorba.stubs import RTC

#: Attitude and size of a sensor, as far as we know them [m, rad].
_FLAT, _NO_SIZE = (0.0, 0.0), RTC.Size3D(0.0, 0.0, 0.0)

Value = TypeVar("Value")


class _CdrType(Generic[Value]):
    """A data type (robocorba.bridges.openrtm.data_ports.DataType)."""

    def __init__(self, typecode: Any) -> None:
        self._typecode = typecode
        self.id: str = typecode.id()

    def encode(self, value: Value, is_little: bool) -> bytes:
        return bytes(omniORB.cdrMarshal(self._typecode, self._struct(value), int(is_little)))

    def decode(self, data: bytes, is_little: bool) -> Value:
        try:
            return self._value(omniORB.cdrUnmarshal(self._typecode, data, int(is_little)))
        except CORBA.SystemException as error:
            raise InvalidData(f"{len(data)} bytes are no {self.id}: {error}") from None

    def _struct(self, value: Value) -> Any:
        raise NotImplementedError

    def _value(self, struct: Any) -> Value:
        raise NotImplementedError


class _PoseType(_CdrType[TimedPose]):
    def _struct(self, value: TimedPose) -> Any:
        return RTC.TimedPose2D(_time(value.time_s), RTC.Pose2D(RTC.Point2D(value.x, value.y), value.heading))

    def _value(self, struct: Any) -> TimedPose:
        at = struct.data.position
        return TimedPose(_seconds(struct.tm), at.x, at.y, struct.data.heading)


class _TextType(_CdrType[TimedText]):
    def _struct(self, value: TimedText) -> Any:
        return RTC.TimedString(_time(value.time_s), value.text)

    def _value(self, struct: Any) -> TimedText:
        return TimedText(_seconds(struct.tm), struct.data)


class _VelocityType(_CdrType[Velocity]):
    def _struct(self, value: Velocity) -> Any:
        return RTC.TimedVelocity2D(_time(0.0), RTC.Velocity2D(*value))

    def _value(self, struct: Any) -> Velocity:
        return struct.data.vx, struct.data.vy, struct.data.va


class _RangesType(_CdrType[Ranges]):
    def _struct(self, value: Ranges) -> Any:
        scan = value.scan
        x, y, heading = scan.mount
        pose = RTC.Pose3D(RTC.Point3D(x, y, 0.0), RTC.Orientation3D(*_FLAT, heading))
        last_rad = scan.first_rad + scan.step_rad * (len(scan.distances) - 1)
        nearest, farthest = scan.rim_m, scan.rim_m + scan.range_m
        return RTC.RangeData(
            _time(scan.time),
            (scan.distances + scan.rim_m).tolist(),
            RTC.RangerGeometry(RTC.Geometry3D(pose, _NO_SIZE), []),
            RTC.RangerConfig(scan.first_rad, last_rad, scan.step_rad, nearest, farthest, 0.0, value.rate_hz),
        )


DATA_TYPES = DataTypes(
    _PoseType(RTC._tc_TimedPose2D),
    _TextType(RTC._tc_TimedString),
    _RangesType(RTC._tc_RangeData),
    _VelocityType(RTC._tc_TimedVelocity2D),
)


def _time(time_s: float) -> Any:
    rest_s, seconds = math.modf(max(0.0, time_s))
    return RTC.Time(int(seconds), int(rest_s * 1e9))


def _seconds(time: Any) -> float:
    return float(time.sec + time.nsec * 1e-9)

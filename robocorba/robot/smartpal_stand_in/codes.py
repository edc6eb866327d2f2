"""Numbers in the replies of SmartPal's units: states, return codes, alarms."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class MobilityState(IntEnum):
    READY = 0x10
    BUSY = 0x11
    ALARM = 0x13
    STUCK = 0x14
    PAUSED = 0x15
    LOCKED = 0x17
    POWERED = 0x18
    UNPOWERED = 0x19
    CAUTION = 0x1A


class AxesState(IntEnum):
    """Of an arm, the lumbar, a gripper."""

    UNPOWERED = 0x10
    POWERED = 0x11
    READY = 0x12
    BUSY = 0x13
    PAUSED = 0x14
    ALARM = 0x15
    JOG_BUSY = 0x16
    DIRECT_BUSY = 0x17
    LOCKED = 0x18
    STUCK = 0x19
    CAUTION = 0x1A


class ReturnCode(IntEnum):
    """Return codes of an arm's operations; from -100 down they are warnings."""

    OK = 0
    FAILED = -1
    WRONG_STATE = -2
    OUT_OF_RANGE = -3
    SERVO_OFF = -4
    QUEUE_FULL = -5
    TOO_FAST = -6
    TOO_MUCH_ACCELERATION = -7
    OVERLOAD = -8
    COMMAND_QUEUE_FULL = -9
    SPEED_WARNING = -100
    ACCELERATION_WARNING = -101


class AlarmType(IntEnum):
    FAULT = 0
    WARNING = 1
    UNKNOWN = 2


#: Codes of alarms. Assumed.
FOLLOWING_ERROR, EMERGENCY_SWITCH = 0x21, 0x22


@dataclass(frozen=True)
class Alarm:
    """An alarm as a unit reports it."""

    code: int
    type: AlarmType
    description: str

"""Errors of virtual sensors."""

from __future__ import annotations

from robocorba.errors.base import FieldError, RoboCorbaError


class SensingError(RoboCorbaError):
    """A virtual sensor refuses something."""


class InvalidScan(FieldError, SensingError):
    """A field of a scan's request is out of range: `field` says which, `reason` says why."""


class SensorBehind(SensingError):
    """What the sensor knows is `lag_s` old, more than `limit_s`."""

    def __init__(self, lag_s: float, limit_s: float) -> None:
        self.lag_s, self.limit_s = lag_s, limit_s
        super().__init__(f"what the sensor knows is {lag_s:.2f} s old, more than {limit_s:g} s")

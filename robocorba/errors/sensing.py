"""Errors of virtual sensors."""

from __future__ import annotations

from robocorba.errors.base import FieldError, RoboCorbaError


class SensingError(RoboCorbaError):
    """Root of the errors of virtual sensors."""


class InvalidScan(FieldError, SensingError):
    """A field of a scan request is out of range: `field` names it, `reason` explains."""


class SensorBehind(SensingError):
    """The sensor's floor data is `lag_s` old, more than `limit_s`: the Omni database does not answer."""

    def __init__(self, lag_s: float, limit_s: float) -> None:
        self.lag_s, self.limit_s = lag_s, limit_s
        super().__init__(
            f"the sensor's floor data is {lag_s:.2f} s old, more than {limit_s:g} s; the Omni database does not answer"
        )

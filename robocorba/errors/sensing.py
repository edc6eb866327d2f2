"""Errors of virtual sensors."""

from __future__ import annotations

from robocorba.errors.base import FieldError, StructuredError


class InvalidScan(FieldError):
    """A field of a scan request is out of range: `field` names it, `reason` explains."""


class SensorBehind(StructuredError):
    """The sensor's floor data is `lag_s` old, more than `limit_s`: the Omni database does not answer."""

    lag_s: float
    limit_s: float
    message = "the sensor's floor data is {lag_s:.2f} s old, more than {limit_s:g} s; the Omni database does not answer"

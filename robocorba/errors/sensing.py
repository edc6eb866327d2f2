"""Errors of virtual sensors, and of a robot's own."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, NamedError, StructuredError


class InvalidScan(FieldError):
    """A field of a scan request is out of range: `field` names it, `reason` explains."""


class SensorBehind(StructuredError):
    """The sensor's floor data is `lag_s` old, more than `limit_s`: the Omni database does not answer."""

    lag_s: float
    limit_s: float
    message = "the sensor's floor data is {lag_s:.2f} s old, more than {limit_s:g} s; the Omni database does not answer"


class UnknownSensor(NamedError):
    """The robot has no sensor called `name`; `known` lists those that it has."""

    known: Sequence[str]
    message = "the robot has no sensor {name!q}; known are {known!l}"

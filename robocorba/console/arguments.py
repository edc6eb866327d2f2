"""Checks of operations' arguments, which come from a browser as any JSON: each returns the value or raises."""

from __future__ import annotations

import math
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from robocorba.errors.base import RoboCorbaError

#: Maximum length of a text [characters].
MAX_TEXT = 4096
#: Largest whole number: JavaScript has no larger ones, and CORBA can send it.
MAX_WHOLE = 2**53


class InvalidArguments(RoboCorbaError):
    """Arguments that the operation does not have, that it misses, or with impossible values."""


class NotPossible(RoboCorbaError):
    """The console can't do now what a page asks for, or does not have, or no longer, what it asks about."""


def checked(name: str, value: Any, wanted: object) -> Any:
    """The value of the parameter `name` if it has the type of it, which may also be a list of texts, or a type or None;
    values of other types are left to the operation. Raises InvalidArguments."""
    kind, *others = get_args(wanted) if get_origin(wanted) in (Union, UnionType) else (wanted,)
    if value is None and NoneType in others:
        return None
    if kind is str and not _is_text(value):
        raise InvalidArguments(f"{name} is not a text that can be sent")
    if kind is bool and not isinstance(value, bool):
        raise InvalidArguments(f"{name} is not true or false")
    if kind is int:
        return whole(name, value)
    if kind == list[str]:
        return texts(name, value)
    return number(name, value) if kind is float else value


def _is_text(value: Any) -> bool:
    """Whether CORBA can send it as a text."""
    return isinstance(value, str) and "\0" not in value and not any("\ud800" <= each <= "\udfff" for each in value)


def text(name: str, value: Any) -> str:
    """Raises InvalidArguments unless it is a text that CORBA can send."""
    if not isinstance(value, str) or len(value) > MAX_TEXT:
        raise InvalidArguments(f"{name} is not a text of at most {MAX_TEXT} characters")
    if not _is_text(value):
        raise InvalidArguments(f"{name} has characters that are no text")
    return value


def texts(name: str, values: Any) -> list[str]:
    """Raises InvalidArguments unless it is a list of texts."""
    if not isinstance(values, list):
        raise InvalidArguments(f"{name} is not a list")
    return [text(name, value) for value in values]


def is_number(value: Any) -> bool:
    """Whether it is a finite number."""
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # a whole number that is too large for a float
        return False


def number(name: str, value: Any) -> float:
    """Raises InvalidArguments unless it is a finite number."""
    if not is_number(value):
        raise InvalidArguments(f"{name} is not a number")
    return float(value)


def whole(name: str, value: Any) -> int:
    """Raises InvalidArguments unless it is a whole number from 0 to MAX_WHOLE."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_WHOLE:
        raise InvalidArguments(f"{name} is not a whole number")
    return value


def count(name: str, value: Any, maximum: int) -> int:
    """Raises InvalidArguments unless it is a whole number from 1 to `maximum`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= maximum:
        raise InvalidArguments(f"{name} is not a whole number from 1 to {maximum}")
    return value

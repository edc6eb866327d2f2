"""A key for the content of an `any`: equal for equal values of equal types, however they were sent."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

from omniORB import CORBA


def content_of(value: Any, uri: Callable[[Any], str]) -> Hashable:
    """The content of an `any`, or of a value in one. uri: stringifies references."""
    if value is None or isinstance(value, str | bytes | int | float | bool):
        return value
    if isinstance(value, CORBA.Any):
        return _type_of(value), content_of(value._v, uri)
    if isinstance(value, list | tuple):
        return tuple(content_of(item, uri) for item in value)
    if isinstance(value, CORBA.Object):
        return uri(value)
    if isinstance(value, CORBA.TypeCode):
        return str(value)
    members = getattr(value, "__dict__", None)
    if members:
        return tuple((name, content_of(member, uri)) for name, member in sorted(members.items()))
    return str(value)


def _type_of(value: Any) -> str:
    try:
        return str(value._t.id())
    except CORBA.TypeCode.BadKind:
        return str(value._t.kind())

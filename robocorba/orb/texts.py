"""Texts of callers that nobody can read are refused before a servant sees them.

omniORBpy puts U+FFFD in place of bytes that are not UTF-8, and passes a NUL in a string on to the servant, though it
can't send one. Stored, such a text would never be found again under its name, or would make every answer fail that
contains it. U+FFFD sent as such is refused too: it says that something was lost before.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.orb.workarounds import operations_of, tc

#: Checks a value; raises BAD_PARAM or DATA_CONVERSION.
Check = Callable[[Any], None]


@functools.cache
def refuse_unreadable_texts(servant: Any) -> None:
    """Let the operations of a servant's class check their texts. Operations without texts stay as they are, and those
    that the class names in `checks_texts_itself`."""
    checked_itself = getattr(servant, "checks_texts_itself", ())
    for name, descriptor in operations_of(servant).items():
        if name in checked_itself:
            continue
        checks = [(index, check) for index, each in enumerate(descriptor[0]) if (check := check_of(each))]
        method = getattr(servant, name, None)
        if checks and method:
            setattr(servant, name, _checked(method, checks))


def _checked(method: Callable[..., Any], checks: list[tuple[int, Check]]) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(self: Any, *arguments: Any) -> Any:
        for index, check in checks:
            check(arguments[index])
        return method(self, *arguments)

    return call


def check_of(descriptor: Any) -> Check | None:
    """The check of values with this type descriptor; None for types without texts."""
    return _check_of(descriptor, ())


def _check_of(descriptor: Any, around: tuple[str, ...]) -> Check | None:
    """around: the types that this one is a part of; a type within itself is not checked."""
    if not isinstance(descriptor, tuple):
        return None
    kind = descriptor[0]
    if kind == tc.tv_string:
        return check_text
    if kind == tc.tv_alias:
        return _check_of(descriptor[3], around)
    if kind in (tc.tv_sequence, tc.tv_array):
        part = _check_of(descriptor[1], around)
        return functools.partial(_check_parts, part) if part else None
    if kind not in (tc.tv_struct, tc.tv_union) or descriptor[2] in around:
        return None
    around = (*around, descriptor[2])
    if kind == tc.tv_union:
        cases = {label: check for label, _, part in descriptor[6] if (check := _check_of(part, around))}
        return functools.partial(_check_case, cases) if cases else None
    members = zip(descriptor[4::2], descriptor[5::2], strict=True)
    checks = [(name, check) for name, part in members if (check := _check_of(part, around))]
    return functools.partial(_check_members, checks) if checks else None


def check_text(text: str) -> None:
    """Raises BAD_PARAM for a text with NUL, DATA_CONVERSION for one that was not UTF-8."""
    if "\0" in text:
        raise CORBA.BAD_PARAM(omniORB.BAD_PARAM_EmbeddedNullInPythonString, CORBA.COMPLETED_NO)
    if "\N{REPLACEMENT CHARACTER}" in text:
        raise CORBA.DATA_CONVERSION(omniORB.DATA_CONVERSION_BadInput, CORBA.COMPLETED_NO)


def _check_parts(check: Check, parts: list[Any]) -> None:
    for part in parts:
        check(part)


def _check_members(checks: list[tuple[str, Check]], struct: Any) -> None:
    for name, check in checks:
        check(getattr(struct, name))


def _check_case(cases: dict[Any, Check], union: Any) -> None:
    if check := cases.get(union._d):
        check(union._v)

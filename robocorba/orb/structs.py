"""Conversion of values to structs of the IDL and back, member by member.

For structs that are rarely converted; those of events, floors and scans have functions of their own, for speed."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from enum import Enum
from operator import attrgetter
from typing import Any, NamedTuple

from robocorba.stubs import RoboCorba


class Converter(NamedTuple):
    """Converts values of one type."""

    to_idl: Callable[[Any], Any]
    from_idl: Callable[[Any], Any]


def struct_converter(
    domain: Callable[..., Any], idl: Any, names: Mapping[str, str] = {}, **converters: Converter
) -> Converter:
    """Of `domain` to the struct `idl`, which has several members.

    A field of the domain is named like the struct's member, in snake case; names: the fields that are not, by member.
    converters: of the fields that differ from their members, by field."""
    members = list(inspect.signature(idl.__init__).parameters)[1:]
    fields = [names.get(member, re.sub("[A-Z]", r"_\g<0>", member).lower()) for member in members]
    values_of, members_of = attrgetter(*fields), attrgetter(*members)
    special = [(fields.index(field), converter) for field, converter in converters.items()]

    def to_idl(value: Any) -> Any:
        values = list(values_of(value))
        for index, converter in special:
            values[index] = converter.to_idl(values[index])
        return idl(*values)

    def from_idl(found: Any) -> Any:
        values = list(members_of(found))
        for index, converter in special:
            values[index] = converter.from_idl(values[index])
        return domain(**dict(zip(fields, values, strict=True)))

    return Converter(to_idl, from_idl)


def sequence(items: Converter) -> Converter:
    """Of a tuple of items to a sequence."""
    return Converter(
        lambda values: [items.to_idl(value) for value in values],
        lambda found: tuple(items.from_idl(item) for item in found),
    )


def enumeration(domain: type[Enum], prefix: str = "", suffix: str = "") -> Converter:
    """To enumerators whose names are those of `domain` between prefix and suffix."""
    enumerators = {member: getattr(RoboCorba, f"{prefix}{member.name}{suffix}") for member in domain}
    return Converter(enumerators.__getitem__, {found: member for member, found in enumerators.items()}.__getitem__)


SAME = Converter(lambda value: value, lambda found: found)
BOOLEAN = Converter(bool, bool)
STRINGS = sequence(SAME)

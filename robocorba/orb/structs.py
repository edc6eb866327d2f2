"""Conversion of values to structs of the IDL and back, member by member.

For structs that are rarely converted; those of events, floors and scans have functions of their own, for speed."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from operator import attrgetter
from typing import Any, Generic, TypeVar

from robocorba.stubs import RoboCorba

Value = TypeVar("Value")


@dataclass(frozen=True)
class Converter(Generic[Value]):
    """Converts values of one type."""

    to_idl: Callable[[Value], Any]
    from_idl: Callable[[Any], Value]

    @property
    def both(self) -> tuple[Callable[[Value], Any], Callable[[Any], Value]]:
        """As functions with names of their own: x, x_of."""
        return self.to_idl, self.from_idl


def struct_converter(
    domain: Callable[..., Value], idl: Any, names: Mapping[str, str] = {}, **converters: Converter[Any]
) -> Converter[Value]:
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

    def from_idl(found: Any) -> Value:
        values = list(members_of(found))
        for index, converter in special:
            values[index] = converter.from_idl(values[index])
        return domain(**dict(zip(fields, values, strict=True)))

    return Converter(to_idl, from_idl)


def sequence(items: Converter[Any]) -> Converter[Any]:
    """Of a tuple of items to a sequence."""
    return Converter(
        lambda values: [items.to_idl(value) for value in values],
        lambda found: tuple(items.from_idl(item) for item in found),
    )


def enumeration(domain: type[Enum], prefix: str = "", suffix: str = "") -> Converter[Any]:
    """To enumerators whose names are those of `domain` between prefix and suffix."""
    enumerators = {member: getattr(RoboCorba, f"{prefix}{member.name}{suffix}") for member in domain}
    return Converter(enumerators.__getitem__, {found: member for member, found in enumerators.items()}.__getitem__)


SAME: Converter[Any] = Converter(lambda value: value, lambda found: found)
BOOLEAN: Converter[Any] = Converter(bool, bool)
STRINGS = sequence(SAME)

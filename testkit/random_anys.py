"""Values of type `any` with IDL types drawn at random: of every kind, nested, repeated, recursive, aliased and bounded.

The types have no stubs in any process. A `Random` decides everything: seeded, or that of hypothesis."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Sequence
from decimal import Decimal
from random import Random
from typing import Any

import omniORB
from omniORB import CORBA
from omniORB import tcInternal as tc

#: Maximum nesting depth of a type, and about the largest number of values in an event.
MAX_DEPTH, MAX_VALUES = 6, 400
#: Names of members, beside x0, x1 and so on. Python has some of them for itself; omniORBpy puts a "_" before these.
NAMES = ("_from", "value", "_class", "a_long_name_of_a_member", "_lambda")
#: Kinds of a union's discriminator with their range.
DISCRIMINATORS = {
    tc.tv_short: (-(2**15), 2**15 - 1),
    tc.tv_ushort: (0, 2**16 - 1),
    tc.tv_long: (-(2**31), 2**31 - 1),
    tc.tv_ulong: (0, 2**32 - 1),
    tc.tv_longlong: (-(2**63), 2**63 - 1),
    tc.tv_ulonglong: (0, 2**64 - 1),
}
#: The kind of a reference to a type around or before; omniORBpy reads the second one.
INDIRECTIONS = (tc.tv__indirect, 2**32 + tc.tv__indirect)

_FIXED = type(CORBA.fixed("1"))
_SIMPLE = (
    *DISCRIMINATORS,
    *(tc.tv_float, tc.tv_double, tc.tv_boolean, tc.tv_char, tc.tv_octet, tc.tv_wchar, tc.tv_any, tc.tv_TypeCode),
)


class RandomAnys:
    """Draws. objects: references that occur in values, beside nil."""

    def __init__(self, random: Random, objects: Sequence[Any] = ()) -> None:
        self._random, self._objects = random, objects
        self._numbers = itertools.count(1)
        self._left = 0

    def any(self) -> Any:
        """A CORBA.Any."""
        self._left = MAX_VALUES
        self._known: list[Any] = []
        #: What the indirections to the types around refer to.
        self._open: list[list[Any]] = []
        return self._any(0)

    def _any(self, depth: int) -> Any:
        is_exception = depth == 0 and self._chance(0.05)
        descriptor = self._exception() if is_exception else self._type(depth)
        return CORBA.Any(tc.createTypeCode(descriptor), self._value(descriptor, depth))

    def _chance(self, probability: float) -> bool:
        return self._random.random() < probability

    # ---- types ----

    def _type(self, depth: int) -> Any:
        if self._known and self._chance(0.3):
            return self._random.choice(self._known)
        makers: list[Callable[[int], Any]] = [self._simple, self._text]
        if depth < MAX_DEPTH:
            makers += [self._struct, self._struct, self._union, self._sequence, self._array, self._alias]
            makers += [self._enum, self._reference, self._fixed]
        made = self._random.choice(makers)(depth + 1)
        if isinstance(made, tuple) and not self._open:  # others may refer to a type around, which is not ready
            self._known.append(made)
        return made

    def _id(self) -> str:
        return f"IDL:Random/T{next(self._numbers)}:1.0"

    def _simple(self, depth: int) -> Any:
        return self._random.choice(_SIMPLE)

    def _text(self, depth: int) -> Any:
        return self._random.choice((tc.tv_string, tc.tv_wstring)), self._random.choice((0, 0, 1, 7))

    def _fixed(self, depth: int) -> Any:
        digits = self._random.randint(1, 31)
        return tc.tv_fixed, digits, self._random.randint(0, digits)

    def _reference(self, depth: int) -> Any:
        if self._chance(0.3):
            return tc.tv_objref, "", "Object"
        kind = self._random.choice((tc.tv_objref, tc.tv_objref, tc.tv_abstract_interface))
        return kind, self._id(), "I"

    def _enum(self, depth: int) -> Any:
        id = self._id()
        items = tuple(omniORB.EnumItem(f"E{number}", number) for number in range(self._random.randint(1, 5)))
        for item in items:
            item._parent_id = id
        return tc.tv_enum, id, "E", items

    def _members(self, depth: int, open: list[Any]) -> list[Any]:
        """Names and types of one to five members."""
        members: list[Any] = []
        self._open.append(open)
        for number in range(self._random.randint(1, 5)):
            members += [NAMES[number] if self._chance(0.2) else f"x{number}", self._member(depth)]
        self._open.pop()
        return members

    def _member(self, depth: int) -> Any:
        """A type, which may be a sequence of one of the types around."""
        if self._chance(0.15):
            return tc.tv_sequence, (tc.tv__indirect, self._random.choice(self._open)), self._random.choice((0, 3))
        return self._type(depth)

    def _struct(self, depth: int) -> Any:
        id, holder = self._id(), list[Any]()
        members = self._members(depth, holder)
        made = (tc.tv_struct, omniORB.createUnknownStruct(id, tuple(members[::2])), id, "S", *members)
        holder.append(made)
        return made

    def _exception(self) -> Any:
        id = self._id()
        members: list[Any] = []
        if self._chance(0.7):
            members = [each for number in range(3) for each in (f"x{number}", self._type(1))]
        return (tc.tv_except, omniORB.createUnknownUserException(id, tuple(members[::2])), id, "X", *members)

    def _union(self, depth: int) -> Any:
        id, holder = self._id(), list[Any]()
        discriminator, labels = self._discriminator(depth)
        members = self._members(depth, holder)
        self._random.shuffle(labels)
        count = min(len(members) // 2, len(labels))
        cases = [
            (label, name, type)
            for label, name, type in zip(labels, members[: 2 * count : 2], members[1 : 2 * count : 2], strict=False)
        ]
        if self._chance(0.3):  # two labels of the first case
            cases += [(label, *cases[0][1:]) for label in labels[count : count + 1]]
        default = self._random.randrange(1, len(cases)) if len(cases) > 1 and self._chance(0.4) else -1
        by_label = {case[0]: case for number, case in enumerate(cases) if number != default}
        created = omniORB.createUnknownUnion(id, default, tuple(cases))
        made = (
            *(tc.tv_union, created, id, "U", discriminator, default, tuple(cases)),
            *(cases[default] if default >= 0 else None, by_label),
        )
        holder.append(made)
        return made

    def _discriminator(self, depth: int) -> tuple[Any, list[Any]]:
        """Its type, and possible labels."""
        kind = self._random.choice((*DISCRIMINATORS, tc.tv_boolean, tc.tv_char, tc.tv_enum))
        descriptor: Any = kind
        if kind == tc.tv_enum:
            descriptor = self._enum(depth)
            labels = list(descriptor[3])
        elif kind == tc.tv_boolean:
            labels = [False, True]
        elif kind == tc.tv_char:
            labels = list("abcxyz")
        else:
            low, high = DISCRIMINATORS[kind]
            labels = [low, high, *range(1, 6)]
        return (self._alias_of(descriptor) if self._chance(0.2) else descriptor), labels

    def _sequence(self, depth: int) -> Any:
        return tc.tv_sequence, self._type(depth), self._random.choice((0, 0, 4))

    def _array(self, depth: int) -> Any:
        return tc.tv_array, self._type(depth), self._random.randint(1, 3)

    def _alias(self, depth: int) -> Any:
        return self._alias_of(self._type(depth))

    def _alias_of(self, descriptor: Any) -> Any:
        return tc.tv_alias, self._id(), "A", descriptor

    # ---- values ----

    def _value(self, descriptor: Any, depth: int) -> Any:
        """A value of a type, which gets smaller the more there are already."""
        self._left -= 1
        kind = descriptor[0] if isinstance(descriptor, tuple) else descriptor
        if kind == tc.tv__indirect:
            return self._value(descriptor[1][0], depth)
        if kind == tc.tv_alias:
            return self._value(descriptor[3], depth)
        if kind == tc.tv_enum:
            return self._random.choice(descriptor[3])
        if kind in (tc.tv_struct, tc.tv_except):
            return descriptor[1](*[self._value(member, depth + 1) for member in descriptor[5::2]])
        if kind == tc.tv_union:
            return self._union_value(descriptor, depth)
        if kind == tc.tv_array:
            return self._elements(descriptor[1], descriptor[2], depth)
        if kind == tc.tv_sequence:
            longest = max(0, min(descriptor[2] or 5, self._left // 4, 3 if depth < 8 else 0))
            return self._elements(descriptor[1], self._random.randint(0, longest), depth)
        if kind in (tc.tv_string, tc.tv_wstring):
            return self._characters(descriptor[1])
        if kind == tc.tv_fixed:
            largest = 10 ** descriptor[1] - 1
            return CORBA.fixed(descriptor[1], descriptor[2], self._random.randint(-largest, largest))
        if kind in (tc.tv_objref, tc.tv_abstract_interface):
            return self._random.choice((None, *self._objects))
        return self._simple_value(kind, depth)

    def _union_value(self, descriptor: Any, depth: int) -> Any:
        case = self._random.choice(descriptor[6])
        return descriptor[1](case[0], self._value(case[2], depth + 1))

    def _elements(self, descriptor: Any, count: int, depth: int) -> Any:
        if descriptor == tc.tv_octet:
            return bytes(self._random.randrange(256) for _ in range(count))
        if descriptor == tc.tv_char:
            return "".join(self._random.choice("abc~ 1") for _ in range(count))
        values = [self._value(descriptor, depth + 1) for _ in range(count)]
        # omniORBpy 4.3 can't send larger ones there.
        return [value % 2**63 for value in values] if descriptor == tc.tv_ulonglong else values

    def _characters(self, bound: int) -> str:
        letters = "aZ 0" if bound else "aZ 0žあ\U0001f600"  # a bound counts parts of letters
        return "".join(self._random.choice(letters) for _ in range(self._random.randint(0, bound or 6)))

    def _simple_value(self, kind: int, depth: int) -> Any:
        random = self._random
        if kind in DISCRIMINATORS:
            low, high = DISCRIMINATORS[kind]
            return random.choice((low, high, random.randint(low, high)))
        if kind == tc.tv_float:
            return struct.unpack("f", struct.pack("f", random.uniform(-1e6, 1e6)))[0]
        if kind == tc.tv_double:
            return random.uniform(-1e9, 1e9)
        if kind == tc.tv_boolean:
            return random.choice((True, False))
        if kind == tc.tv_char:
            return random.choice("aZ 0~")
        if kind == tc.tv_octet:
            return random.randrange(256)
        if kind == tc.tv_wchar:
            return random.choice("aZžあ\uffee")
        if kind == tc.tv_any:
            return self._any(depth + 1) if depth < MAX_DEPTH and self._left > 0 else CORBA.Any(CORBA.TC_null, None)
        return tc.createTypeCode(self._type(MAX_DEPTH - 1))  # tv_TypeCode


def content(value: Any) -> Any:
    """A value in Python's own types, to be compared with that of another process."""
    if isinstance(value, CORBA.Any):
        return "any", shape(value._t._d), content(value._v)
    if isinstance(value, CORBA.TypeCode):
        return "TypeCode", shape(value._d)
    if isinstance(value, CORBA.Object):
        return "object", omniORB.orb.object_to_string(value)
    if isinstance(value, list | tuple):
        return [content(each) for each in value]
    if isinstance(value, omniORB.Union):
        return "union", content(value._d), content(value._v)
    if isinstance(value, omniORB.EnumItem):
        return "enum", value._n, value._v
    if hasattr(value, "_values"):
        return "struct", [content(each) for each in value._values]
    if isinstance(value, _FIXED):  # zeros at its end come and go
        return "fixed", str(Decimal(str(value)).normalize())
    return type(value).__name__, str(value)


def shape(descriptor: Any, around: tuple[str, ...] = ()) -> Any:
    """A type in Python's own types. around: repository ids of the structs and unions around it."""
    if not isinstance(descriptor, tuple):
        return descriptor
    kind = descriptor[0]
    if kind in INDIRECTIONS:
        return shape(descriptor[1][0], around)
    if kind in (tc.tv_struct, tc.tv_union):
        if descriptor[2] in around:
            return "around", descriptor[2]
        around = (*around, descriptor[2])

    def part(each: Any) -> Any:
        return shape(each, around)

    if kind in (tc.tv_sequence, tc.tv_array):
        return kind, part(descriptor[1]), descriptor[2]
    if kind == tc.tv_alias:
        return (*descriptor[:3], part(descriptor[3]))
    if kind == tc.tv_enum:
        return (*descriptor[:3], [item._n for item in descriptor[3]])
    if kind in (tc.tv_struct, tc.tv_except):
        return kind, *descriptor[2:4], descriptor[4::2], [part(each) for each in descriptor[5::2]]
    if kind == tc.tv_union:
        cases = [(content(label), name, part(each)) for label, name, each in descriptor[6]]
        return kind, *descriptor[2:4], part(descriptor[4]), descriptor[5], cases
    return descriptor

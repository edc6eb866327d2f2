"""What no ORB sends: arguments whose encoding is ill-formed.

A value is sent with another descriptor than the operation has: an octet sequence is encoded as a string is, with any
bytes in it, an unsigned long as an enumerator, and so on."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from types import SimpleNamespace
from typing import Any

from omniORB import tcInternal as tc

from testkit.fuzzing.values import kind_of, resolved

#: Descriptor of an octet sequence.
OCTETS = (tc.tv_sequence, tc.tv_octet, 0)
#: Contents of strings, with the NUL at the end that the encoding has.
STRINGS = (
    b"\xff\xfe\0",
    b"a\xc3\0",
    b"\xed\xa0\x80\0",  # half of a surrogate pair
    b"\xc0\x80\0",  # NUL in two bytes
    b"\xf4\x90\x80\x80\0",  # beyond Unicode
    b"a\0b\0",
    b"\0\0",
    b"abc",  # without an end
    b"",
    "\N{REPLACEMENT CHARACTER}\0".encode(),
)


class Wire:
    """Makes ill-formed arguments from well-formed ones."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._share = 0.0

    def ill_formed(self, wanted: Sequence[Any], values: Sequence[Any]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Descriptors and values to send instead of these."""
        random = self._random
        self._share = random.choice((0.05, 0.3, 1.0))
        pairs = [self._changed(each, value) for each, value in zip(wanted, values, strict=True)]
        way = random.random()
        if way < 0.1 and pairs:
            pairs.pop(random.randrange(len(pairs)))
        elif way < 0.2:
            pairs.append((OCTETS, random.randbytes(random.choice((1, 100, 10_000)))))
        elif way < 0.25:
            pairs = [(tc.tv_ulonglong, random.choice((0, 2**64 - 1)))]
        return tuple(descriptor for descriptor, _ in pairs), tuple(value for _, value in pairs)

    def _changed(self, descriptor: Any, value: Any) -> tuple[Any, Any]:
        descriptor, random = resolved(descriptor), self._random
        kind = kind_of(descriptor)
        if kind == tc.tv_struct:
            return in_turn(
                *(
                    self._changed(part, getattr(value, name))
                    for name, part in zip(descriptor[4::2], descriptor[5::2], strict=True)
                )
            )
        if kind == tc.tv_sequence and isinstance(value, list | tuple) and 0 < len(value) <= 50:
            parts = [self._changed(descriptor[1], part) for part in value]
            count = len(parts) if random.random() > self._share / 4 else random.choice((2**32 - 1, 2**31, 10**6))
            return in_turn((tc.tv_ulong, count), *parts)
        if random.random() > self._share:
            return descriptor, value
        if kind == tc.tv_string:
            return OCTETS, random.choice(STRINGS)
        if kind == tc.tv_enum:
            return tc.tv_ulong, random.choice((len(descriptor[3]), 1000, 2**31, 2**32 - 1))
        if kind == tc.tv_union:
            return tc.tv_ulong, random.choice((1000, 2**32 - 1))
        if kind == tc.tv_boolean:
            return tc.tv_octet, random.choice((2, 255))
        if kind == tc.tv_sequence:
            return tc.tv_ulong, random.choice((1, 10**6, 2**28, 2**32 - 1))
        if kind == tc.tv_objref:
            profiles = random.choice((0, 1, 2, 2**32 - 1))
            octets = random.randbytes(random.choice((0, 8, 60)))
            name = random.choice((b"IDL:x:1.0\0", b"\0", b"\xff\0", b"a" * 300 + b"\0"))
            return in_turn((OCTETS, name), (tc.tv_ulong, profiles), (tc.tv_ulong, 0), (OCTETS, octets))
        if kind == tc.tv_any:
            typecode = random.choice((*range(36), 2**32 - 1, 1000))
            octets = random.randbytes(random.choice((0, 1, 4, 100)))
            return in_turn((tc.tv_ulong, typecode), (OCTETS, octets))
        return descriptor, value


def in_turn(*parts: tuple[Any, Any]) -> tuple[Any, Any]:
    """A descriptor and a value that are sent as these, one after the other."""
    names = [f"m{number}" for number in range(len(parts))]
    members = [item for name, (part, _) in zip(names, parts, strict=True) for item in (name, part)]
    value = SimpleNamespace(**{name: part for name, (_, part) in zip(names, parts, strict=True)})
    return (tc.tv_struct, SimpleNamespace, "IDL:Fuzz:1.0", "Fuzz", *members), value

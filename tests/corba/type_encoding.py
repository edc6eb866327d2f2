"""Encodes types as an ORB may: a repeated type in full or as an indirection, encapsulations in either byte order."""

from __future__ import annotations

import struct
from random import Random
from typing import Any

import omniORB
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.testing.random_anys import INDIRECTIONS

_LABELS = {
    **{tc.tv_short: "h", tc.tv_ushort: "H", tc.tv_long: "i", tc.tv_ulong: "I", tc.tv_longlong: "q"},
    **{tc.tv_ulonglong: "Q", tc.tv_boolean: "B", tc.tv_char: "B", tc.tv_enum: "I"},
}


def encoded_any(value: Any, random: Random) -> bytes:
    """An encapsulated `any`."""
    type_code = b"\1\0\0\0" + _Types(random).encoded(value._t._d, 4, "<")
    before = (tc.tv_array, tc.tv_octet, len(type_code))
    pair = (tc.tv_struct, omniORB.createUnknownStruct("", ("a", "b")), "", "", "a", before, "b", value._t._d)
    whole: bytes = omniORB.cdrMarshal(tc.createTypeCode(pair), pair[1](type_code, value._v), 1)  # no encapsulation
    return whole


class _Types:
    def __init__(self, random: Random) -> None:
        self._random = random
        #: Where each type begins, and which types are around.
        self._places: dict[int, int] = {}
        self._around: list[Any] = []

    def encoded(self, descriptor: Any, at: int, order: str) -> bytes:
        """The encoding that begins `at` this many bytes, with the byte order of the encapsulation around."""
        if not isinstance(descriptor, tuple):
            return struct.pack(f"{order}I", descriptor)
        if descriptor[0] in INDIRECTIONS:
            return self.encoded(descriptor[1][0], at, order)
        place = self._places.get(id(descriptor))
        is_around = any(each is descriptor for each in self._around)
        if place is not None and (is_around or self._random.random() < 0.8):
            return struct.pack(f"{order}Ii", 2**32 - 1, place - at - 4)
        self._places[id(descriptor)] = at
        kind = descriptor[0]
        if kind in (tc.tv_string, tc.tv_wstring):
            return struct.pack(f"{order}II", *descriptor)
        if kind == tc.tv_fixed:
            return struct.pack(f"{order}IHh", *descriptor)
        self._around.append(descriptor)
        body = _Encapsulation(self._random.choice("<>"), at + 8)
        self._content(body, descriptor)
        self._around.pop()
        return struct.pack(f"{order}II", kind, len(body.data)) + body.data

    def _content(self, body: _Encapsulation, descriptor: Any) -> None:
        kind = descriptor[0]

        def part(each: Any) -> None:
            body.align(4)
            body.data += self.encoded(each, body.at, body.order)

        if kind in (tc.tv_sequence, tc.tv_array):
            part(descriptor[1])
            body.number("I", descriptor[2])
            return
        names = descriptor[2:4] if kind in (tc.tv_struct, tc.tv_except, tc.tv_union) else descriptor[1:3]
        for name in names:
            body.text(name)
        if kind == tc.tv_alias:
            part(descriptor[3])
        elif kind == tc.tv_enum:
            body.number("I", len(descriptor[3]))
            for item in descriptor[3]:
                body.text(item._n)
        elif kind in (tc.tv_struct, tc.tv_except):
            body.number("I", len(descriptor[4:]) // 2)
            for name, member in zip(descriptor[4::2], descriptor[5::2], strict=True):
                body.text(name.removeprefix("_"))
                part(member)
        elif kind == tc.tv_union:
            discriminator, default, cases = descriptor[4:7]
            part(discriminator)
            body.number("i", default)
            body.number("I", len(cases))
            while isinstance(discriminator, tuple) and discriminator[0] == tc.tv_alias:
                discriminator = discriminator[3]
            label_kind = discriminator[0] if isinstance(discriminator, tuple) else discriminator
            for label, name, member in cases:
                number = label._v if label_kind == tc.tv_enum else ord(label) if label_kind == tc.tv_char else label
                body.number(_LABELS[label_kind], number)
                body.text(name.removeprefix("_"))
                part(member)


class _Encapsulation:
    def __init__(self, order: str, begin: int) -> None:
        self.order, self._begin = order, begin
        self.data = b"\1" if order == "<" else b"\0"

    @property
    def at(self) -> int:
        """Where the next octet comes, counted from the beginning of the outermost encapsulation."""
        return self._begin + len(self.data)

    def align(self, size: int) -> None:
        self.data += bytes(-len(self.data) % size)

    def number(self, format: str, value: int) -> None:
        self.align(struct.calcsize(f"<{format}"))
        self.data += struct.pack(self.order + format, value)

    def text(self, value: str) -> None:
        self.number("I", len(value) + 1)
        self.data += value.encode() + b"\0"


def encoded_text(value: str) -> bytes:
    """Little-endian, with a NUL, filled up to four octets."""
    return struct.pack("<I", len(value) + 1) + value.encode() + bytes(4 - len(value) % 4)


def encoded_wchar(octets: bytes) -> bytes:
    """An encapsulated `any` with a wide character of these octets."""
    return b"\1\0\0\0" + struct.pack("<IB", CORBA.TC_wchar._d, len(octets)) + octets

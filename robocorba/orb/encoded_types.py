"""Checks an encoded TypeCode before omniORB reads it: some that are ill-formed, such as by an empty text, crash it."""

from __future__ import annotations

import struct
from typing import NamedTuple

from robocorba.orb.workarounds import tc

#: Maximum size of an encoded type [bytes]: about 10,000 members, which take tens of milliseconds to read.
MAX_BYTES = 256 * 1024
#: Maximum nesting depth of an encoded type. omniORBpy ends the process at some 5,000.
MAX_DEPTH = 64
#: Maximum length of an array whose elements take no bytes.
MAX_EMPTY = 1000

_INDIRECTION = 2**32 - 1
#: Kinds without parameters, and the least size of their values [bytes].
_SIMPLE = {
    **dict.fromkeys((tc.tv_null, tc.tv_void), 0),
    **dict.fromkeys((tc.tv_boolean, tc.tv_char, tc.tv_octet, tc.tv_wchar), 1),
    **dict.fromkeys((tc.tv_short, tc.tv_ushort), 2),
    **dict.fromkeys((tc.tv_long, tc.tv_ulong, tc.tv_float, tc.tv_any, tc.tv_TypeCode), 4),
    **dict.fromkeys((tc.tv_longlong, tc.tv_ulonglong, tc.tv_double, tc.tv_longdouble), 8),
}
#: Sizes of a union's labels [bytes], by the kind of its discriminator.
_LABELS = {
    **dict.fromkeys((tc.tv_boolean, tc.tv_char), 1),
    **dict.fromkeys((tc.tv_short, tc.tv_ushort), 2),
    **dict.fromkeys((tc.tv_long, tc.tv_ulong, tc.tv_enum), 4),
    **dict.fromkeys((tc.tv_longlong, tc.tv_ulonglong), 8),
}
_NAMED_ONLY = (tc.tv_objref, tc.tv_abstract_interface, tc.tv_local_interface)


def check(kind: int, content: bytes) -> None:
    """Check a type by its kind and the encapsulation that follows. Raises ValueError if it is no type, too large or
    too deep."""
    if len(content) > MAX_BYTES:
        raise ValueError(f"{len(content)} bytes; at most {MAX_BYTES} are allowed")
    reader = _Reader(struct.pack("<II", kind, len(content)) + content)
    try:
        reader.typecode(1)
    except (struct.error, IndexError, UnicodeError) as error:
        raise ValueError(str(error)) from None


def check_fixed(digits: int, scale: int) -> None:
    """Check the digits of a fixed-point type, and those after the point. Raises ValueError."""
    if not (1 <= digits <= 31 and 0 <= scale <= digits):
        raise ValueError(f"fixed<{digits}, {scale}>")


class _Type(NamedTuple):
    """What is known of a type; of the original for an alias. size: the least one of its values [bytes]. members: of an
    enumeration."""

    kind: int
    size: int
    members: int = 0


class _Reader:
    """Reads one type with those in it. Offsets count from the beginning of the outermost one."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at, self._end = data, 0, len(data)
        self._order, self._base = "<", 0
        #: By offset.
        self._types: dict[int, _Type] = {}

    def typecode(self, depth: int) -> _Type:
        if depth > MAX_DEPTH:
            raise ValueError(f"nested more than {MAX_DEPTH} deep")
        kind = self._number("I")
        begin = self._at - 4
        if kind == _INDIRECTION:
            target = self._at + self._number("i")
            if target not in self._types:
                raise ValueError("a reference to no type before it")
            if not self._types[target].size:  # a kilobyte could describe a value with more members than can be read
                raise ValueError("a reference to a type whose values take no bytes")
            return self._types[target]
        self._types[begin] = _Type(kind, 1)  # where it refers to itself
        self._types[begin] = found = self._with_parameters(kind, depth)
        return found

    def _with_parameters(self, kind: int, depth: int) -> _Type:
        if kind in _SIMPLE:
            return _Type(kind, _SIMPLE[kind])
        if kind in (tc.tv_string, tc.tv_wstring):
            self._number("I")
            return _Type(kind, 4)
        if kind == tc.tv_fixed:
            check_fixed(self._number("H"), self._number("h"))
            return _Type(kind, 1)
        size = self._number("I")
        if not 0 < size <= self._end - self._at:
            raise ValueError("longer than the type around")
        outer, end = (self._end, self._order, self._base), self._at + size
        self._end, self._base = end, self._at
        order = self._number("B")
        if order not in (0, 1):
            raise ValueError("neither big-endian nor little-endian")
        self._order = "><"[order]
        found = self._encapsulated(kind, depth + 1)
        self._end, self._order, self._base = outer
        self._at = end
        return found

    def _encapsulated(self, kind: int, depth: int) -> _Type:
        if kind in (tc.tv_sequence, tc.tv_array):
            size, count = self.typecode(depth).size, self._number("I")
            if not size and (kind == tc.tv_sequence or count > MAX_EMPTY):
                raise ValueError("many elements that take no bytes")
            return _Type(kind, 4 if kind == tc.tv_sequence else size * count)
        self._text()
        self._text()
        if kind in _NAMED_ONLY:
            return _Type(kind, 4)
        if kind == tc.tv_alias:
            return self.typecode(depth)
        if kind == tc.tv_value_box:  # omniORBpy reads none without stubs, and the thread's next call fails
            raise ValueError("a boxed value")
        if kind in (tc.tv_struct, tc.tv_except):
            return _Type(kind, sum(self._member(depth) for _ in range(self._count())))
        if kind == tc.tv_enum:
            count = self._count()
            for _ in range(count):
                self._text()
            return _Type(kind, 4, count)
        if kind == tc.tv_union:
            return _Type(kind, self._union(depth))
        if kind == tc.tv_value:
            self._valuetype(depth)
            return _Type(kind, 4)
        raise ValueError(f"there is no kind {kind}")

    def _member(self, depth: int) -> int:
        """The least size of a member [bytes]."""
        self._text()
        return self.typecode(depth).size

    def _union(self, depth: int) -> int:
        """The size of its labels [bytes]."""
        discriminator = self.typecode(depth)
        size = _LABELS.get(discriminator.kind, 0)
        if not size:
            raise ValueError(f"a discriminator of kind {discriminator.kind}")
        default, count = self._number("i"), self._count()
        if default != -1 and not 0 < default < count:  # omniORBpy crashes at others, also at the first one
            raise ValueError("the default case is the first one, or none of the cases")
        limit = discriminator.members if discriminator.kind == tc.tv_enum else 2**64
        labels: set[int] = set()
        for number in range(count):
            label = self._number({1: "B", 2: "H", 4: "I", 8: "Q"}[size])
            if number != default and (label >= limit or label in labels):
                raise ValueError(f"label {label} does not exist, or exists twice")
            labels.add(label)
            self._member(depth)
        return size

    def _valuetype(self, depth: int) -> None:
        self._number("h")
        if self.typecode(depth).kind not in (tc.tv_null, tc.tv_value):
            raise ValueError("a valuetype whose base is none")
        for _ in range(self._count()):
            self._member(depth)
            self._number("h")

    def _count(self) -> int:
        count = self._number("I")
        if count > (self._end - self._at) // 5:
            raise ValueError("more members than there can be")
        return count

    def _text(self) -> None:
        size = self._number("I")
        text = self._data[self._at : self._at + size]
        if not 0 < size <= self._end - self._at or text.find(0) != size - 1:
            raise ValueError("a text without an end, or with NUL")
        text.decode()
        self._at += size

    def _number(self, format: str) -> int:
        size = struct.calcsize(f"<{format}")
        self._at += (self._base - self._at) % size
        if self._at + size > self._end:
            raise ValueError("it ends too early")
        (number,) = struct.unpack_from(self._order + format, self._data, self._at)
        self._at += size
        return int(number)

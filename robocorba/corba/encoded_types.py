"""Checks an encoded TypeCode before omniORB reads it: some that are ill-formed, such as an empty text, end the process."""

from __future__ import annotations

import struct

from omniORB import tcInternal as tc

#: Maximum size of an encoded type [bytes], and nesting depth.
MAX_BYTES, MAX_DEPTH = 16 * 1024, 64
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


class IllFormed(ValueError):
    """The octets are no type, or one that is too large or too deep."""


def check(kind: int, content: bytes) -> None:
    """Check a type by its kind and the encapsulation that follows. Raises IllFormed."""
    if len(content) > MAX_BYTES:
        raise IllFormed(f"{len(content)} bytes; at most {MAX_BYTES} are allowed")
    reader = _Reader(struct.pack("<II", kind, len(content)) + content)
    try:
        reader.typecode(1)
    except (struct.error, IndexError, UnicodeError) as error:
        raise IllFormed(str(error)) from None


def check_fixed(digits: int, scale: int) -> None:
    """Check the digits of a fixed-point type, and those after the point. Raises IllFormed."""
    if not (1 <= digits <= 31 and 0 <= scale <= digits):
        raise IllFormed(f"fixed<{digits}, {scale}>")


class _Reader:
    """Reads one type with those in it. Offsets count from the beginning of the outermost one."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at, self._end = data, 0, len(data)
        self._order, self._base = "<", 0
        #: Kind and least size of each type, by its offset.
        self._types: dict[int, tuple[int, int]] = {}

    def typecode(self, depth: int) -> tuple[int, int]:
        """Read a type; its kind, that of the original for an alias, and the least size of its values [bytes]."""
        if depth > MAX_DEPTH:
            raise IllFormed(f"nested more than {MAX_DEPTH} deep")
        kind = self._number("I")
        begin = self._at - 4
        if kind == _INDIRECTION:
            target = self._at + self._number("i")
            if target not in self._types:
                raise IllFormed("a reference to no type before it")
            return self._types[target]
        self._types[begin] = kind, 1  # where it refers to itself
        if kind in _SIMPLE:
            found = kind, _SIMPLE[kind]
        elif kind in (tc.tv_string, tc.tv_wstring):
            self._number("I")
            found = kind, 4
        elif kind == tc.tv_fixed:
            digits, scale = self._number("H"), self._number("h")
            check_fixed(digits, scale)
            found = kind, 1
        else:
            found = self._encapsulated(kind, depth)
        self._types[begin] = found
        return found

    def _encapsulated(self, kind: int, depth: int) -> tuple[int, int]:
        size = self._number("I")
        outer = self._end, self._order, self._base
        end = self._at + size
        if not 0 < size <= self._end - self._at:
            raise IllFormed("longer than the type around")
        self._end, self._base = end, self._at
        self._order = {0: ">", 1: "<"}.get(self._number("B"), "") or self._refuse_order()
        found = self._parameters(kind, depth)
        self._end, self._order, self._base = outer
        self._at = end
        return found

    def _parameters(self, kind: int, depth: int) -> tuple[int, int]:
        if kind in (tc.tv_sequence, tc.tv_array):
            _, size = self.typecode(depth + 1)
            count = self._number("I")
            if not size and (kind == tc.tv_sequence or count > MAX_EMPTY):
                raise IllFormed("many elements that take no bytes")
            return kind, 4 if kind == tc.tv_sequence else size * count
        self._text()
        self._text()
        if kind in _NAMED_ONLY:
            return kind, 4
        if kind in (tc.tv_alias, tc.tv_value_box):
            original, size = self.typecode(depth + 1)
            return (original, size) if kind == tc.tv_alias else (kind, 4)
        if kind in (tc.tv_struct, tc.tv_except):
            return kind, sum(self._member(depth) for _ in range(self._count()))
        if kind == tc.tv_enum:
            for _ in range(self._count()):
                self._text()
            return kind, 4
        if kind == tc.tv_union:
            return kind, self._union(depth)
        if kind == tc.tv_value:
            self._number("h")
            if self.typecode(depth + 1)[0] not in (tc.tv_null, tc.tv_value):
                raise IllFormed("a valuetype whose base is none")
            for _ in range(self._count()):
                self._member(depth)
                self._number("h")
            return kind, 4
        raise IllFormed(f"there is no kind {kind}")

    def _member(self, depth: int) -> int:
        """The least size of a member [bytes]."""
        self._text()
        return self.typecode(depth + 1)[1]

    def _union(self, depth: int) -> int:
        discriminator, _ = self.typecode(depth + 1)
        if discriminator not in _LABELS:
            raise IllFormed(f"a discriminator of kind {discriminator}")
        label = _LABELS[discriminator]
        default, count = self._number("i"), self._count()
        if not -1 <= default < count:
            raise IllFormed("the default case is no member")
        for _ in range(count):
            self._number({1: "B", 2: "H", 4: "I", 8: "Q"}[label])
            self._member(depth)
        return label

    def _count(self) -> int:
        count = self._number("I")
        if count > (self._end - self._at) // 5:
            raise IllFormed("more members than there can be")
        return count

    def _text(self) -> None:
        size = self._number("I")
        text = self._data[self._at : self._at + size]
        if not 0 < size <= self._end - self._at or text.find(0) != size - 1:
            raise IllFormed("a text without an end, or with NUL")
        text.decode()
        self._at += size

    def _number(self, format: str) -> int:
        size = struct.calcsize(f"<{format}")
        self._at += (self._base - self._at) % size
        if self._at + size > self._end:
            raise IllFormed("it ends too early")
        (number,) = struct.unpack_from(self._order + format, self._data, self._at)
        self._at += size
        return int(number)

    @staticmethod
    def _refuse_order() -> str:
        raise IllFormed("neither big-endian nor little-endian")

"""Reading an `any` of a caller, however deep the caller nests it.

omniORBpy reads types and values by recursion, and the stack of a thread is limited: a message of 80 kB with a type
within a type within a type ends the process, as does one of 800 kB with an `any` within an `any`, or with a long list
as a recursive type. An empty text in a type, which takes 80 bytes, ends it too. Here the encoded type is read first, as
octets, and checked; then the value, whose depth is counted. What is ill-formed or too deep is refused with MARSHAL.
Values of valuetypes are refused too, other than nil: omniORBpy crashes at many that are ill-formed. Those who trust all
clients may let it read them (ROBOCORBA_VALUETYPES=1).

`ANY` is a type descriptor that takes the place of tcInternal.tv_any. It makes omniORBpy read an unsigned long and, by
its value, what follows it, see bounded_reading.
"""

from __future__ import annotations

import functools
import struct
import threading
from collections.abc import Callable
from typing import Any

import omniORB
from omniORB import CORBA

from robocorba.orb import encoded_types
from robocorba.orb.bounded_reading import CHOSEN, NOTHING, OCTETS, REFUSED, chosen, struct_of
from robocorba.orb.references import reference_of
from robocorba.orb.workarounds import (
    DescribedType,
    correct_omniorb,
    descriptor_of,
    invoke_described,
    named_type,
    operation_of,
    read_arguments_as,
    tc,
)
from robocorba.system.settings import accepts_valuetypes

correct_omniorb()

#: Maximum nesting depth of a value.
MAX_DEPTH = 1000

#: The kind of a reference to a type around, also as omniORBpy writes it.
_INDIRECT = (tc.tv__indirect, 2**32 + tc.tv__indirect)
#: Types that are encoded as their kind only, with a bound, as two short numbers, and as octets.
_SIMPLE = frozenset(range(tc.tv_null, tc.tv_Principal)) | {
    *(tc.tv_longlong, tc.tv_ulonglong, tc.tv_longdouble, tc.tv_wchar)
}
_BOUNDED = (tc.tv_string, tc.tv_wstring)
_COMPLEX = (
    *(tc.tv_objref, tc.tv_struct, tc.tv_union, tc.tv_enum, tc.tv_sequence, tc.tv_array, tc.tv_alias, tc.tv_except),
    *(tc.tv_value, tc.tv_value_box, tc.tv_abstract_interface, tc.tv_local_interface),
)
#: Kinds of which only nil is read, and all those that omniORBpy must not read by itself.
_VALUES = (tc.tv_value, tc.tv_value_box, tc.tv_abstract_interface, tc.tv_local_interface)
_CHECKED = (tc.tv_objref, *_VALUES)


class _Depth(threading.local):
    """How deep the value is that this thread reads now."""

    value = 0

    def enter(self, levels: int) -> bool:
        """Whether this many more levels stay within MAX_DEPTH."""
        self.value += levels
        if self.value <= MAX_DEPTH:
            return True
        self.value = 0  # the call fails, so nobody leaves these levels
        return False

    def leave(self, levels: int) -> None:
        self.value = max(0, self.value - levels)


_depth = _Depth()


class _Accepted:
    """A type that is accepted: its typecode, the descriptor by which values are read, and how deep they can be."""

    __slots__ = ("depth", "reading", "typecode")

    def __init__(self, descriptor: Any) -> None:
        self.typecode, read = tc.createTypeCode(descriptor), _Reading(descriptor)
        self.reading, self.depth = read.descriptor, read.depth


def _accepted(kind: int, content: Any) -> _Accepted | None:
    """The type with this encoding; None for one that is refused."""
    is_small = not isinstance(content, bytes) or len(content) <= 16 * 1024
    try:
        return (_read if is_small else _read.__wrapped__)(kind, content)  # large ones are not kept
    except Exception:  # an exception in the constructor of a value would not reach the caller as MARSHAL
        return None


@functools.lru_cache(256)  # keeps none that raises
def _read(kind: int, content: Any) -> _Accepted:
    return _Accepted(_descriptor(kind, content))


def _descriptor(kind: int, content: Any) -> Any:
    if kind in _SIMPLE:
        return kind
    if kind in _BOUNDED:
        return kind, content
    if kind == tc.tv_fixed:
        encoded_types.check_fixed(*content)
        return (kind, *content)
    encoded_types.check(kind, content)
    encoded = b"\1\0\0\0" + struct.pack("<II", kind, len(content)) + content
    return descriptor_of(omniORB.cdrUnmarshal(CORBA.TC_TypeCode, encoded))


def _rebuilt(descriptor: Any, part: Callable[[Any], Any]) -> Any:
    """A descriptor with each descriptor in it replaced. Indirections, references and valuetypes stay as they are."""
    kind = descriptor[0]
    if kind == tc.tv_alias:
        return (*descriptor[:3], part(descriptor[3]))
    if kind in (tc.tv_sequence, tc.tv_array):
        return kind, part(descriptor[1]), descriptor[2]
    if kind in (tc.tv_struct, tc.tv_except):
        members = list(descriptor)
        members[5::2] = map(part, members[5::2])
        return tuple(members)
    if kind == tc.tv_union:

        def case(of: Any) -> Any:
            return of and (*of[:2], part(of[2]))

        cases, default, by_label = descriptor[6:]
        return (
            *(*descriptor[:6], tuple(map(case, cases)), case(default)),
            {label: case(each) for label, each in by_label.items()},
        )
    return descriptor


class _Reading:
    """The descriptor by which values of a type are read, and the type's nesting depth."""

    #: Whether omniORBpy must not read its values by itself.
    is_checked = False

    def __init__(self, descriptor: Any) -> None:
        #: What the types in it are read as, and how deep they are, by their identity; an empty list while it is made.
        self._made: dict[int, list[tuple[Any, int]]] = {}
        self.descriptor, self.depth = self._of(descriptor)

    def _of(self, descriptor: Any) -> tuple[Any, int]:
        while isinstance(descriptor, tuple) and descriptor[0] in _INDIRECT:
            (target,) = descriptor[1]
            descriptor = named_type(target) if isinstance(target, str) else target
        if not isinstance(descriptor, tuple):
            self.is_checked |= descriptor in _READ_AS
            return _READ_AS.get(descriptor, descriptor), 1
        made = self._made.get(id(descriptor))
        if made is None:
            made = self._made[id(descriptor)] = []
            made.append(self._make(descriptor))
        return made[0] if made else (self._gate(self._made[id(descriptor)]), 1)

    def _make(self, descriptor: Any) -> tuple[Any, int]:
        kind = descriptor[0]
        self.is_checked |= kind in _CHECKED
        if kind == tc.tv_objref:
            return reference_of(descriptor), 1
        if kind == tc.tv_abstract_interface:
            return _object_or_value(reference_of((tc.tv_objref, *descriptor[1:]))), 1
        if kind in _VALUES:
            return (descriptor if kind == tc.tv_value and accepts_valuetypes() else _NO_VALUE), 1
        deepest = 0

        def part(each: Any) -> Any:
            nonlocal deepest
            reading, depth = self._of(each)
            deepest = max(deepest, depth)
            return reading

        return _rebuilt(descriptor, part), deepest + 1

    def _gate(self, made: list[tuple[Any, int]]) -> Any:
        """Reads a value of a type within itself. made: what this type is read as, once it is known."""

        self.is_checked = True

        def enter() -> None:
            chosen[0] = made[0][0] if _depth.enter(self.depth) else REFUSED

        def leave(entered: None, value: Any) -> Any:
            _depth.leave(self.depth)
            return value

        return struct_of(leave, "enter", struct_of(enter), "value", CHOSEN)


def _no_value(tag: int) -> None:
    """A value of a valuetype; nothing, or too much, is read next."""
    chosen[0] = REFUSED if tag else NOTHING


_NO_VALUE = struct_of(lambda tag, nothing: None, "tag", struct_of(_no_value, "tag", tc.tv_ulong), "nothing", CHOSEN)


def _object_or_value(reference: Any) -> Any:
    """Reads what an abstract interface is here. reference: the descriptor by which references are read."""

    def choose(is_object: bool) -> None:
        chosen[0] = reference if is_object else _NO_VALUE

    return struct_of(lambda kind, value: value, "kind", struct_of(choose, "is_object", tc.tv_boolean), "value", CHOSEN)


# ---- wchar ----


def _wchar_size(size: int) -> None:
    """The size of a wide character [bytes]; as many octets are read next."""
    chosen[0] = (tc.tv_array, tc.tv_octet, size) if size in (2, 4) else REFUSED


def _wchar(size: None, octets: bytes) -> str:
    """Big-endian, or after a byte order mark."""
    text = octets.decode("utf-16" if len(octets) == 4 else "utf-16-be", "replace")
    return text if len(text) == 1 and text < "\U00010000" else "\N{REPLACEMENT CHARACTER}"


#: omniORBpy 4.3 reads the size only, and takes it for the character.
_WCHAR = struct_of(_wchar, "size", struct_of(_wchar_size, "size", tc.tv_octet), "octets", CHOSEN)


# ---- any and TypeCode ----


def _type(kind: int, content: Any) -> _Accepted | None:
    """The type of an `any`; the value is read next."""
    found = _accepted(kind, content)
    if found is None:
        _depth.value = 0
    chosen[0] = found.reading if found and _depth.enter(found.depth) else REFUSED
    return found


def _any(found: _Accepted, value: Any) -> Any:
    _depth.leave(found.depth)
    return CORBA.Any(found.typecode, value)


def _lone_type(kind: int, content: Any) -> Any:
    """A value of type TypeCode; nothing, or too much, is read next."""
    found = _accepted(kind, content)
    chosen[0] = NOTHING if found else REFUSED
    return found.typecode if found else None


_CASES = (
    *((kind, "bound", tc.tv_ulong) for kind in _BOUNDED),
    (
        tc.tv_fixed,
        "fixed",
        struct_of(lambda digits, scale: (digits, scale), "digits", tc.tv_ushort, "scale", tc.tv_short),
    ),
    *((kind, "content", OCTETS) for kind in _COMPLEX),
)


def _encoded_type(make: Callable[[int, Any], Any]) -> Any:
    by_kind = {case[0]: case for case in _CASES}
    return (
        *(tc.tv_union, make, "IDL:RoboCorba/EncodedType:1.0", "EncodedType", tc.tv_ulong, -1, _CASES, None, by_kind),
    )


ANY = struct_of(_any, "type", _encoded_type(_type), "value", CHOSEN)


#: For omniORB.cdrUnmarshal, in place of CORBA.TC_any.
TC_ANY = DescribedType(ANY)


_TYPECODE = struct_of(lambda found, nothing: found, "type", _encoded_type(_lone_type), "nothing", CHOSEN)

#: What simple kinds are read as, where it is not what omniORBpy does by itself.
_READ_AS = {tc.tv_any: ANY, tc.tv_TypeCode: _TYPECODE, tc.tv_wchar: _WCHAR}


# ---- operations ----


@functools.cache
def read_bounded(servant: Any) -> None:
    """Let the operations of a servant's class read the anys, types and references in their arguments so, other
    than those that the class names in `takes_connections`: a reference that is read so has lost the connection by which
    it came."""
    omitted = getattr(servant, "takes_connections", ())
    read_arguments_as(servant, lambda name, wanted: wanted if name in omitted else tuple(map(bounded, wanted)))


def invoke(reference: Any, interface: Any, operation: str, *arguments: Any) -> Any:
    """Call an object of another process, and read what it answers so. An object of this process raises BAD_PARAM for
    an answer with anys, types or references."""
    return invoke_described(reference, operation, _with_bounded_answers(interface, operation), arguments)


@functools.cache
def _with_bounded_answers(interface: Any, operation: str) -> Any:
    wanted, returned, raised, *rest = operation_of(interface, operation)
    return wanted, tuple(map(bounded, returned)), raised and {id: bounded(each) for id, each in raised.items()}, *rest


def bounded(descriptor: Any) -> Any:
    """The descriptor by which values of a type in a stub are read. Where there is nothing to check, it is the same."""
    read = _Reading(descriptor)
    return read.descriptor if read.is_checked else descriptor

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
from omniORB import tcInternal as tc

from robocorba.corba.conversion import encoded_types, values
from robocorba.corba.conversion.bounded_reading import CHOSEN, NOTHING, OCTETS, REFUSED, chosen, struct_of
from robocorba.corba.conversion.references import BoundedTypeCode, reference_of
from robocorba.settings import accepts_valuetypes

values.patch_omniorb()

#: Maximum nesting depth of a value.
MAX_DEPTH = 1000
#: Types that are kept, with what they are read as.
MAX_KEPT = 256

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
#: Kinds of values that omniORBpy must not read by itself.
_CHECKED = (
    *(tc.tv_any, tc.tv_TypeCode, tc.tv_objref, tc.tv_value, tc.tv_value_box),
    *(tc.tv_abstract_interface, tc.tv_local_interface),
)


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

    def __init__(self, descriptor: Any, depth: int) -> None:
        self.typecode = tc.createTypeCode(descriptor)
        self.reading, self.depth = _bounded(descriptor, {}, depth), depth


def _accepted(kind: int, content: Any) -> _Accepted | None:
    """The type with this encoding; None for one that is refused."""
    try:
        return _read(kind, content)
    except Exception:  # an exception in the constructor of a value would not reach the caller as MARSHAL
        return None


@functools.lru_cache(MAX_KEPT)  # keeps none that raises, so no large ones
def _read(kind: int, content: Any) -> _Accepted:
    descriptor = _descriptor(kind, content)
    return _Accepted(descriptor, _depth_of(descriptor))


def _descriptor(kind: int, content: Any) -> Any:
    if kind in _SIMPLE:
        return kind
    if kind in _BOUNDED:
        return kind, content
    if kind == tc.tv_fixed:
        encoded_types.check_fixed(*content)
        return kind, content.digits, content.scale
    encoded_types.check(kind, content)
    encoded = b"\1\0\0\0" + struct.pack("<II", kind, len(content)) + content
    return omniORB.cdrUnmarshal(CORBA.TC_TypeCode, encoded)._d


def _parts(descriptor: Any) -> list[Any]:
    """The descriptors in a descriptor, not those of types around it."""
    if not isinstance(descriptor, tuple):
        return []
    kind = descriptor[0]
    if kind == tc.tv_alias:
        return [descriptor[3]]
    if kind in (tc.tv_sequence, tc.tv_array):
        return [descriptor[1]]
    if kind in (tc.tv_struct, tc.tv_except):
        return list(descriptor[5::2])
    if kind == tc.tv_union:
        return [part for _, _, part in descriptor[6]]
    if kind == tc.tv_value:
        return [descriptor[6], *descriptor[8::3]]
    return [descriptor[4]] if kind == tc.tv_value_box else []


def _depth_of(descriptor: Any) -> int:
    """The nesting depth of a type."""
    deepest, left = 0, [(descriptor, 1)]
    while left:
        each, depth = left.pop()
        deepest = max(deepest, depth)
        left += [(part, depth + 1) for part in _parts(each)]
    return deepest


def _bounded(descriptor: Any, known: dict[str, list[Any]], depth: int) -> Any:
    """The descriptor by which values of a type are read. known: what the types around and before it are read as, by
    repository id. depth: of the whole type."""
    if descriptor == tc.tv_any:
        return ANY
    if descriptor == tc.tv_TypeCode:
        return _TYPECODE
    if not isinstance(descriptor, tuple):
        return descriptor
    kind = descriptor[0]
    if kind == tc.tv_objref:
        return reference_of(descriptor)

    def part(each: Any) -> Any:
        return _bounded(each, known, depth)

    if kind in _INDIRECT:
        target = descriptor[1][0]
        return _gate(known[target if isinstance(target, str) else target[2]], depth)
    if kind == tc.tv_alias:
        return (*descriptor[:3], part(descriptor[3]))
    if kind in (tc.tv_sequence, tc.tv_array):
        return kind, part(descriptor[1]), descriptor[2]
    if kind == tc.tv_value and accepts_valuetypes():
        return descriptor
    if kind in (tc.tv_value, tc.tv_value_box, tc.tv_abstract_interface, tc.tv_local_interface):
        return _NO_VALUE
    if kind not in (tc.tv_struct, tc.tv_except, tc.tv_union):
        return descriptor
    holder = known[descriptor[2]] = []
    if kind == tc.tv_union:
        cases = {id(case): (case[0], case[1], part(case[2])) for case in descriptor[6]}
        default = descriptor[7] and (descriptor[7][0], descriptor[7][1], part(descriptor[7][2]))
        by_label = {label: (case[0], case[1], part(case[2])) for label, case in descriptor[8].items()}
        made: Any = (*descriptor[:6], tuple(cases.values()), default, by_label)
    else:
        members = list(descriptor[4:])
        members[1::2] = map(part, members[1::2])
        made = (*descriptor[:4], *members)
    holder.append(made)
    return made


def _gate(holder: list[Any], depth: int) -> Any:
    """Reads a value of a type within itself. holder: what this type is read as."""

    def enter() -> None:
        chosen[0] = holder[0] if _depth.enter(depth) else REFUSED

    def leave(entered: None, value: Any) -> Any:
        _depth.leave(depth)
        return value

    return struct_of(leave, "enter", struct_of(enter), "value", CHOSEN)


def _no_value(tag: int) -> None:
    """A value of a valuetype; nothing, or too much, is read next."""
    chosen[0] = REFUSED if tag else NOTHING


_NO_VALUE = struct_of(lambda tag, nothing: None, "tag", struct_of(_no_value, "tag", tc.tv_ulong), "nothing", CHOSEN)


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


def _fixed(digits: int, scale: int) -> Any:
    return _Fixed(digits, scale)


class _Fixed(tuple[int, int]):
    """Digits and scale of a fixed-point type."""

    __slots__ = ()

    def __new__(cls, digits: int, scale: int) -> _Fixed:
        return super().__new__(cls, (digits, scale))

    @property
    def digits(self) -> int:
        return self[0]

    @property
    def scale(self) -> int:
        return self[1]


_CASES = (
    *((kind, "bound", tc.tv_ulong) for kind in _BOUNDED),
    (tc.tv_fixed, "fixed", struct_of(_fixed, "digits", tc.tv_ushort, "scale", tc.tv_short)),
    *((kind, "content", OCTETS) for kind in _COMPLEX),
)


def _encoded_type(make: Callable[[int, Any], Any]) -> Any:
    by_kind = {case[0]: case for case in _CASES}
    return (
        *(tc.tv_union, make, "IDL:RoboCorba/EncodedType:1.0", "EncodedType", tc.tv_ulong, -1, _CASES, None, by_kind),
    )


ANY = struct_of(_any, "type", _encoded_type(_type), "value", CHOSEN)


#: For omniORB.cdrUnmarshal, in place of CORBA.TC_any.
TC_ANY = BoundedTypeCode(ANY)


_TYPECODE = struct_of(lambda found, nothing: found, "type", _encoded_type(_lone_type), "nothing", CHOSEN)


# ---- operations ----


@functools.cache
def read_bounded(servant: Any) -> None:
    """Let the operations of a servant's class read the anys, types and references in their arguments so, other
    than those that the class names in `takes_connections`: a reference that is read so has lost the connection by which
    it came."""
    operations, omitted = getattr(servant, "_omni_op_d", {}), getattr(servant, "takes_connections", ())
    servant._omni_op_d = {
        name: (wanted if name in omitted else tuple(map(bounded, wanted)), *rest)
        for name, (wanted, *rest) in operations.items()
    }


def invoke(reference: Any, interface: Any, operation: str, *arguments: Any) -> Any:
    """Call an object of another process, and read what it answers so. An object of this process raises BAD_PARAM for
    an answer with anys, types or references."""
    return reference._obj.invoke(operation, _with_bounded_answers(interface, operation), arguments)


@functools.cache
def _with_bounded_answers(interface: Any, operation: str) -> Any:
    wanted, returned, raised, *rest = getattr(interface, f"_d_{operation}")
    return wanted, tuple(map(bounded, returned)), raised and {id: bounded(each) for id, each in raised.items()}, *rest


def bounded(descriptor: Any) -> Any:
    """The descriptor by which values of a type in a stub are read. Where there is nothing to check, it is the same."""
    inner = [descriptor]
    for each in inner:
        if each in _CHECKED or (isinstance(each, tuple) and each[0] in _CHECKED):
            return _bounded(descriptor, {}, _depth_of(descriptor))
        inner += _parts(each)
    return descriptor

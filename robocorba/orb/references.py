"""Reading an object reference of a caller: its type is checked before omniORBpy makes an object of it.

omniORBpy keeps the type's repository id as a text of Python, and ends the process if it is not UTF-8. Here a reference
is read as octets first. One whose type is no text, or ends before its end, is refused with MARSHAL. omniORBpy also ends
the process if it has no stubs of the interface that is expected, but has some of the one that the reference names:
there a reference is read as one of CORBA::Object.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from typing import Any

import omniORB
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.orb.bounded_reading import CHOSEN, NOTHING, OCTETS, REFUSED, chosen, struct_of

#: Interfaces whose descriptors are kept.
MAX_KEPT = 256

_HEAD = b"\1\0\0\0" if struct.pack("=H", 1) == b"\1\0" else b"\0\0\0\0"


@functools.lru_cache(MAX_KEPT)
def reference_of(descriptor: Any) -> Any:
    """The descriptor by which references are read. descriptor: the usual one, of the interface that is expected."""
    read = struct_of(
        _reader(descriptor),
        *("type", OCTETS),
        *("profiles", (tc.tv_sequence, struct_of(_profile, "tag", tc.tv_ulong, "content", OCTETS), 0)),
    )
    return struct_of(lambda reference, nothing: reference, "reference", read, "nothing", CHOSEN)


def object_at(orb: Any, uri: str) -> Any:
    """The object at an IOR or corbaloc. Raises CORBA.SystemException."""
    if uri[:4].lower() == "ior:":
        try:
            data = bytes.fromhex(uri[4:])
            (size,) = struct.unpack_from("<I" if data[0] else ">I", data, 4)
            _check_type(data[8 : 8 + size])
        except (ValueError, IndexError, struct.error):
            raise CORBA.BAD_PARAM(omniORB.BAD_PARAM_BadSchemeSpecificPart, CORBA.COMPLETED_NO) from None
    return orb.string_to_object(uri)


def _check_type(type: bytes) -> None:
    """Raises UnicodeError for a type that is no text with a NUL at its end. It may be empty."""
    text = type.decode()
    if text and text.find("\0") != len(text) - 1:
        raise UnicodeError("NUL within, or none at the end")


def _profile(tag: int, content: bytes) -> tuple[int, bytes]:
    return tag, content


def _reader(descriptor: Any) -> Callable[[bytes, list[tuple[int, bytes]]], Any]:
    """A function that makes a reference of its type and profiles, and chooses NOTHING or REFUSED."""
    expected = tc.createTypeCode(descriptor)

    def read(type: bytes, profiles: list[tuple[int, bytes]]) -> Any:
        reference = None
        try:
            _check_type(type)
            typecode = expected if descriptor[1] in omniORB.objrefMapping else CORBA.TC_Object
            reference = omniORB.cdrUnmarshal(typecode, _encoded(type, profiles))
        except Exception:
            chosen[0] = REFUSED
        else:
            chosen[0] = NOTHING
        return reference

    return read


def _encoded(type: bytes, profiles: list[tuple[int, bytes]]) -> bytes:
    encoded = bytearray(_HEAD + struct.pack("=I", len(type)) + type)
    encoded += bytes(-len(encoded) % 4) + struct.pack("=I", len(profiles))
    for tag, content in profiles:
        encoded += bytes(-len(encoded) % 4) + struct.pack("=II", tag, len(content)) + content
    return bytes(encoded)


class BoundedTypeCode(CORBA.TypeCode):
    """For omniORB.cdrUnmarshal: reads by a descriptor of this system."""

    def __init__(self, descriptor: Any) -> None:
        self._d, self._k = descriptor, CORBA.tk_any

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

from robocorba.orb.bounded_reading import CHOSEN, NOTHING, OCTETS, REFUSED, chosen, struct_of
from robocorba.orb.workarounds import has_stubs, tc


@functools.lru_cache(256)
def reference_of(descriptor: Any) -> Any:
    """The descriptor by which references are read. descriptor: the usual one, of the interface that is expected."""
    profile = struct_of(lambda tag, content: (tag, content), "tag", tc.tv_ulong, "content", OCTETS)
    read = struct_of(_reader(descriptor), "type", OCTETS, "profiles", (tc.tv_sequence, profile, 0))
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


def _reader(descriptor: Any) -> Callable[[bytes, list[tuple[int, bytes]]], Any]:
    """A function that makes a reference of its type and profiles, and chooses NOTHING or REFUSED."""
    expected = tc.createTypeCode(descriptor)

    def read(type: bytes, profiles: list[tuple[int, bytes]]) -> Any:
        reference = None
        try:
            _check_type(type)
            typecode = expected if has_stubs(descriptor[1]) else CORBA.TC_Object
            reference = omniORB.cdrUnmarshal(typecode, _encoded(type, profiles))
        except Exception:
            chosen[0] = REFUSED
        else:
            chosen[0] = NOTHING
        return reference

    return read


def _encoded(type: bytes, profiles: list[tuple[int, bytes]]) -> bytes:
    encoded = bytearray(b"\1\0\0\0" + struct.pack("<I", len(type)) + type)  # little-endian
    encoded += bytes(-len(encoded) % 4) + struct.pack("<I", len(profiles))
    for tag, content in profiles:
        encoded += bytes(-len(encoded) % 4) + struct.pack("<II", tag, len(content)) + content
    return bytes(encoded)

"""What a stringified object reference says of its server's address."""

from __future__ import annotations

import struct
from typing import NamedTuple

#: Tag of a profile with an IIOP address.
_TAG_INTERNET_IOP = 0


class IorAddress(NamedTuple):
    """The address in the first IIOP profile of a reference; may be forged like all of a reference."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def address_of(ior: str) -> IorAddress | None:
    """The address of a stringified reference ("IOR:..."); None if it has none or is malformed."""
    if not ior.startswith("IOR:"):
        return None
    try:
        reader = _Encapsulation(bytes.fromhex(ior[4:]))
        reader.octets()  # the type
        for _ in range(reader.unsigned()):
            tag, profile = reader.unsigned(), reader.octets()
            if tag == _TAG_INTERNET_IOP:
                inner = _Encapsulation(profile)
                inner.skip(2)  # version of IIOP
                return IorAddress(inner.octets().rstrip(b"\0").decode("latin-1"), inner.short())
    except (ValueError, struct.error):
        pass
    return None


class _Encapsulation:
    """A CDR encapsulation: its first octet is the byte order, and values are aligned to their size."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 1
        self._order = "<" if content[:1] == b"\1" else ">"

    def skip(self, count: int) -> None:
        self._at += count

    def unsigned(self) -> int:
        return self._number("I", 4)

    def short(self) -> int:
        return self._number("H", 2)

    def octets(self) -> bytes:
        length = self.unsigned()
        if length > len(self._content) - self._at:
            raise ValueError("longer than the reference")
        self._at += length
        return self._content[self._at - length : self._at]

    def _number(self, kind: str, size: int) -> int:
        self._at += -self._at % size
        (value,) = struct.unpack_from(self._order + kind, self._content, self._at)
        self._at += size
        return int(value)

"""What a stringified object reference says of its object and its server; may be forged like all of a reference."""

from __future__ import annotations

import struct
from typing import NamedTuple


class Ior(NamedTuple):
    """type: the repository id. address, key: HOST:PORT and object key of the first IIOP profile, which identify the
    object: omniORB marks the IORs of objects that are called over their own connections, so the same object has
    several. Each is empty where there is none."""

    type: str = ""
    address: str = ""
    key: bytes = b""


def parsed(ior: str) -> Ior:
    """The content of a stringified reference ("IOR:..."), as far as it is well-formed."""
    found = Ior()
    try:
        reader = _Encapsulation(bytes.fromhex(ior.removeprefix("IOR:")))
        found = Ior(reader.text())
        for _ in range(reader.unsigned()):
            tag, profile = reader.unsigned(), _Encapsulation(reader.octets())
            if tag == 0:  # TAG_INTERNET_IOP
                profile.skip(2)  # version of IIOP
                return found._replace(address=f"{profile.text()}:{profile.short()}", key=profile.octets())
    except (ValueError, struct.error):
        pass
    return found


def address_of(ior: str) -> str:
    """HOST:PORT of the server; empty if there is none."""
    return parsed(ior).address


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

    def text(self) -> str:
        return self.octets().rstrip(b"\0").decode(errors="replace")

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

"""Ports that are connected without CORBA."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from robocorba.bridges.openrtm.connections import Connection, Connections
from robocorba.bridges.openrtm.data_ports import DataPort, DataType, InvalidValue
from robocorba.bridges.openrtm.life_cycle import ReturnCode
from robocorba.errors.services import NotReachable


def _decode(data: bytes, is_little: bool) -> float:
    try:
        return float(struct.unpack("<d" if is_little else ">d", data)[0])
    except struct.error as error:
        raise InvalidValue(str(error)) from None


#: Numbers as eight bytes.
NUMBERS = DataType[float](
    "IDL:RTC/TimedDouble:1.0", lambda value, is_little: struct.pack("<d" if is_little else ">d", value), _decode
)


class Objects:
    """The objects of all ports of a test, by names in place of IORs."""

    def __init__(self) -> None:
        self.served: dict[str, Callable[..., Any]] = {}
        #: Objects that do not answer.
        self.hung: set[str] = set()
        self._number = 0

    def serve_in_port(self, put: Callable[[bytes], bool]) -> str:
        return self._serve(put)

    def serve_out_port(self, get: Callable[[], bytes | None]) -> str:
        return self._serve(get)

    def withdraw(self, ior: str) -> None:
        del self.served[ior]

    def put_to(self, ior: str) -> Callable[[bytes], None]:
        def put(data: bytes) -> None:
            if ior in self.hung or ior not in self.served:
                raise NotReachable(ior)
            if not self.served[ior](data):
                raise NotReachable(f"{ior} answers PORT_ERROR")

        return put

    def _serve(self, call: Callable[..., Any]) -> str:
        self._number += 1
        self.served[f"IOR:{self._number}"] = call
        return f"IOR:{self._number}"


class LocalPeer:
    """A port that is called directly. is_away: it does not answer."""

    def __init__(self, port: DataPort[Any] | None = None) -> None:
        self.is_away = False
        self.connections: Connections | None = port.serve_as(self) if port else None

    def is_same(self, other: Any) -> bool:
        return self is other

    def is_there(self) -> bool:
        return not self.is_away

    def notify_connect(self, connection: Connection) -> tuple[ReturnCode, Connection]:
        return self._answering().notify_connect(connection)

    def notify_disconnect(self, id: str) -> ReturnCode:
        return self._answering().notify_disconnect(id)

    def _answering(self) -> Connections:
        if self.is_away or self.connections is None:
            raise NotReachable("it is away")
        return self.connections

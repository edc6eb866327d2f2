"""Data ports of RT components, with OpenRTM-aist's interface type corba_cdr.

An out port puts each value into the in ports that it is connected to (dataflow type push), or keeps the last one for
those that ask (pull). Each connection gets the newest value only: one that is slow or hangs delays no other."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from robocorba.bridges.openrtm.connections import Connection, Connections, Peer, Refused
from robocorba.bridges.openrtm.life_cycle import ReturnCode
from robocorba.errors.base import RoboCorbaError
from robocorba.system.last_order import LastOrder

#: Properties of ports and connections.
PORT_TYPE, DATA_TYPE, INTERFACE = "port.port_type", "dataport.data_type", "dataport.interface_type"
DATAFLOW, SUBSCRIPTION = "dataport.dataflow_type", "dataport.subscription_type"
ENDIAN = "dataport.serializer.cdr.endian"
IN_PORT, OUT_PORT = "dataport.corba_cdr.inport_ior", "dataport.corba_cdr.outport_ior"
CORBA_CDR = "corba_cdr"
#: Time after which a connection ends whose other side does not take data [s].
LOST_S = 10.0

Value = TypeVar("Value")


class InvalidValue(RoboCorbaError):
    """Data of a port are no value of its type, or a parameter is unknown or out of bounds."""


@dataclass(frozen=True)
class DataType(Generic[Value]):
    """A type of OpenRTM. id: its repository id. encode, decode: a value to bytes, little-endian or not, and back;
    `decode` raises InvalidValue."""

    id: str
    encode: Callable[[Value, bool], bytes]
    decode: Callable[[bytes, bool], Value]


class Channel(Protocol):
    """The objects by which data come and go in connections."""

    def serve_in_port(self, put: Callable[[bytes], bool]) -> str:
        """A new object that takes data; its IOR. put: whether the data are right."""

    def serve_out_port(self, get: Callable[[], bytes | None]) -> str:
        """A new object that is asked for data; its IOR. get: None before there are any."""

    def withdraw(self, ior: str) -> None:
        """The object is not needed any more."""

    def put_to(self, ior: str) -> Callable[[bytes], None]:
        """What puts data into another component's port; raises NotReachable if it does not take them. Raises
        NotReachable if there can't be an object with this IOR."""


class DataPort(ABC, Generic[Value]):
    """A port and its connections until `close`. name: as tools show it. dataflows: those that it supports."""

    port_type = ""
    dataflows: tuple[str, ...] = ()

    def __init__(self, name: str, type: DataType[Value], channel: Channel) -> None:
        self.name, self._type, self._channel = name, type, channel
        self._connections: Connections | None = None

    @abstractmethod
    def offer(self, connection: Connection) -> Mapping[str, str]: ...

    @abstractmethod
    def begin(self, connection: Connection) -> None: ...

    @abstractmethod
    def end(self, id: str) -> None: ...

    @property
    def properties(self) -> dict[str, str]:
        """Of its profile."""
        return {
            PORT_TYPE: self.port_type,
            DATA_TYPE: self._type.id,
            INTERFACE: CORBA_CDR,
            DATAFLOW: ",".join(self.dataflows),
            SUBSCRIPTION: "new",
        }

    def serve_as(self, own: Peer) -> Connections:
        """Accept connections as this object."""
        self._connections = Connections(own, self.offer, self.begin, self.end)
        return self._connections

    @property
    def connections(self) -> Connections:
        assert self._connections, "serve_as first"
        return self._connections

    def close(self) -> None:
        """End all connections."""
        self.connections.disconnect_all()

    def _check(self, connection: Connection) -> tuple[str, bool]:
        """The dataflow type of a connection, and whether its data are little-endian. Raises Refused."""
        flow = connection.text(DATAFLOW, "push").lower()
        type = connection.text(DATA_TYPE, self._type.id)
        if connection.text(INTERFACE, CORBA_CDR) != CORBA_CDR or flow not in self.dataflows:
            raise Refused(ReturnCode.UNSUPPORTED)
        if _short(type) != _short(self._type.id):
            raise Refused(ReturnCode.BAD_PARAMETER)
        endian = connection.text(ENDIAN, "little").split(",")[0].strip().lower()
        if endian not in ("little", "big", ""):
            raise Refused(ReturnCode.UNSUPPORTED)
        return flow, endian != "big"


class InPort(DataPort[Value]):
    """take: called with each value; whether it is accepted."""

    port_type = "DataInPort"
    dataflows = ("push",)

    def __init__(self, name: str, type: DataType[Value], channel: Channel, take: Callable[[Value], bool]) -> None:
        super().__init__(name, type, channel)
        self._take = take
        self._served: dict[str, str] = {}

    def offer(self, connection: Connection) -> Mapping[str, str]:
        _, is_little = self._check(connection)

        def put(data: bytes) -> bool:
            try:
                return self._take(self._type.decode(data, is_little))
            except InvalidValue:
                return False

        self._served[connection.id] = ior = self._channel.serve_in_port(put)
        return {IN_PORT: ior}

    def begin(self, connection: Connection) -> None:
        pass

    def end(self, id: str) -> None:
        if ior := self._served.pop(id, None):
            self._channel.withdraw(ior)


class OutPort(DataPort[Value]):
    port_type = "DataOutPort"
    dataflows = ("push", "pull")

    def __init__(self, name: str, type: DataType[Value], channel: Channel) -> None:
        super().__init__(name, type, channel)
        self._lock = threading.Lock()
        #: The last value, for connections that ask for it.
        self._last: Value | None = None
        self._served: dict[str, str] = {}
        self._senders: dict[str, tuple[LastOrder[bytes], bool]] = {}

    def write(self, value: Value) -> None:
        """Give each connection a value. Does not block."""
        self._last = value
        with self._lock:
            senders = list(self._senders.values())
        encoded: dict[bool, bytes] = {}
        for sender, is_little in senders:
            if is_little not in encoded:
                encoded[is_little] = self._type.encode(value, is_little)
            sender.give(encoded[is_little])

    def offer(self, connection: Connection) -> Mapping[str, str]:
        flow, is_little = self._check(connection)
        if flow == "push":
            return {}

        def get() -> bytes | None:
            value = self._last
            return None if value is None else self._type.encode(value, is_little)

        self._served[connection.id] = ior = self._channel.serve_out_port(get)
        return {OUT_PORT: ior}

    def begin(self, connection: Connection) -> None:
        flow, is_little = self._check(connection)
        if flow != "push":
            return
        if not (ior := connection.text(IN_PORT)):
            raise Refused(ReturnCode.BAD_PARAMETER)
        put = self._channel.put_to(ior)
        failing_since_s = math.inf

        def note(problem: str) -> None:
            """How a transmission ended; empty: well."""
            nonlocal failing_since_s
            now_s = time.monotonic()
            failing_since_s = min(failing_since_s, now_s) if problem else math.inf
            if now_s - failing_since_s >= LOST_S:
                failing_since_s = math.inf
                self.connections.disconnect(connection.id)

        sender = LastOrder(f"{self.name} {connection.id}", put, note)
        with self._lock:
            self._senders[connection.id] = sender, is_little

    def end(self, id: str) -> None:
        if ior := self._served.pop(id, None):
            self._channel.withdraw(ior)
        with self._lock:
            sender = self._senders.pop(id, None)
        if sender:
            sender[0].close()


def _short(type: str) -> str:
    """TimedPose2D of IDL:RTC/TimedPose2D:1.0 or RTC/TimedPose2D."""
    return type.removeprefix("IDL:").partition(":")[0].rpartition("/")[2]

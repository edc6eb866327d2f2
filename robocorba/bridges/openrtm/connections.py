"""Connections between ports of RT components (OMG RTC 1.1, section 5.3.2.2).

A client that connects ports calls `connect` of one of them, which calls `notify_connect` of the first port of the
connection. Each port adds to the properties what others need to reach it, has the next port do the same, and then takes
from them what it needs itself."""

from __future__ import annotations

import contextlib
import threading
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from robocorba.bridges.openrtm.life_cycle import ReturnCode
from robocorba.errors.services import NotReachable

#: Maximum number of connections of a port, and of ports and properties of a connection.
MAX_CONNECTIONS, MAX_PORTS, MAX_PROPERTIES = 32, 16, 256


class Connection(NamedTuple):
    """id: empty until the connection is made. properties: values are str, or what others have put there."""

    name: str
    id: str
    ports: Sequence[Peer]
    properties: Mapping[str, Any]

    def text(self, property: str, default: str = "") -> str:
        """A property that is text."""
        value = self.properties.get(property, default)
        return value if isinstance(value, str) else default


class Peer(Protocol):
    """A port of a connection, as another one calls it. The calls raise NotReachable."""

    def is_same(self, other: Any) -> bool:
        """Whether this is the same port."""

    def is_there(self) -> bool:
        """Whether its process has it."""

    def notify_connect(self, connection: Connection) -> tuple[ReturnCode, Connection]: ...

    def notify_disconnect(self, id: str) -> ReturnCode: ...


class Refused(Exception):
    """A connection can't be made. code: the answer."""

    def __init__(self, code: ReturnCode) -> None:
        self.code = code


class Connections:
    """The connections of one port. Thread-safe: other ports are called without a lock.

    own: the port itself. offer: properties by which it is reached in a connection; raises Refused. begin: called when
    all ports have added their properties; raises Refused. end: gives up what was offered or begun for a connection,
    if anything was."""

    def __init__(
        self,
        own: Peer,
        offer: Callable[[Connection], Mapping[str, str]],
        begin: Callable[[Connection], None],
        end: Callable[[str], None],
    ) -> None:
        self._own, self._offer, self._begin, self._end = own, offer, begin, end
        self._lock = threading.Lock()
        #: None while a connection is being made.
        self._all: dict[str, Connection | None] = {}
        #: Connections of which a port was not there at the last look.
        self._suspects: set[str] = set()

    def all(self) -> list[Connection]:
        with self._lock:
            return [connection for connection in self._all.values() if connection]

    def find(self, id: str) -> Connection | None:
        with self._lock:
            return self._all.get(id)

    # ---- called by tools ----

    def connect(self, connection: Connection) -> tuple[ReturnCode, Connection]:
        """Connect all ports of a connection; also this one must be among them."""
        if not connection.ports or self._place(connection) is None:
            return ReturnCode.BAD_PARAMETER, connection
        wanted = connection._replace(id=connection.id or str(uuid.uuid4()))
        try:
            code, made = wanted.ports[0].notify_connect(wanted)
        except NotReachable:
            code, made = ReturnCode.ERROR, wanted
        if code is not ReturnCode.OK and code is not ReturnCode.PRECONDITION_NOT_MET:  # that is another connection
            for port in wanted.ports:
                with contextlib.suppress(NotReachable):
                    port.notify_disconnect(wanted.id)
        return code, made

    def disconnect(self, id: str) -> ReturnCode:
        """Disconnect all ports of a connection, from the first one that answers on."""
        connection = self.find(id)
        if connection is None:
            return ReturnCode.BAD_PARAMETER
        for port in connection.ports:
            with contextlib.suppress(NotReachable):
                port.notify_disconnect(id)
                break
        self._remove(id)
        return ReturnCode.OK

    def disconnect_all(self) -> ReturnCode:
        for connection in self.all():
            self.disconnect(connection.id)
        return ReturnCode.OK

    def disconnect_lost(self) -> None:
        """Disconnect where another port is not there, now and at the last call of this: its process has ended, for
        example. Blocks while ports don't answer."""
        lost = {each.id for each in self.all() if not all(port.is_there() for port in each.ports)}
        for id in lost & self._suspects:
            self.disconnect(id)
        self._suspects = lost

    # ---- called by other ports ----

    def notify_connect(self, connection: Connection) -> tuple[ReturnCode, Connection]:
        place = self._place(connection)
        if place is None or not connection.id:
            return ReturnCode.BAD_PARAMETER, connection
        with self._lock:
            if connection.id in self._all:
                return ReturnCode.PRECONDITION_NOT_MET, connection
            if len(self._all) >= MAX_CONNECTIONS:
                return ReturnCode.OUT_OF_RESOURCES, connection
            self._all[connection.id] = None
        try:
            offered = self._offer(connection)
            made = connection._replace(properties={**connection.properties, **offered})
            if place + 1 < len(made.ports):
                code, made = made.ports[place + 1].notify_connect(made)
                if code is not ReturnCode.OK:
                    raise Refused(code)
            self._begin(made)
        except (Refused, NotReachable) as error:
            self._remove(connection.id)
            return error.code if isinstance(error, Refused) else ReturnCode.ERROR, connection
        with self._lock:
            self._all[connection.id] = made
        return ReturnCode.OK, made

    def notify_disconnect(self, id: str) -> ReturnCode:
        connection = self.find(id)
        if connection is None:
            return ReturnCode.BAD_PARAMETER
        self._remove(id)
        place = self._place(connection)
        if place is not None and place + 1 < len(connection.ports):
            with contextlib.suppress(NotReachable):
                connection.ports[place + 1].notify_disconnect(id)
        return ReturnCode.OK

    def _place(self, connection: Connection) -> int | None:
        """Where this port is in a connection; None if it isn't there, or if the connection is too large."""
        if len(connection.ports) > MAX_PORTS or len(connection.properties) > MAX_PROPERTIES:
            return None
        return next((place for place, port in enumerate(connection.ports) if port.is_same(self._own)), None)

    def _remove(self, id: str) -> None:
        self._end(id)
        with self._lock:
            self._all.pop(id, None)

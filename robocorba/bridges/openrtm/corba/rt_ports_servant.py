"""Servants of the data ports of RT components."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.bridges.openrtm.connections import Connection, Connections, Peer
from robocorba.bridges.openrtm.corba import rt_profiles
from robocorba.bridges.openrtm.life_cycle import ReturnCode
from robocorba.stubs import RTC, RTC__POA, OpenRTM, OpenRTM__POA


class PortServant(RTC__POA.PortService):
    """RTC::PortService. peer: the port of a reference; reference: the reverse. owner: the component's reference."""

    def __init__(
        self, name: str, properties: dict[str, str], peer: Callable[[Any], Peer], reference: Callable[[Any], Any]
    ) -> None:
        self._name, self._properties = name, properties
        self._peer, self._reference = peer, reference
        self._own: Any = None
        self._owner: Any = None
        self._connections: Connections | None = None

    def begin(self, own: Any, owner: Any, connections: Connections) -> None:
        """Before calls are accepted. own, owner: references of the port and of its component."""
        self._own, self._owner, self._connections = own, owner, connections

    def get_port_profile(self) -> Any:
        properties = rt_profiles.properties(self._properties)
        return RTC.PortProfile(self._name, [], self._own, self.get_connector_profiles(), self._owner, properties)

    def get_connector_profiles(self) -> list[Any]:
        return [self._profile(connection) for connection in self._made.all()]

    def get_connector_profile(self, id: str) -> Any:
        return self._profile(self._made.find(id) or Connection("", "", [], {}))

    def connect(self, profile: Any) -> tuple[Any, Any]:
        return self._answer(*self._made.connect(rt_profiles.connection_of(profile, self._peer)))

    def notify_connect(self, profile: Any) -> tuple[Any, Any]:
        return self._answer(*self._made.notify_connect(rt_profiles.connection_of(profile, self._peer)))

    def disconnect(self, id: str) -> Any:
        return rt_profiles.return_code(self._made.disconnect(id))

    def disconnect_all(self) -> Any:
        return rt_profiles.return_code(self._made.disconnect_all())

    def notify_disconnect(self, id: str) -> Any:
        return rt_profiles.return_code(self._made.notify_disconnect(id))

    @property
    def _made(self) -> Connections:
        assert self._connections, "begin first"
        return self._connections

    def _answer(self, code: ReturnCode, connection: Connection) -> tuple[Any, Any]:
        return rt_profiles.return_code(code), self._profile(connection)

    def _profile(self, connection: Connection) -> Any:
        return rt_profiles.connector_profile(connection, self._reference)


class InPortServant(OpenRTM__POA.InPortCdr):
    """OpenRTM::InPortCdr of one connection. put: whether the data are right."""

    def __init__(self, put: Callable[[bytes], bool]) -> None:
        self._put = put

    def put(self, data: bytes) -> Any:
        return OpenRTM.PORT_OK if self._put(data) else OpenRTM.PORT_ERROR


class OutPortServant(OpenRTM__POA.OutPortCdr):
    """OpenRTM::OutPortCdr of one connection. get: None before there are data."""

    def __init__(self, get: Callable[[], bytes | None]) -> None:
        self._get = get

    def get(self) -> tuple[Any, bytes]:
        data = self._get()
        return (OpenRTM.BUFFER_EMPTY, b"") if data is None else (OpenRTM.PORT_OK, data)

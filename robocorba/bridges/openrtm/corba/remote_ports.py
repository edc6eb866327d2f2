"""Ports of other RT components, as ours call them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from omniORB import CORBA

from robocorba.bridges.openrtm.connections import Connection
from robocorba.bridges.openrtm.corba import rt_profiles
from robocorba.bridges.openrtm.life_cycle import ReturnCode
from robocorba.errors.services import NotReachable
from robocorba.orb.bounded_any import invoke
from robocorba.orb.calls import set_call_timeout
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.stubs import RTC, OpenRTM


class RemotePort:
    """A port by its reference (robocorba.bridges.openrtm.connections.Peer)."""

    def __init__(self, reference: Any) -> None:
        self.reference = reference

    def is_same(self, other: RemotePort) -> bool:
        return self.reference is not None and bool(self.reference._is_equivalent(other.reference))

    def is_there(self) -> bool:
        if self.reference is None:
            return False
        try:
            set_call_timeout(self.reference, 1.0)
            return not self.reference._non_existent()
        except CORBA.SystemException:
            return False

    def notify_connect(self, connection: Connection) -> tuple[ReturnCode, Connection]:
        code, made = self._call("notify_connect", rt_profiles.connector_profile(connection, _reference))
        return rt_profiles.return_code_of(code), rt_profiles.connection_of(made, RemotePort)

    def notify_disconnect(self, id: str) -> ReturnCode:
        return rt_profiles.return_code_of(self._call("notify_disconnect", id))

    def _call(self, operation: str, argument: Any) -> Any:
        if self.reference is None:
            raise NotReachable("the connection has a port that is nil")
        set_call_timeout(self.reference, 5.0)  # the port may call others
        with translated("a port of the connection"):
            return invoke(self.reference, RTC.PortService, operation, argument)


def put_to(orb: Orb, ior: str) -> Callable[[bytes], None]:
    """What puts data into an in port. Raises NotReachable, also for each transmission that it does not take."""
    port = orb.reference(ior, OpenRTM.InPortCdr, 1.0)

    def put(data: bytes) -> None:
        with translated("the connected port"):
            status = port.put(data)
        if status is not OpenRTM.PORT_OK:
            raise NotReachable(f"the connected port answers {status}")

    return put


def _reference(port: RemotePort) -> Any:
    return port.reference

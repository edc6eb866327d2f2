"""The CORBA objects of a robot's RT component: they are made together, bound to a name, and end together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.bridges.openrtm.connections import Connection, Connections, Peer
from robocorba.bridges.openrtm.corba.remote_ports import RemotePort, put_to
from robocorba.bridges.openrtm.corba.rt_component_servant import (
    ComponentServant,
    ConfigurationServant,
    ExecutionContextServant,
)
from robocorba.bridges.openrtm.corba.rt_data import DATA_TYPES
from robocorba.bridges.openrtm.corba.rt_ports_servant import InPortServant, OutPortServant, PortServant
from robocorba.bridges.openrtm.life_cycle import ReturnCode
from robocorba.bridges.openrtm.robot_component import Orders, RobotComponent
from robocorba.orb.naming import BoundNames
from robocorba.orb.orb import Orb


class RtObjects:
    """Makes RT components of robots at an ORB. names: where they are bound, as NAME.rtc."""

    def __init__(self, orb: Orb, names: BoundNames) -> None:
        self._orb, self._names = orb, names
        #: Our ports, which are not called by CORBA.
        self._ports: dict[str, list[OwnPort]] = {}

    def make(self, name: str, robot: str, orders: Orders) -> RtComponent:
        """A component with an instance name that is unique here."""
        channel = DataObjects(self._orb)
        component = RobotComponent(name, robot, DATA_TYPES, channel, orders)
        made = RtComponent(self._orb, component, channel, self._peer)
        self._ports = {**self._ports, name: made.ports}  # others may iterate now
        self._names.add(f"{name}.rtc", made.reference)
        return made

    def remove(self, made: RtComponent) -> None:
        """Unbind a component, and end it."""
        name = made.component.name
        self._names.withdraw(f"{name}.rtc")
        self._ports = {each: ports for each, ports in self._ports.items() if each != name}
        made.close()

    def _peer(self, reference: Any) -> Peer:
        """The port of a reference: one of ours, or one of another process."""
        if reference is not None:
            for ports in self._ports.values():
                for port in ports:
                    if port.reference._is_equivalent(reference):
                        return port
        return RemotePort(reference)


class RtComponent:
    """A component, and its objects until `close`."""

    def __init__(self, orb: Orb, component: RobotComponent, channel: DataObjects, peer: Callable[[Any], Peer]) -> None:
        self._orb, self.component, self._channel = orb, component, channel
        port_servants = [PortServant(port.name, port.properties, peer, _reference) for port in component.ports]
        servant, context = ComponentServant(component), ExecutionContextServant(component)
        configuration = ConfigurationServant(component)
        self._servants: list[Any] = [servant, context, configuration, *port_servants]
        self.reference, context_reference, configuration_reference, *ports = map(orb.activate, self._servants)
        self.ports: list[OwnPort] = []
        for port, port_servant, reference in zip(component.ports, port_servants, ports, strict=True):
            own = OwnPort(reference)
            own.connections = port.serve_as(own)
            port_servant.begin(reference, self.reference, own.connections)
            self.ports.append(own)
        context.begin(self.reference)
        profiles = [each.get_port_profile for each in port_servants]
        servant.begin(
            self.reference, context_reference, configuration_reference, list(zip(ports, profiles, strict=True))
        )

    def close(self) -> None:
        self.component.close()
        for servant in self._servants:
            self._orb.deactivate(servant)


class OwnPort:
    """A port of this process (robocorba.bridges.openrtm.connections.Peer)."""

    connections: Connections

    def __init__(self, reference: Any) -> None:
        self.reference = reference

    def is_same(self, other: OwnPort | RemotePort) -> bool:
        return self is other

    def is_there(self) -> bool:
        return True

    def notify_connect(self, connection: Connection) -> tuple[ReturnCode, Connection]:
        return self.connections.notify_connect(connection)

    def notify_disconnect(self, id: str) -> ReturnCode:
        return self.connections.notify_disconnect(id)


class DataObjects:
    """The objects by which data come and go (robocorba.bridges.openrtm.data_ports.Channel)."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._servants: dict[str, Any] = {}

    def serve_in_port(self, put: Callable[[bytes], bool]) -> str:
        return self._serve(InPortServant(put))

    def serve_out_port(self, get: Callable[[], bytes | None]) -> str:
        return self._serve(OutPortServant(get))

    def withdraw(self, ior: str) -> None:
        self._orb.deactivate(self._servants.pop(ior))

    def put_to(self, ior: str) -> Callable[[bytes], None]:
        return put_to(self._orb, ior)

    def _serve(self, servant: Any) -> str:
        ior = self._orb.uri(self._orb.activate(servant))
        self._servants[ior] = servant
        return ior


def _reference(port: OwnPort | RemotePort) -> Any:
    return port.reference

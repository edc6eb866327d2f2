"""An RT component that knows nothing of RoboCorba, in a process of its own: it answers lines of JSON.

    python tests/system/rt_peer.py HOST:PORT

It is bound as Peer.rtc at that naming service, with the ports `velocity` out, `pose`, `floor` and `range` in. The stubs
are those of rtctree, which the tools of OpenRTM use. The ports connect in the order of OMG's specification, without any
checks."""

from __future__ import annotations

import sys
import threading
import uuid
from collections import deque
from typing import Any

import CosNaming
import omniORB
from omniORB import CORBA
from rtctree.rtc import RTC, RTC__POA, OpenRTM, OpenRTM__POA, SDOPackage

from testkit.json_process import answer_commands

#: Values that are kept of each in port.
KEPT = 2000


class Port(RTC__POA.PortService):
    """A port of the peer. kind: DataInPort or DataOutPort."""

    def __init__(self, peer: Peer, name: str, kind: str, typecode: Any) -> None:
        self._peer, self.name, self._kind, self.typecode = peer, name, kind, typecode
        self.reference: Any = self._this()
        self.profiles: dict[str, Any] = {}
        self.values: deque[Any] = deque(maxlen=KEPT)
        self._sinks: dict[str, tuple[Any, int]] = {}
        self._in_ports: dict[str, Any] = {}

    def get_port_profile(self) -> Any:
        about = {"port.port_type": self._kind, "dataport.data_type": self.typecode.id()}
        about |= {"dataport.interface_type": "corba_cdr", "dataport.dataflow_type": "push"}
        profiles = list(self.profiles.values())
        return RTC.PortProfile(f"Peer.{self.name}", [], self.reference, profiles, self._peer.reference, _list(about))

    def get_connector_profiles(self) -> list[Any]:
        return list(self.profiles.values())

    def get_connector_profile(self, id: str) -> Any:
        return self.profiles[id]

    def connect(self, profile: Any) -> tuple[Any, Any]:
        profile.connector_id = profile.connector_id or str(uuid.uuid4())
        return profile.ports[0].notify_connect(profile)

    def notify_connect(self, profile: Any) -> tuple[Any, Any]:
        endian = _texts(profile).get("dataport.serializer.cdr.endian", "little").split(",")[0] == "little"
        if self._kind == "DataInPort":
            self._in_ports[profile.connector_id] = sink = InPort(self, endian)
            profile.properties += _list({"dataport.corba_cdr.inport_ior": orb.object_to_string(sink._this())})
        place = next(place for place, port in enumerate(profile.ports) if port._is_equivalent(self.reference))
        if place + 1 < len(profile.ports):
            code, profile = profile.ports[place + 1].notify_connect(profile)
            if code is not RTC.RTC_OK:
                return code, profile
        if self._kind == "DataOutPort":
            ior = _texts(profile)["dataport.corba_cdr.inport_ior"]
            self._sinks[profile.connector_id] = orb.string_to_object(ior)._narrow(OpenRTM.InPortCdr), int(endian)
        self.profiles[profile.connector_id] = profile
        return RTC.RTC_OK, profile

    def notify_disconnect(self, id: str) -> Any:
        profile = self.profiles.pop(id, None)
        if profile is None:
            return RTC.BAD_PARAMETER
        self._sinks.pop(id, None)
        if sink := self._in_ports.pop(id, None):
            poa.deactivate_object(poa.servant_to_id(sink))
        place = next(place for place, port in enumerate(profile.ports) if port._is_equivalent(self.reference))
        if place + 1 < len(profile.ports):
            profile.ports[place + 1].notify_disconnect(id)
        return RTC.RTC_OK

    def put(self, value: Any) -> list[str]:
        """Put a value into all connected ports; their answers."""
        sinks = list(self._sinks.values())
        return [str(sink.put(omniORB.cdrMarshal(self.typecode, value, endian))) for sink, endian in sinks]


class InPort(OpenRTM__POA.InPortCdr):
    """What a connection of an in port puts data into."""

    def __init__(self, port: Port, endian: bool) -> None:
        self._port, self._endian = port, int(endian)

    def put(self, data: bytes) -> Any:
        self._port.values.append(omniORB.cdrUnmarshal(self._port.typecode, data, self._endian))
        return OpenRTM.PORT_OK


class Peer(OpenRTM__POA.DataFlowComponent):
    """The component: what tools ask to show it and its ports. It has no execution context."""

    def __init__(self) -> None:
        self.reference: Any = self._this()
        self.ports = {
            "velocity": Port(self, "velocity", "DataOutPort", RTC._tc_TimedVelocity2D),
            "pose": Port(self, "pose", "DataInPort", RTC._tc_TimedPose2D),
            "floor": Port(self, "floor", "DataInPort", RTC._tc_TimedString),
            "range": Port(self, "range", "DataInPort", RTC._tc_RangeData),
        }

    def get_component_profile(self) -> Any:
        profiles = [port.get_port_profile() for port in self.ports.values()]
        return RTC.ComponentProfile("Peer", "Peer", "", "1", "", "", profiles, None, [])

    def get_ports(self) -> list[Any]:
        return [port.reference for port in self.ports.values()]

    def get_owned_contexts(self) -> list[Any]:
        return []

    get_participating_contexts = get_organizations = get_owned_organizations = get_owned_contexts

    def get_configuration(self) -> Any:
        raise SDOPackage.InterfaceNotImplemented("Configuration")


class Commands:
    """Commands of the process."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer

    def send(self, velocity: tuple[float, float, float]) -> list[str]:
        """Put a velocity into all connected ports; their answers."""
        return self._peer.ports["velocity"].put(RTC.TimedVelocity2D(RTC.Time(0, 0), RTC.Velocity2D(*velocity)))

    def send_octets(self, count: int) -> list[str]:
        """Put octets that are no velocity."""
        return [str(sink.put(bytes(count))) for sink, _ in list(self._peer.ports["velocity"]._sinks.values())]

    def poses(self) -> list[tuple[float, float, float, float]]:
        """Time [s], x, y [m], heading [rad]."""
        values = list(self._peer.ports["pose"].values)
        return [(_seconds(one.tm), one.data.position.x, one.data.position.y, one.data.heading) for one in values]

    def floors(self) -> list[str]:
        return [one.data for one in list(self._peer.ports["floor"].values)]

    def last_range(self) -> dict[str, Any] | None:
        values = self._peer.ports["range"].values
        if not values:
            return None
        last = values[-1]
        return {"time": _seconds(last.tm), "ranges": list(last.ranges), "config": vars(last.config)}

    def connections(self) -> int:
        return sum(len(port.profiles) for port in self._peer.ports.values())


def _list(values: dict[str, str]) -> list[Any]:
    return [SDOPackage.NameValue(name, CORBA.Any(CORBA.TC_string, value)) for name, value in values.items()]


def _texts(profile: Any) -> dict[str, str]:
    return {each.name: each.value.value() for each in profile.properties}


def _seconds(time: Any) -> float:
    return float(time.sec + time.nsec * 1e-9)


if __name__ == "__main__":
    reference = f"NameService=corbaloc::{sys.argv[1]}/NameService"
    orb = CORBA.ORB_init(["peer", "-ORBInitRef", reference, "-ORBendPoint", "giop:tcp:127.0.0.1:"])
    poa = orb.resolve_initial_references("RootPOA")
    poa._get_the_POAManager().activate()
    component = Peer()
    root = orb.resolve_initial_references("NameService")._narrow(CosNaming.NamingContext)
    root.rebind([CosNaming.NameComponent("Peer", "rtc")], component.reference)
    threading.Thread(target=orb.run, daemon=True).start()
    peer = Commands(component)
    answer_commands(peer.send, peer.send_octets, peer.poses, peer.floors, peer.last_range, peer.connections)

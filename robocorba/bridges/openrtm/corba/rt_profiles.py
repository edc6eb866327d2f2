"""Conversion of connections, properties and answers of RT components from and to the IDL."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from omniORB import CORBA

from robocorba.bridges.openrtm.connections import Connection, Peer
from robocorba.bridges.openrtm.life_cycle import ReturnCode, State
from robocorba.stubs import RTC, SDOPackage


def return_code(code: ReturnCode) -> Any:
    return RTC.ReturnCode_t._item(code.value)


def return_code_of(code: Any) -> ReturnCode:
    return ReturnCode(code._v)


def state(state: State) -> Any:
    return RTC.LifeCycleState._item(state.value)


def properties(values: Mapping[str, Any]) -> list[Any]:
    """As an SDOPackage::NVList; texts as strings, and what others have put there as it was."""
    return [
        SDOPackage.NameValue(name, CORBA.Any(CORBA.TC_string, value) if isinstance(value, str) else value)
        for name, value in values.items()
    ]


def properties_of(values: Iterable[Any]) -> dict[str, Any]:
    """By name: texts, and other values as an any."""
    found = {each.name: each.value for each in values}
    return {
        name: value.value() if value.typecode().kind() == CORBA.tk_string else value for name, value in found.items()
    }


def connection_of(profile: Any, peer: Callable[[Any], Peer]) -> Connection:
    """peer: the port of a reference."""
    ports = [peer(port) for port in profile.ports]
    return Connection(profile.name, profile.connector_id, ports, properties_of(profile.properties))


def connector_profile(connection: Connection, reference: Callable[[Any], Any]) -> Any:
    """reference: of a port."""
    ports = [reference(port) for port in connection.ports]
    return RTC.ConnectorProfile(connection.name, connection.id, ports, properties(connection.properties))

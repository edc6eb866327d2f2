"""Connections: all ports of one are connected, or none is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from robocorba.errors.services import NotReachable
from robocorba.openrtm.connections import MAX_CONNECTIONS, MAX_PORTS, MAX_PROPERTIES, Connection, Connections, Refused
from robocorba.openrtm.life_cycle import ReturnCode


class Port:
    """A port that notes what it is asked for, and can refuse it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.is_away = False
        self.refuses: set[str] = set()
        self.begun: dict[str, Mapping[str, Any]] = {}
        self.offered: set[str] = set()
        self.connections = Connections(self, self)

    # what it is to others

    def is_same(self, other: Any) -> bool:
        return self is other

    def is_there(self) -> bool:
        return not self.is_away

    def notify_connect(self, connection: Connection) -> tuple[ReturnCode, Connection]:
        if self.is_away:
            raise NotReachable(self.name)
        return self.connections.notify_connect(connection)

    def notify_disconnect(self, id: str) -> ReturnCode:
        if self.is_away:
            raise NotReachable(self.name)
        return self.connections.notify_disconnect(id)

    # what it does for connections

    def offer(self, connection: Connection) -> Mapping[str, str]:
        self._refuse("offer")
        self.offered.add(connection.id)
        return {self.name: "here"}

    def begin(self, connection: Connection) -> None:
        self._refuse("begin")
        self.begun[connection.id] = connection.properties

    def end(self, id: str) -> None:
        self.offered.discard(id)
        self.begun.pop(id, None)

    def _refuse(self, what: str) -> None:
        if what in self.refuses:
            raise Refused(ReturnCode.UNSUPPORTED)


def three() -> tuple[Port, Port, Port]:
    return Port("a"), Port("b"), Port("c")


def is_free(*ports: Port) -> bool:
    return not any(port.offered or port.begun or port.connections.all() for port in ports)


@pytest.mark.parametrize("caller", [0, 1, 2])
def test_each_port_gets_what_all_have_offered(caller: int) -> None:
    ports = three()
    code, made = ports[caller].connections.connect(Connection("all", "", ports, {"wish": "x"}))
    assert code is ReturnCode.OK
    assert made.id
    for port in ports:
        assert port.begun == {made.id: {"wish": "x", "a": "here", "b": "here", "c": "here"}} or port is not ports[0]
        assert port.connections.find(made.id) is not None
    assert ports[caller].connections.disconnect(made.id) is ReturnCode.OK
    assert is_free(*ports)
    assert ports[caller].connections.disconnect(made.id) is ReturnCode.BAD_PARAMETER


@pytest.mark.parametrize("stage", ["offer", "begin"])
@pytest.mark.parametrize("refusing", [0, 1, 2])
def test_none_is_connected_if_one_refuses(stage: str, refusing: int) -> None:
    ports = three()
    ports[refusing].refuses.add(stage)
    code, _ = ports[0].connections.connect(Connection("all", "", ports, {}))
    assert code is ReturnCode.UNSUPPORTED
    assert is_free(*ports)


def test_none_is_connected_if_one_is_away() -> None:
    ports = three()
    ports[1].is_away = True
    assert ports[0].connections.connect(Connection("all", "1", ports, {}))[0] is ReturnCode.ERROR
    assert is_free(*ports)


def test_the_others_are_disconnected_without_one_that_is_away() -> None:
    ports = three()
    _, made = ports[0].connections.connect(Connection("all", "", ports, {}))
    ports[0].is_away = True
    assert ports[2].connections.disconnect(made.id) is ReturnCode.OK
    assert is_free(ports[1], ports[2])


def test_a_connection_is_lost_with_a_port_that_stays_away() -> None:
    a, b, c = three()
    a.connections.connect(Connection("a b", "1", (b, a), {}))
    a.connections.connect(Connection("a c", "2", (c, a), {}))
    b.is_away = True
    a.connections.disconnect_lost()
    b.is_away, c.is_away = False, True
    a.connections.disconnect_lost()
    assert [one.id for one in a.connections.all()] == ["1", "2"]
    a.connections.disconnect_lost()
    assert [one.id for one in a.connections.all()] == ["1"]


def test_an_id_is_used_once() -> None:
    a, b, _ = three()
    assert a.connections.connect(Connection("all", "1", (a, b), {}))[0] is ReturnCode.OK
    assert a.connections.connect(Connection("again", "1", (a, b), {}))[0] is ReturnCode.PRECONDITION_NOT_MET
    assert [one.name for one in a.connections.all()] == ["all"]
    assert a.connections.disconnect_all() is ReturnCode.OK
    assert is_free(a, b)


def test_what_is_no_connection_is_refused() -> None:
    a, b, c = three()
    for wrong in (
        Connection("none", "", (), {}),
        Connection("others", "", (b, c), {}),
        Connection("many ports", "", (a, *three() * MAX_PORTS), {}),
        Connection("many properties", "", (a,), dict.fromkeys(map(str, range(MAX_PROPERTIES + 1)), "x")),
    ):
        assert a.connections.connect(wrong)[0] is ReturnCode.BAD_PARAMETER
        assert a.connections.notify_connect(wrong._replace(id="1"))[0] is ReturnCode.BAD_PARAMETER
    assert a.connections.notify_connect(Connection("no id", "", (a,), {}))[0] is ReturnCode.BAD_PARAMETER
    assert a.connections.notify_disconnect("1") is ReturnCode.BAD_PARAMETER


def test_a_port_has_a_bound() -> None:
    a = Port("a")
    codes = [a.connections.connect(Connection("", "", (a,), {}))[0] for _ in range(MAX_CONNECTIONS + 1)]
    assert codes == [ReturnCode.OK] * MAX_CONNECTIONS + [ReturnCode.OUT_OF_RESOURCES]

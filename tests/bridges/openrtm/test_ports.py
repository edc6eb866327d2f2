"""Ports without CORBA: all ports of a connection are connected, or none is; and data from port to port."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from robocorba.bridges.openrtm import data_ports
from robocorba.bridges.openrtm.connections import (
    MAX_CONNECTIONS,
    MAX_PORTS,
    MAX_PROPERTIES,
    Connection,
    Connections,
    Refused,
)
from robocorba.bridges.openrtm.data_ports import (
    DATA_TYPE,
    DATAFLOW,
    ENDIAN,
    IN_PORT,
    INTERFACE,
    OUT_PORT,
    InPort,
    OutPort,
)
from robocorba.bridges.openrtm.life_cycle import ReturnCode
from testkit.processes import eventually
from tests.bridges.openrtm.ports import NUMBERS, LocalPeer, Objects


class Port(LocalPeer):
    """A port that notes what it is asked for, and can refuse it."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self.refuses: set[str] = set()
        self.begun: dict[str, Mapping[str, Any]] = {}
        self.offered: set[str] = set()
        self.own = self.connections = Connections(self, self.offer, self.begin, self.end)

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


def connect_all(ports: Sequence[Port], caller: int = 0, id: str = "") -> tuple[ReturnCode, Connection]:
    return ports[caller].own.connect(Connection("all", id, tuple(ports), {"wish": "x"}))


@pytest.mark.parametrize("caller", [0, 1, 2])
def test_each_port_gets_what_all_have_offered(caller: int) -> None:
    ports = three()
    code, made = connect_all(ports, caller)
    assert code is ReturnCode.OK and made.id
    for port in ports:
        assert port.begun == {made.id: {"wish": "x", "a": "here", "b": "here", "c": "here"}} or port is not ports[0]
        assert port.own.find(made.id) is not None
    assert connect_all(ports, caller, made.id)[0] is ReturnCode.PRECONDITION_NOT_MET, "an id is used once"
    assert [one.id for one in ports[caller].own.all()] == [made.id]
    assert ports[caller].own.disconnect(made.id) is ReturnCode.OK
    assert is_free(*ports)
    assert ports[caller].own.disconnect(made.id) is ReturnCode.BAD_PARAMETER
    connect_all(ports)
    assert ports[0].own.disconnect_all() is ReturnCode.OK
    assert is_free(*ports)


@pytest.mark.parametrize(("stage", "code"), [("offer", "UNSUPPORTED"), ("begin", "UNSUPPORTED"), ("away", "ERROR")])
@pytest.mark.parametrize("refusing", [0, 1, 2])
def test_none_is_connected_if_one_refuses_or_is_away(stage: str, code: str, refusing: int) -> None:
    ports = three()
    ports[refusing].refuses.add(stage)
    ports[refusing].is_away = stage == "away"
    assert connect_all(ports, caller=(refusing + 1) % 3)[0] is ReturnCode[code]
    assert is_free(*ports)


def test_a_connection_ends_without_ports_that_are_away_and_is_lost_with_those_that_stay_away() -> None:
    ports = a, b, c = three()
    _, made = connect_all(ports)
    a.is_away = True
    assert c.own.disconnect(made.id) is ReturnCode.OK
    assert is_free(b, c)
    a, b, c = three()
    a.own.connect(Connection("a b", "1", (b, a), {}))
    a.own.connect(Connection("a c", "2", (c, a), {}))
    b.is_away = True
    a.own.disconnect_lost()
    b.is_away, c.is_away = False, True
    a.own.disconnect_lost()
    assert [one.id for one in a.own.all()] == ["1", "2"]
    a.own.disconnect_lost()
    assert [one.id for one in a.own.all()] == ["1"]


def test_what_is_no_connection_is_refused() -> None:
    a, b, c = three()
    for wrong in (
        Connection("none", "", (), {}),
        Connection("others", "", (b, c), {}),
        Connection("many ports", "", (a, *three() * MAX_PORTS), {}),
        Connection("many properties", "", (a,), dict.fromkeys(map(str, range(MAX_PROPERTIES + 1)), "x")),
    ):
        assert a.own.connect(wrong)[0] is ReturnCode.BAD_PARAMETER
        assert a.own.notify_connect(wrong._replace(id="1"))[0] is ReturnCode.BAD_PARAMETER
    assert a.own.notify_connect(Connection("no id", "", (a,), {}))[0] is ReturnCode.BAD_PARAMETER
    assert a.own.notify_disconnect("1") is ReturnCode.BAD_PARAMETER
    codes = [a.own.connect(Connection("", "", (a,), {}))[0] for _ in range(MAX_CONNECTIONS + 1)]
    assert codes == [ReturnCode.OK] * MAX_CONNECTIONS + [ReturnCode.OUT_OF_RESOURCES]


# ---- data ----


class Pair:
    """An out port and an in port."""

    def __init__(self) -> None:
        self.objects = Objects()
        self.got: list[float] = []
        self.out: OutPort[float] = OutPort("out", NUMBERS, self.objects)
        self.into: InPort[float] = InPort("in", NUMBERS, self.objects, self.take)
        self.ports = LocalPeer(self.out), LocalPeer(self.into)

    def take(self, value: float) -> bool:
        self.got.append(value)
        return True

    def connect(self, properties: dict[str, str], *ports: LocalPeer) -> tuple[ReturnCode, Connection]:
        return self.out.connections.connect(Connection("", "", ports or self.ports, properties))


@pytest.mark.parametrize("endian", ["little,big", "big", "", "BIG, little"])
def test_what_is_written_arrives_in_the_byte_order_of_the_connection(endian: str) -> None:
    pair = Pair()
    code, made = pair.connect({ENDIAN: endian})
    assert code is ReturnCode.OK
    assert not pair.objects.served[made.properties[IN_PORT]](b"short")
    pair.out.write(2.5)
    eventually(lambda: pair.got == [2.5], 30.0, "the value")
    pair.out.close()
    assert not pair.objects.served
    pair.out.write(3.5)  # to nobody


def test_the_last_value_is_there_for_who_asks() -> None:
    pair = Pair()
    alone = LocalPeer(pair.out)
    assert pair.connect({}, alone)[0] is ReturnCode.BAD_PARAMETER  # an out port needs somewhere to put data
    code, made = pair.connect({DATAFLOW: "pull", ENDIAN: "big"}, alone)
    assert code is ReturnCode.OK
    get = pair.objects.served[made.properties[OUT_PORT]]
    assert get() is None
    pair.out.write(1.0)
    pair.out.write(2.0)
    assert NUMBERS.decode(get(), False) == 2.0
    pair.out.connections.disconnect(made.id)
    assert not pair.objects.served


@pytest.mark.parametrize(
    ("properties", "code"),
    [
        ({INTERFACE: "shared_memory"}, ReturnCode.UNSUPPORTED),
        ({DATAFLOW: "pull"}, ReturnCode.UNSUPPORTED),  # the in port asks nobody
        ({DATA_TYPE: "IDL:RTC/TimedLong:1.0"}, ReturnCode.BAD_PARAMETER),
        ({ENDIAN: "middle"}, ReturnCode.UNSUPPORTED),
        ({DATA_TYPE: "RTC/TimedDouble"}, ReturnCode.OK),
        ({DATA_TYPE: "TimedDouble", DATAFLOW: "Push"}, ReturnCode.OK),
    ],
)
def test_what_is_not_supported_is_refused(properties: dict[str, str], code: ReturnCode) -> None:
    pair = Pair()
    assert pair.connect(properties)[0] is code
    assert bool(pair.objects.served) == (code is ReturnCode.OK)


def test_one_that_hangs_delays_no_other_and_gets_the_newest_value_later() -> None:
    pair, slow = Pair(), Pair()
    free = threading.Event()

    def take(value: float) -> bool:
        return free.wait(30.0) and slow.take(value)

    hanging: InPort[float] = InPort("hanging", NUMBERS, pair.objects, take)
    assert pair.connect({})[0] is ReturnCode.OK
    assert pair.connect({}, pair.ports[0], LocalPeer(hanging))[0] is ReturnCode.OK
    for number in range(100):
        pair.out.write(float(number))
    eventually(lambda: pair.got[-1:] == [99.0], 30.0, "the last value")
    assert slow.got == []
    free.set()
    eventually(lambda: slow.got[-1:] == [99.0], 30.0, "the last value, later")
    assert len(slow.got) <= 2


def test_a_connection_whose_other_side_is_gone_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_ports, "LOST_S", 0.0)
    pair = Pair()
    _, made = pair.connect({})
    pair.objects.hung.add(made.properties[IN_PORT])
    pair.ports[1].is_away = True
    pair.out.write(1.0)
    eventually(lambda: pair.out.connections.all() == [], 30.0, "no connection")

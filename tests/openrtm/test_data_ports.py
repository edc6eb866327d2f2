"""Data from port to port, without CORBA."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from robocorba.openrtm import data_ports
from robocorba.openrtm.connections import Connection
from robocorba.openrtm.data_ports import DATA_TYPE, DATAFLOW, ENDIAN, IN_PORT, INTERFACE, OUT_PORT, InPort, OutPort
from robocorba.openrtm.life_cycle import ReturnCode
from robocorba.testing.processes import eventually
from tests.openrtm.ports import LocalPeer, NumberType, Objects


class Pair:
    """An out port and an in port."""

    def __init__(self) -> None:
        self.objects = Objects()
        self.got: list[float] = []
        self.out: OutPort[float] = OutPort("out", NumberType(), self.objects)
        self.into: InPort[float] = InPort("in", NumberType(), self.objects, self.take)
        self.ports = LocalPeer(self.out), LocalPeer(self.into)

    def take(self, value: float) -> bool:
        self.got.append(value)
        return True

    def connect(self, **properties: Any) -> tuple[ReturnCode, Connection]:
        wanted = {name.replace("_", "."): value for name, value in properties.items()}
        return self.out.connections.connect(Connection("", "", self.ports, wanted))


def connect(pair: Pair, properties: dict[str, str]) -> tuple[ReturnCode, Connection]:
    return pair.out.connections.connect(Connection("", "", pair.ports, properties))


@pytest.mark.parametrize("endian", ["little,big", "big", "", "BIG, little"])
def test_what_is_written_arrives_in_the_byte_order_of_the_connection(endian: str) -> None:
    pair = Pair()
    assert connect(pair, {ENDIAN: endian})[0] is ReturnCode.OK
    pair.out.write(2.5)
    eventually(lambda: pair.got == [2.5], 30.0, "the value")
    pair.out.close()
    assert not pair.objects.served
    pair.out.write(3.5)  # to nobody


def test_the_last_value_is_there_for_who_asks() -> None:
    pair = Pair()
    alone = LocalPeer(pair.out)
    code, made = pair.out.connections.connect(Connection("", "", (alone,), {DATAFLOW: "pull", ENDIAN: "big"}))
    assert code is ReturnCode.OK
    get = pair.objects.served[made.properties[OUT_PORT]]
    assert get() is None
    pair.out.write(1.0)
    pair.out.write(2.0)
    assert NumberType().decode(get(), is_little=False) == 2.0
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
    assert connect(pair, properties)[0] is code
    assert bool(pair.objects.served) == (code is ReturnCode.OK)


def test_an_out_port_needs_somewhere_to_put_data() -> None:
    pair = Pair()
    assert pair.out.connections.connect(Connection("", "", (LocalPeer(pair.out),), {}))[0] is ReturnCode.BAD_PARAMETER


def test_data_of_another_length_are_refused() -> None:
    pair = Pair()
    _, made = connect(pair, {})
    put = pair.objects.served[made.properties[IN_PORT]]
    assert [put(b"short"), put(NumberType().encode(1.0, True))] == [False, True]
    assert pair.got == [1.0]


def test_one_that_hangs_delays_no_other_and_gets_the_newest_value_later() -> None:
    pair, slow = Pair(), Pair()
    free = threading.Event()

    def take(value: float) -> bool:
        return free.wait(30.0) and slow.take(value)

    hanging: InPort[float] = InPort("hanging", NumberType(), pair.objects, take)
    assert connect(pair, {})[0] is ReturnCode.OK
    others = (pair.ports[0], LocalPeer(hanging))
    assert pair.out.connections.connect(Connection("", "", others, {}))[0] is ReturnCode.OK
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
    _, made = connect(pair, {})
    pair.objects.hung.add(made.properties[IN_PORT])
    pair.ports[1].is_away = True
    pair.out.write(1.0)
    eventually(lambda: pair.out.connections.all() == [], 30.0, "no connection")

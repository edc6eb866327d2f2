"""Servants of events: consumers, gateways between channels, and proxies after their end."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import omniORB
import pytest
from omniORB import CORBA, any
from omniORB import tcInternal as tc

from robocorba.events.channel_store import ChannelStore
from robocorba.events.corba import events
from robocorba.events.corba.event_client import REMEMBERED_CALLS, _EventConsumerServant
from robocorba.events.corba.event_gateway_servant import PeerGatewayServant
from robocorba.events.corba.event_proxy_servants import (
    PullConsumerServant,
    PullSupplierServant,
    PushConsumerServant,
    PushSupplierServant,
)
from robocorba.events.event import MAX_PAYLOAD_BYTES, EventBatch, EventHeader
from robocorba.events.federation import Advertisement
from robocorba.events.policies import ProxyPolicy
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import ProxyKind
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import Pattern
from robocorba.stubs import RoboCorba
from tests.events.samples import Consumer, Supplier, open_channel

pytestmark = pytest.mark.usefixtures("orb")


class Receiver:
    """A servant, and what it has passed on."""

    def __init__(self) -> None:
        self.payloads: list[Any] = []
        self.together: list[tuple[int, list[Any]]] = []
        self.servant = _EventConsumerServant(
            lambda event: self.payloads.append(event.payload),
            lambda which, found: self.together.append((which, [event.payload for event in found])),
        )


def header(number: int, time: float = 1.0, origin: str = "lab") -> Any:
    return RoboCorba.EventHeader("t", "A", origin, number, time, 0, 0.0, RoboCorba.MSGPACK)


def run(number: int, *payloads: int, time: float = 1.0, origin: str = "lab") -> Any:
    packed = [msgpack.packb(payload) for payload in payloads]
    return RoboCorba.EventRun(header(number, time, origin), [time] * len(packed), packed)


def test_what_a_consumer_has_had_before_is_ignored() -> None:
    receiver = Receiver()
    for call in ([run(1, 10, 11), run(5, 12)], [run(6, 13)], [run(1, 10, 11), run(5, 12)], [run(6, 13)], []):
        receiver.servant.pushRuns(call)
    assert receiver.payloads == [10, 11, 12, 13]
    for other in (run(1, 20, origin="hall"), run(2, 20), run(1, 20, time=2.0)):
        receiver = Receiver()
        receiver.servant.pushRuns([run(1, 10)])
        receiver.servant.pushRuns([other])
        assert receiver.payloads == [10, 20]
    receiver = Receiver()
    pair = [RoboCorba.Event(header(number), msgpack.packb(number)) for number in (1, 2)]
    for which in (0, 1, 0):
        receiver.servant.pushTogether(which, pair)
    assert receiver.together == [(0, [1, 2]), (1, [1, 2])]
    receiver = Receiver()
    for number in range(1, 2 * REMEMBERED_CALLS):
        receiver.servant.pushRuns([run(number, number)])
    assert len(receiver.servant._known) == REMEMBERED_CALLS
    receiver.servant.pushRuns([run(REMEMBERED_CALLS, 0)])  # the oldest that it remembers
    assert receiver.payloads == list(range(1, 2 * REMEMBERED_CALLS))


#: As of a life in the upper half.
FIRST = (1 << 64) - 10


def batch(**targets: int) -> EventBatch:
    result = EventBatch(EventHeader("t", "s", "lab"), [1.0, 2.0], [b"x", b"y"], FIRST, epoch=1.0)
    result.targets, result.hops = targets, 3
    return result


def forward(ways: list[Any], runs: list[Any]) -> tuple[list[EventBatch], int]:
    """The batches that a gateway is given, and how many events are invalid."""
    found: list[tuple[list[EventBatch], int]] = []
    links: Any = SimpleNamespace(forward=lambda session, position, *given: found.append(given))
    PeerGatewayServant(links).forwardOn("s1", 1, [1.0] * len(runs), ways, runs)
    (given,) = found
    return given


def across(typecode: Any, value: Any) -> Any:
    """A value after its way over the wire."""
    return omniORB.cdrUnmarshal(typecode, omniORB.cdrMarshal(typecode, value))


def test_targets_and_advertisements_arrive_and_events_for_impossible_names_are_refused() -> None:
    for targets in ({"hall": FIRST - 1, "yard": 0}, {}):
        sent = [batch(**targets)]
        ways = across(RoboCorba._tc_EventWaySeq, events.event_ways(sent))
        ((came,), invalid) = forward(ways, across(RoboCorba._tc_EventRunSeq, events.event_runs(sent)))
        assert (came.targets, came.hops, came.first, came.payloads) == (targets, 3, FIRST, [b"x", b"y"])
        assert invalid == 0
    named = ([RoboCorba.EventWay([RoboCorba.EventTarget(name, 0)], 0)] for name in ("", "a/b", "x" * 61))
    for ways in (*named, []):
        assert forward(ways, events.event_runs([batch()])) == ([], 2)
    notices = [Advertisement("lab", 1 << 40, ("hall", "yard"), (Pattern("t", "*"),), ("yard",))]
    assert events.advertisements_of(across(RoboCorba._tc_LinkNoticeSeq, events.advertisements(notices))) == notices


CALLS: dict[ProxyKind, tuple[Any, type, str, dict[str, tuple[Any, ...]]]] = {
    ProxyKind.PUSH_CONSUMER: (
        *(PushConsumerServant, Supplier, "disconnect_push_consumer"),
        {"connect_push_supplier": ("another",), "push": (any.to_any(1),), "state": ()},
    ),
    ProxyKind.PULL_CONSUMER: (
        *(PullConsumerServant, Supplier, "disconnect_pull_consumer"),
        {"connect_pull_supplier": ("another",)},
    ),
    ProxyKind.PUSH_SUPPLIER: (
        *(PushSupplierServant, Consumer, "disconnect_push_supplier"),
        {"connect_push_consumer": ("another",), "suspend": (), "resume": (), "state": (), "changeSubscription": ([],)},
    ),
    ProxyKind.PULL_SUPPLIER: (
        *(PullSupplierServant, Consumer, "disconnect_pull_supplier"),
        {"connect_pull_consumer": ("another",), "pull": (), "try_pull": (), "state": (), "changeSubscription": ([],)},
    ),
}
OCTETS = tc.createTypeCode((tc.tv_sequence, tc.tv_octet, 0))


def client_of(kind: ProxyKind, reference: str) -> Any:
    return CALLS[kind][1]()


@pytest.fixture
def proxies(tmp_path: Path) -> Iterator[Proxies]:
    with ExitStack() as stack:
        store = stack.enter_context(ChannelStore(tmp_path / "lab.sqlite"))
        channel = stack.enter_context(open_channel(tmp_path, store.first_number()))
        yield Proxies(channel, store, QueuePolicy(100), lambda: None, lambda id: None, ProxyPolicy())


@pytest.mark.parametrize(
    ("kind", "operation"),
    [(kind, operation) for kind, (_, _, end, calls) in CALLS.items() for operation in (end, *calls)],
)
def test_a_proxy_that_was_disconnected_does_not_exist(proxies: Proxies, kind: ProxyKind, operation: str) -> None:
    make, _, disconnect, calls = CALLS[kind]
    proxy = proxies.obtain(kind)
    in_force = (lambda proxy, peer: False,) if kind is ProxyKind.PUSH_SUPPLIER else ()
    servant = make(proxy, proxies, client_of, *in_force)
    proxies.connect(proxy, client_of(kind, "its"))
    getattr(servant, disconnect)()
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        getattr(servant, operation)(*calls.get(operation, ()))


def _supplier(proxies: Proxies) -> PushConsumerServant:
    proxy = proxies.obtain(ProxyKind.PUSH_CONSUMER)
    proxies.connect(proxy, None)
    return PushConsumerServant(proxy, proxies, client_of)


def _event(payload: bytes) -> Any:
    return RoboCorba.Event(RoboCorba.EventHeader("t", "", "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK), payload)


def test_events_that_are_too_large_or_could_not_be_sent_to_consumers_are_refused(proxies: Proxies) -> None:
    servant = _supplier(proxies)
    # omniORBpy 4.3 sends other numbers in place of the largest ones in a sequence, and raises SystemError.
    numbers = tc.createTypeCode((tc.tv_sequence, tc.tv_ulonglong, 0))
    for value in (CORBA.Any(CORBA.TC_string, "a\0b"), CORBA.Any(numbers, [2**64 - 1])):
        with pytest.raises(CORBA.BAD_PARAM):
            servant.push(value)
    large = bytes(MAX_PAYLOAD_BYTES + 1)
    for value in (CORBA.Any(OCTETS, large), CORBA.Any(RoboCorba._tc_Event, _event(large))):
        with pytest.raises(CORBA.IMP_LIMIT):
            servant.push(value)
    with pytest.raises(RoboCorba.InvalidEvent) as refused:
        servant.pushEvent(_event(large))
    assert refused.value.reason == f"has {len(large)} bytes; at most {MAX_PAYLOAD_BYTES} are allowed"
    one, two = _event(b"a"), _event(large)
    with pytest.raises(RoboCorba.InvalidEvent):
        servant.pushRuns([RoboCorba.EventRun(one.header, [0.0, 0.0], [one.payload, two.payload])])
    assert servant.state().events.received == 0
    for value in (CORBA.Any(OCTETS, large[:-100]), CORBA.Any(RoboCorba._tc_Event, _event(large[:-1]))):
        servant.push(value)
    assert servant.state().events.received == 2

"""Servants of proxies after the end of their proxies: calls reach them until the call that ended it has returned."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from omniORB import CORBA, any
from omniORB import tcInternal as tc

from robocorba.corba.orb import Orb
from robocorba.corba.servants.event_proxies import (
    PullConsumerServant,
    PullSupplierServant,
    PushConsumerServant,
    PushSupplierServant,
)
from robocorba.events.channel_store import ChannelStore
from robocorba.events.event import MAX_PAYLOAD_BYTES
from robocorba.events.policies import ProxyPolicy
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import ProxyKind
from robocorba.events.queue import QueuePolicy
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from tests.events.samples import Consumer, Supplier, open_channel

#: Of each kind: its servant, its client, how to disconnect it, and other calls.
CALLS: dict[ProxyKind, tuple[Any, type, str, dict[str, tuple[Any, ...]]]] = {
    ProxyKind.PUSH_CONSUMER: (
        PushConsumerServant,
        Supplier,
        "disconnect_push_consumer",
        {"connect_push_supplier": ("another",), "push": (any.to_any(1),), "state": ()},
    ),
    ProxyKind.PULL_CONSUMER: (
        PullConsumerServant,
        Supplier,
        "disconnect_pull_consumer",
        {"connect_pull_supplier": ("another",)},
    ),
    ProxyKind.PUSH_SUPPLIER: (
        PushSupplierServant,
        Consumer,
        "disconnect_push_supplier",
        {"connect_push_consumer": ("another",), "suspend": (), "resume": (), "state": (), "changeSubscription": ([],)},
    ),
    ProxyKind.PULL_SUPPLIER: (
        PullSupplierServant,
        Consumer,
        "disconnect_pull_supplier",
        {"connect_pull_consumer": ("another",), "pull": (), "try_pull": (), "state": (), "changeSubscription": ([],)},
    ),
}


OCTETS = tc.createTypeCode((tc.tv_sequence, tc.tv_octet, 0))


class Clients:
    """Clients whose references are their names."""

    def of(self, kind: ProxyKind, reference: str) -> Any:
        return CALLS[kind][1]()


@pytest.fixture(scope="module", autouse=True)
def orb() -> Iterator[Orb]:
    """omniORB can't encode anything without one."""
    with Orb(Address("127.0.0.1", 1)) as orb:
        yield orb


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
    servant = make(proxy, proxies, Clients(), *in_force)
    proxies.connect(proxy, Clients().of(kind, "its"))
    getattr(servant, disconnect)()
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        getattr(servant, operation)(*calls.get(operation, ()))


def _supplier(proxies: Proxies) -> PushConsumerServant:
    proxy = proxies.obtain(ProxyKind.PUSH_CONSUMER)
    proxies.connect(proxy, None)
    return PushConsumerServant(proxy, proxies, Clients())


def _event(payload: bytes) -> Any:
    return RoboCorba.Event(RoboCorba.EventHeader("t", "", "", 0, 0.0, 0, 0.0, RoboCorba.MSGPACK), payload)


def test_no_event_may_be_larger_than_the_limit(proxies: Proxies) -> None:
    servant = _supplier(proxies)
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


def test_what_could_not_be_sent_to_consumers_is_refused(proxies: Proxies) -> None:
    """omniORBpy 4.3 sends other numbers in place of the largest ones in a sequence, and raises SystemError."""
    servant = _supplier(proxies)
    numbers = tc.createTypeCode((tc.tv_sequence, tc.tv_ulonglong, 0))
    for value in (CORBA.Any(CORBA.TC_string, "a\0b"), CORBA.Any(numbers, [2**64 - 1])):
        with pytest.raises(CORBA.BAD_PARAM):
            servant.push(value)
    assert servant.state().events.received == 0

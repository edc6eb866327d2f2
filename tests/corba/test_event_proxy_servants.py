"""Servants of proxies after the end of their proxies: calls reach them until the call that ended it has returned."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from omniORB import CORBA, any

from robocorba.corba.servants.event_proxies import (
    PullConsumerServant,
    PullSupplierServant,
    PushConsumerServant,
    PushSupplierServant,
)
from robocorba.events.channel_store import ChannelStore
from robocorba.events.policies import ProxyPolicy
from robocorba.events.proxies import Proxies
from robocorba.events.proxy import ProxyKind
from robocorba.events.queue import QueuePolicy
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


class Clients:
    """Clients whose references are their names."""

    def of(self, kind: ProxyKind, reference: str) -> Any:
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
    servant = make(proxy, proxies, Clients(), *in_force)
    proxies.connect(proxy, Clients().of(kind, "its"))
    getattr(servant, disconnect)()
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        getattr(servant, operation)(*calls.get(operation, ()))

"""Lower bound for a channel in Python on omniORB: a servant that forwards each event without any state.

python -m bench.events.channel.peers.relay PORT is that process.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import CosEventChannelAdmin
import CosEventChannelAdmin__POA

from bench.events.channel.peers.base import Broker, Receive, Start, free_port, listening
from bench.events.channel.peers.cos import PlainConsumer, PlainSupplier
from robocorba.corba.orb import Orb
from robocorba.settings import Address


class Entrance(CosEventChannelAdmin__POA.ProxyPushConsumer):
    """Its `push` is the method of the consumer, once connected."""

    def connect_push_supplier(self, supplier: Any) -> None:
        pass

    def disconnect_push_consumer(self) -> None:
        pass


class Exit(CosEventChannelAdmin__POA.ProxyPushSupplier):
    """Connects the one consumer."""

    def __init__(self, entrance: Entrance) -> None:
        self._entrance = entrance

    def connect_push_consumer(self, consumer: Any) -> None:
        self._entrance.push = consumer.push

    def disconnect_push_supplier(self) -> None:
        pass


class Ends:
    """The channel object of the clients, from which they obtain the proxies."""

    def __init__(self, orb: Orb, address: str) -> None:
        self._orb, self._address = orb, address

    def for_suppliers(self) -> Ends:
        return self

    for_consumers = for_suppliers

    def obtain_push_consumer(self) -> Any:
        return self._orb.reference(f"{self._address}/entrance", CosEventChannelAdmin.ProxyPushConsumer)

    def obtain_push_supplier(self) -> Any:
        return self._orb.reference(f"{self._address}/exit", CosEventChannelAdmin.ProxyPushSupplier)


class BareRelay:
    name, batches = "a bare Python relay", False

    def missing(self) -> str:
        return ""

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        port = free_port()
        pid = start(sys.executable, "-m", "bench.events.channel.peers.relay", str(port))
        listening(port)
        yield Broker(f"corbaloc::127.0.0.1:{port}", pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[PlainSupplier]:
        with orb_without_names() as orb:
            yield PlainSupplier(Ends(orb, address))

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        with orb_without_names() as orb:
            PlainConsumer(orb, Ends(orb, address), receive)
            yield


def orb_without_names(endpoint: Address | None = None) -> Orb:
    """An ORB without naming service (port 1 is unused); objects are called by corbaloc."""
    return Orb(Address("127.0.0.1", 1), endpoint)


PEER = BareRelay()

if __name__ == "__main__":
    with orb_without_names(Address("127.0.0.1", int(sys.argv[1]))) as orb:
        entrance = Entrance()
        orb.activate(entrance, "entrance")
        orb.activate(Exit(entrance), "exit")
        orb.run()

"""A bare relay: python -m testkit.peers.forwarder PORT

The lower bound for a channel in Python on omniORB: a servant that forwards each event without any state."""

from __future__ import annotations

import sys
from typing import Any

import omniORB  # noqa: F401  makes the OMG stubs importable
from CosEventChannelAdmin__POA import ProxyPushConsumer, ProxyPushSupplier

from robocorba.orb.orb import Orb
from robocorba.system.settings import Address


class Entrance(ProxyPushConsumer):
    """Its `push` is the method of the consumer, once connected."""

    def connect_push_supplier(self, supplier: Any) -> None:
        pass

    def disconnect_push_consumer(self) -> None:
        pass


class Exit(ProxyPushSupplier):
    """Connects the one consumer."""

    def __init__(self, entrance: Entrance) -> None:
        self._entrance = entrance

    def connect_push_consumer(self, consumer: Any) -> None:
        self._entrance.push = consumer.push

    def disconnect_push_supplier(self) -> None:
        pass


def relay(port: str) -> None:
    with orb_without_names(Address("127.0.0.1", int(port))) as orb:
        entrance = Entrance()
        orb.activate(entrance, "entrance")
        orb.activate(Exit(entrance), "exit")
        orb.run()


def orb_without_names(endpoint: Address | None = None) -> Orb:
    """An ORB without naming service (port 1 is unused); objects are called by corbaloc."""
    return Orb(Address("127.0.0.1", 1), endpoint)


if __name__ == "__main__":
    relay(sys.argv[1])

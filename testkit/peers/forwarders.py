"""Brokers that are Python programs: python -m testkit.peers.forwarders relay|zenoh|zeromq PORT [PORT]

`relay` is the lower bound for a channel in Python on omniORB: a servant that forwards each event without any state."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
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


def zenoh(port: str) -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM, signal.SIGINT])
    with zenoh_session("router", "listen", f"127.0.0.1:{port}"):
        signal.sigwait([signal.SIGTERM, signal.SIGINT])


def zenoh_session(mode: str, how: str, address: str) -> Any:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5(f"{how}/endpoints", f'["tcp/{address}"]')
    config.insert_json5("scouting/multicast/enabled", "false")  # it would find other processes in this network
    return zenoh.open(config)


def zeromq(publishers: str, subscribers: str) -> None:
    import zmq

    with zmq_context() as context:
        incoming, outgoing = zmq_socket(context, zmq.XSUB), zmq_socket(context, zmq.XPUB)
        incoming.bind(f"tcp://127.0.0.1:{publishers}")
        outgoing.bind(f"tcp://127.0.0.1:{subscribers}")
        zmq.proxy(incoming, outgoing)


@contextlib.contextmanager
def zmq_context() -> Iterator[Any]:
    import zmq

    context = zmq.Context()
    try:
        yield context
    finally:
        context.destroy(linger=0)


def zmq_socket(context: Any, kind: int) -> Any:
    import zmq

    socket = context.socket(kind)
    for option in (zmq.SNDHWM, zmq.RCVHWM):
        socket.setsockopt(option, 0)  # no limit; by default a queue drops messages beyond 1000
    return socket


if __name__ == "__main__":
    programs: dict[str, Callable[..., None]] = {"relay": relay, "zenoh": zenoh, "zeromq": zeromq}
    programs[sys.argv[1]](*sys.argv[2:])

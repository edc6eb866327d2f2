"""Zenoh: clients of a router in a process of its own.

python -m bench.events.channel.peers.zenoh PORT    the router
"""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.events.channel.peers.base import Broker, OneByOne, Receive, Start, free_port, lacking, listening

_KEY = "bench/events"
_CONNECT_LIMIT_S = 10.0


class _Supplier(OneByOne):
    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def push(self, payload: bytes) -> None:
        self._publisher.put(payload)


class Zenoh:
    name, batches = "Zenoh router", False

    def missing(self) -> str:
        return lacking(modules=["zenoh"])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        port = free_port()
        pid = start(sys.executable, "-m", __name__, str(port))
        listening(port)
        yield Broker(f"127.0.0.1:{port}", pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[_Supplier]:
        import zenoh

        with _session("client", "connect", address) as session:
            publisher = session.declare_publisher(_KEY, congestion_control=zenoh.CongestionControl.BLOCK)
            deadline = time.monotonic() + _CONNECT_LIMIT_S
            while not publisher.matching_status.matching and time.monotonic() < deadline:
                time.sleep(0.02)
            yield _Supplier(publisher)

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        with _session("client", "connect", address) as session:
            subscriber = session.declare_subscriber(_KEY, lambda sample: receive((sample.payload.to_bytes(),)))
            try:
                yield
            finally:
                subscriber.undeclare()


def _session(mode: str, how: str, address: str) -> Any:
    import zenoh

    config = zenoh.Config()
    for key, value in (
        ("mode", f'"{mode}"'),
        (f"{how}/endpoints", f'["tcp/{address}"]'),
        ("scouting/multicast/enabled", "false"),  # it would find other Zenoh processes in this network
    ):
        config.insert_json5(key, value)
    return zenoh.open(config)


def route(port: str) -> None:
    with _session("router", "listen", f"127.0.0.1:{port}"):
        signal.sigwait([signal.SIGTERM, signal.SIGINT])


PEER = Zenoh()

if __name__ == "__main__":
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM, signal.SIGINT])
    route(*sys.argv[1:])

"""Redis publish and subscribe."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bench.events.channel.peers.base import (
    Broker,
    OneByOne,
    Receive,
    Start,
    free_port,
    lacking,
    listening,
    program,
    split,
)

_TOPIC = "bench"


class _Supplier(OneByOne):
    def __init__(self, client: Any) -> None:
        self._client = client

    def push(self, payload: bytes) -> None:
        self._client.publish(_TOPIC, payload)

    def push_run(self, payloads: Sequence[bytes]) -> None:
        with self._client.pipeline(transaction=False) as pipeline:
            for payload in payloads:
                pipeline.publish(_TOPIC, payload)
            pipeline.execute()


class Redis:
    name, batches = "Redis", True

    def missing(self) -> str:
        return lacking(programs=["redis-server"], modules=["redis"])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        port = free_port()
        # Never disconnect a slow subscriber: only losses of the delivery should count.
        limits = ("--client-output-buffer-limit", "pubsub", "0", "0", "0")
        quiet = ("--bind", "127.0.0.1", "--save", "", "--appendonly", "no", "--dir", str(folder))
        pid = start(program("redis-server"), "--port", str(port), *quiet, *limits)
        listening(port)
        yield Broker(f"127.0.0.1:{port}", pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[_Supplier]:
        with self._client(address) as client:
            yield _Supplier(client)

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        client = self._client(address)
        subscription = client.pubsub(ignore_subscribe_messages=True)
        subscription.subscribe(_TOPIC)
        subscription.get_message(timeout=5.0)  # the confirmation

        def listen() -> None:
            for message in subscription.listen():
                receive((message["data"],))

        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        try:
            yield
        finally:
            subscription.unsubscribe()  # ends listen()
            thread.join(5)
            subscription.close()
            client.close()

    @staticmethod
    def _client(address: str) -> Any:
        import redis

        host, port = split(address)
        return redis.Redis(host, port)


PEER = Redis()

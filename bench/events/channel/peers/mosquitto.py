"""MQTT through mosquitto, quality of service 0."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
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
_CONNECT_LIMIT_S = 10.0


class _Supplier(OneByOne):
    def __init__(self, client: Any) -> None:
        self._client = client

    def push(self, payload: bytes) -> None:
        self._client.publish(_TOPIC, payload)


class Mosquitto:
    name, batches = "MQTT, mosquitto", False

    def missing(self) -> str:
        return lacking(programs=["mosquitto"], modules=["paho"])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        port = free_port()
        settings = folder / f"mosquitto-{port}.conf"
        # No limits, so that a slow subscriber loses no messages, as with the other brokers.
        settings.write_text(
            f"listener {port} 127.0.0.1\nallow_anonymous true\nset_tcp_nodelay true\n"
            "max_queued_messages 0\nmax_inflight_messages 0\n"
        )
        pid = start(program("mosquitto"), "-c", str(settings))
        listening(port)
        yield Broker(f"127.0.0.1:{port}", pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[_Supplier]:
        client = self._client()
        client.connect(*split(address), keepalive=0)
        deadline = time.monotonic() + _CONNECT_LIMIT_S
        while not client.is_connected() and time.monotonic() < deadline:
            client.loop(0.1)
        self._no_delay(client)
        try:
            yield _Supplier(client)  # without a network thread, publish() writes to the socket directly
        finally:
            client.disconnect()

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        client = self._client()
        subscribed = threading.Event()
        client.on_message = lambda _client, _data, message: receive((message.payload,))
        client.on_subscribe = lambda *_: subscribed.set()
        client.connect(*split(address))
        client.loop_start()
        try:
            client.subscribe(_TOPIC)
            if not subscribed.wait(_CONNECT_LIMIT_S):
                raise TimeoutError("mosquitto did not confirm the subscription")
            yield
        finally:
            client.disconnect()
            client.loop_stop()

    @staticmethod
    def _client() -> Any:
        from paho.mqtt import client, enums

        return client.Client(enums.CallbackAPIVersion.VERSION2)

    @staticmethod
    def _no_delay(client: Any) -> None:
        client.socket().setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


PEER = Mosquitto()

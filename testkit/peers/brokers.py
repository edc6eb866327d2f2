"""The brokers of others that do not speak CORBA: MQTT and Redis."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from testkit.peers.base import START_LIMIT_S, Peer, Receive, Supplier, server, split
from testkit.processes import eventually

TOPIC = "bench/events"


@contextlib.contextmanager
def _thread(target: Callable[[], object], end: Callable[[], object]) -> Iterator[None]:
    """A thread that runs `target` until `end` was called."""
    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end()
        thread.join(START_LIMIT_S)


# ---- MQTT, quality of service 0 ----


def _mqtt_client() -> Any:
    from paho.mqtt import client, enums

    return client.Client(enums.CallbackAPIVersion.VERSION2)


@contextlib.contextmanager
def mqtt_supplier(address: str) -> Iterator[Supplier]:
    client = _mqtt_client()
    client.connect(*split(address), keepalive=0)
    eventually(lambda: client.loop(0.1) or client.is_connected(), START_LIMIT_S, "a connection to mosquitto")
    client.socket().setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        yield Supplier(lambda payload: client.publish(TOPIC, payload))  # without a network thread it writes directly
    finally:
        client.disconnect()


@contextlib.contextmanager
def mqtt_consumer(address: str, receive: Receive) -> Iterator[None]:
    client, subscribed = _mqtt_client(), threading.Event()
    client.on_message = lambda _client, _data, message: receive((message.payload,))
    client.on_subscribe = lambda *_: subscribed.set()
    client.connect(*split(address))
    client.loop_start()
    try:
        client.subscribe(TOPIC)
        if not subscribed.wait(START_LIMIT_S):
            raise TimeoutError("mosquitto did not confirm the subscription")
        yield
    finally:
        client.disconnect()
        client.loop_stop()


#: No limits, so that a slow subscriber loses no messages, as with the other brokers.
MOSQUITTO_SETTINGS = """listener {0} 127.0.0.1
allow_anonymous true
set_tcp_nodelay true
max_queued_messages 0
max_inflight_messages 0
"""
MQTT = Peer(
    "MQTT, mosquitto",
    server("mosquitto", "-c", "{file}", settings=MOSQUITTO_SETTINGS),
    mqtt_supplier,
    mqtt_consumer,
    programs=["mosquitto"],
    modules=["paho"],
)


# ---- Redis publish and subscribe ----


def _redis_client(address: str) -> Any:
    import redis

    return redis.Redis(*split(address))


@contextlib.contextmanager
def redis_supplier(address: str) -> Iterator[Supplier]:
    with _redis_client(address) as client:

        def push_run(payloads: Sequence[bytes]) -> None:
            with client.pipeline(transaction=False) as pipeline:
                for payload in payloads:
                    pipeline.publish(TOPIC, payload)
                pipeline.execute()

        yield Supplier(lambda payload: client.publish(TOPIC, payload), push_run)


@contextlib.contextmanager
def redis_consumer(address: str, receive: Receive) -> Iterator[None]:
    with _redis_client(address) as client, client.pubsub(ignore_subscribe_messages=True) as subscription:
        subscription.subscribe(TOPIC)
        subscription.get_message(timeout=5.0)  # the confirmation

        def listen() -> None:
            for message in subscription.listen():
                receive((message["data"],))

        with _thread(listen, subscription.unsubscribe):
            yield


#: A slow subscriber is never disconnected: only losses of the delivery should count.
REDIS_SETTINGS = """port {0}
bind 127.0.0.1
save ""
appendonly no
client-output-buffer-limit pubsub 0 0 0
"""
REDIS = Peer(
    "Redis",
    server("redis-server", "{file}", "--dir", "{folder}", settings=REDIS_SETTINGS),
    redis_supplier,
    redis_consumer,
    programs=["redis-server"],
    modules=["redis"],
)

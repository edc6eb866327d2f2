"""The brokers of others that do not speak CORBA: MQTT, NATS, Redis, Zenoh, ZeroMQ."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from testkit.json_process import checkout_command
from testkit.peers.base import START_LIMIT_S, Peer, Receive, Supplier, server, split
from testkit.peers.forwarders import zenoh_session, zmq_context, zmq_socket
from testkit.processes import eventually

TOPIC = "bench/events"
#: Number of events after which a flood lets the client of NATS write.
NATS_TOGETHER = 100
_FORWARDER = checkout_command("testkit.peers.forwarders")


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


# ---- NATS, core publish and subscribe ----


async def _nats_client(address: str) -> Any:
    import nats

    return await nats.connect(f"nats://{address}")


@contextlib.contextmanager
def nats_supplier(address: str) -> Iterator[Supplier]:
    loop = asyncio.new_event_loop()
    client = loop.run_until_complete(_nats_client(address))

    async def push(payload: bytes) -> None:
        await client.publish(TOPIC, payload)
        for _ in range(3):  # let the writer task run
            await asyncio.sleep(0)

    async def flood(payloads: Iterable[bytes]) -> None:
        for place, payload in enumerate(payloads):
            await client.publish(TOPIC, payload)
            if place % NATS_TOGETHER == 0:
                await asyncio.sleep(0)
        await client.flush(60)

    run = loop.run_until_complete
    try:
        yield Supplier(lambda payload: run(push(payload)), flood_all=lambda payloads: run(flood(payloads)))
    finally:
        run(client.close())
        loop.close()


@contextlib.contextmanager
def nats_consumer(address: str, receive: Receive) -> Iterator[None]:
    loop = asyncio.new_event_loop()

    async def take(message: Any) -> None:
        receive((message.data,))

    async def subscribe() -> Any:
        client = await _nats_client(address)
        # No limits of the client: only losses of the delivery should count.
        await client.subscribe(TOPIC, cb=take, pending_msgs_limit=-1, pending_bytes_limit=-1)
        await client.flush(START_LIMIT_S)
        return client

    def run(work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, loop).result(START_LIMIT_S)

    with _thread(loop.run_forever, lambda: loop.call_soon_threadsafe(loop.stop)):
        client = run(subscribe())
        try:
            yield
        finally:
            run(client.close())


NATS = Peer(
    "NATS",
    server("nats-server", "-a", "127.0.0.1", "-p", "{0}"),
    nats_supplier,
    nats_consumer,
    programs=["nats-server"],
    modules=["nats"],
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


# ---- Zenoh: clients of a router in a process of its own ----


@contextlib.contextmanager
def zenoh_supplier(address: str) -> Iterator[Supplier]:
    import zenoh

    with zenoh_session("client", "connect", address) as session:
        publisher = session.declare_publisher(TOPIC, congestion_control=zenoh.CongestionControl.BLOCK)
        eventually(lambda: publisher.matching_status.matching, START_LIMIT_S, "a subscriber of Zenoh")
        yield Supplier(publisher.put)


@contextlib.contextmanager
def zenoh_consumer(address: str, receive: Receive) -> Iterator[None]:
    with zenoh_session("client", "connect", address) as session:
        subscriber = session.declare_subscriber(TOPIC, lambda sample: receive((sample.payload.to_bytes(),)))
        try:
            yield
        finally:
            subscriber.undeclare()


ZENOH = Peer("Zenoh router", server(*_FORWARDER, "zenoh", "{0}"), zenoh_supplier, zenoh_consumer, modules=["zenoh"])


# ---- ZeroMQ: publishers and subscribers around a forwarder in a process of its own ----


@contextlib.contextmanager
def zeromq_supplier(address: str) -> Iterator[Supplier]:
    import zmq

    with zmq_context() as context:
        socket = zmq_socket(context, zmq.XPUB)
        socket.connect(f"tcp://{address.split(',')[0]}")
        # It connects in the background and loses events before the forwarder passes a consumer's subscription on.
        if not socket.poll(int(START_LIMIT_S * 1000)):
            raise TimeoutError("no subscription reached the publisher")
        yield Supplier(socket.send)


@contextlib.contextmanager
def zeromq_consumer(address: str, receive: Receive) -> Iterator[None]:
    import zmq

    with zmq_context() as context:
        socket, ended = zmq_socket(context, zmq.SUB), threading.Event()
        socket.connect(f"tcp://{address.split(',')[1]}")
        socket.setsockopt(zmq.SUBSCRIBE, b"")

        def listen() -> None:
            while not ended.is_set():
                if socket.poll(200):
                    with contextlib.suppress(zmq.Again):
                        while True:
                            receive((socket.recv(zmq.DONTWAIT),))

        with _thread(listen, ended.set):
            yield


ZEROMQ = Peer(
    "ZeroMQ forwarder",
    server(*_FORWARDER, "zeromq", "{0}", "{1}", ports=2),
    zeromq_supplier,
    zeromq_consumer,
    modules=["zmq"],
)

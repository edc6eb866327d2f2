"""NATS, core publish and subscribe."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from bench.events.channel.peers.base import Broker, OneByOne, Receive, Start, free_port, lacking, listening, program

_TOPIC = "bench"
_LIMIT_S = 10.0
#: Number of events after which a flood lets the client's writer task run.
_TOGETHER = 100


class _Supplier(OneByOne):
    def __init__(self, loop: asyncio.AbstractEventLoop, client: Any) -> None:
        self._loop, self._client = loop, client

    def push(self, payload: bytes) -> None:
        self._loop.run_until_complete(self._say(payload))

    async def _say(self, payload: bytes) -> None:
        await self._client.publish(_TOPIC, payload)
        for _ in range(3):  # let the writer task run
            await asyncio.sleep(0)

    def flood(self, payloads: Iterable[bytes]) -> None:
        self._loop.run_until_complete(self._flood(payloads))

    async def _flood(self, payloads: Iterable[bytes]) -> None:
        for place, payload in enumerate(payloads):
            await self._client.publish(_TOPIC, payload)
            if place % _TOGETHER == 0:
                await asyncio.sleep(0)
        await self._client.flush(60)


class Nats:
    name, batches = "NATS", False

    def missing(self) -> str:
        return lacking(programs=["nats-server"], modules=["nats"])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        port = free_port()
        pid = start(program("nats-server"), "-a", "127.0.0.1", "-p", str(port))
        listening(port)
        yield Broker(f"127.0.0.1:{port}", pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[_Supplier]:
        loop = asyncio.new_event_loop()
        client = loop.run_until_complete(self._connect(address))
        try:
            yield _Supplier(loop, client)
        finally:
            loop.run_until_complete(client.close())
            loop.close()

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        loop = asyncio.new_event_loop()
        thread = threading.Thread(target=loop.run_forever, daemon=True)
        thread.start()
        client = asyncio.run_coroutine_threadsafe(self._subscribe(address, receive), loop).result(_LIMIT_S)
        try:
            yield
        finally:
            asyncio.run_coroutine_threadsafe(client.close(), loop).result(_LIMIT_S)
            loop.call_soon_threadsafe(loop.stop)
            thread.join(_LIMIT_S)

    async def _subscribe(self, address: str, receive: Receive) -> Any:
        async def take(message: Any) -> None:
            receive((message.data,))

        client = await self._connect(address)
        # No limits of the client: only losses of the delivery should count.
        await client.subscribe(_TOPIC, cb=take, pending_msgs_limit=-1, pending_bytes_limit=-1)
        await client.flush(_LIMIT_S)
        return client

    @staticmethod
    async def _connect(address: str) -> Any:
        import nats

        return await nats.connect(f"nats://{address}")


PEER = Nats()

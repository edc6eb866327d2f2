"""A client of Foxglove's WebSocket protocol, foxglove.sdk.v1, made of nothing but its description."""

from __future__ import annotations

import contextlib
import json
import struct
import time
from collections.abc import Callable
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Subprotocol

PROTOCOL = "foxglove.sdk.v1"
#: Kinds of binary messages of the server.
MESSAGE, TIME, PLAYBACK = 1, 2, 5
#: States of the playback.
PAUSED, BUFFERING = 1, 2


class FoxgloveClient:
    """Subscribes to all topics, and keeps what it receives. messages: by topic, time [ns] and content."""

    def __init__(self, url: str) -> None:
        self._closing = contextlib.ExitStack()
        self._socket = self._closing.enter_context(connect(url, subprotocols=[Subprotocol(PROTOCOL)], max_size=None))
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}
        self.times: list[int] = []
        #: Of the simulation: whether it is paused, its pace, and the id of the request that this answers.
        self.playback: list[tuple[bool, float, str]] = []
        self.status: list[str] = []

    def __enter__(self) -> FoxgloveClient:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    def until(self, is_true: Callable[[], object], limit_s: float = 120.0) -> None:
        """Receive until a condition holds."""
        deadline = time.monotonic() + limit_s
        while not is_true():
            assert time.monotonic() < deadline, f"received {sorted(self.messages)}"
            try:
                self._take(self._socket.recv(timeout=0.2))
            except TimeoutError:
                continue

    def play(self, pace: float, request: str, pause: bool = False) -> None:
        """Ask for play, or pause."""
        name = request.encode()
        self._socket.send(struct.pack("<BBfBQI", 3, pause, pace, 0, 0, len(name)) + name)

    def _take(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self._take_text(json.loads(message))
        elif message[0] == MESSAGE:
            number, at = struct.unpack_from("<IQ", message, 1)
            self.messages.setdefault(self._topics[number], []).append((at, message[13:]))
        elif message[0] == TIME:
            self.times.append(struct.unpack_from("<Q", message, 1)[0])
        elif message[0] == PLAYBACK:
            status, _, pace, _, length = struct.unpack_from("<BQfBI", message, 1)
            if status != BUFFERING:
                self.playback.append((status == PAUSED, pace, message[19 : 19 + length].decode()))

    def _take_text(self, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            new = {channel["topic"]: channel for channel in message["channels"]}
            self.channels.update(new)
            self._topics.update((channel["id"], topic) for topic, channel in new.items())
            subscriptions = [{"id": channel["id"], "channelId": channel["id"]} for channel in new.values()]
            self._socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        elif message["op"] == "unadvertise":
            for number in message["channelIds"]:
                self.channels.pop(self._topics[number])
        elif message["op"] == "status":
            self.status.append(message["message"])

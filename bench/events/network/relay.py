"""The router where there are no network namespaces: holds back what TCP connections between the sub-networks carry.

python -m bench.events.network.relay LISTEN=TARGET ...: each HOST:PORT to listen at, and the one in the other
sub-network that it stands for. Commands and answers are those of bench.events.network.router;
packets are the parts in which bytes came. Addresses in sub-network I are 127.*.0.*.
"""

from __future__ import annotations

import contextlib
import json
import queue
import socket
import sys
import threading
import time
from collections.abc import Callable

PART_BYTES = 65536
CONNECT_LIMIT_S = 5.0


class Relay:
    """Direction 0 leads from sub-network I to II, 1 back."""

    def __init__(self) -> None:
        self.delay_s = 0.0
        self.packets, self.bytes = [0, 0], [0, 0]
        self._lock = threading.Lock()

    def listen(self, at: str, target: str) -> None:
        """Lead the connections that come in at an address on to another one, from now on."""
        listener = socket.create_server(_split(at))
        _start(self._accept, listener, target)

    def _accept(self, listener: socket.socket, target: str) -> None:
        inward = 1 if target.split(".")[2] == "0" else 0
        while True:
            near, _ = listener.accept()
            try:
                far = socket.create_connection(_split(target), CONNECT_LIMIT_S)
            except OSError:
                near.close()
                continue
            far.settimeout(None)
            _start(self._carry, near, far, inward)
            _start(self._carry, far, near, 1 - inward)

    def _carry(self, source: socket.socket, target: socket.socket, direction: int) -> None:
        """One direction of a connection: its parts come out in order, each `delay_s` after it came in."""
        target.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        held: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
        _start(_release, held, target)
        part = b"."
        while part:
            try:
                part = source.recv(PART_BYTES)
            except OSError:
                part = b""
            held.put((time.monotonic() + self.delay_s, part))
            with self._lock:
                self.packets[direction] += bool(part)
                self.bytes[direction] += len(part)


def _release(held: queue.SimpleQueue[tuple[float, bytes]], target: socket.socket) -> None:
    """An empty part ends the stream."""
    with contextlib.suppress(OSError):
        while True:
            due, part = held.get()
            time.sleep(max(0.0, due - time.monotonic()))
            if not part:
                target.shutdown(socket.SHUT_WR)
                return
            target.sendall(part)


def _start(run: Callable[..., None], *arguments: object) -> None:
    threading.Thread(target=run, args=arguments, daemon=True).start()


def _split(address: str) -> tuple[str, int]:
    host, port = address.rsplit(":", 1)
    return host, int(port)


def main() -> None:
    relay = Relay()
    for pair in sys.argv[1:]:
        relay.listen(*pair.split("="))
    print(json.dumps({"priority": False}), flush=True)
    for line in sys.stdin:
        relay.delay_s = json.loads(line).get("delay_us", 1e6 * relay.delay_s) / 1e6
        print(json.dumps({"packets": relay.packets, "bytes": relay.bytes}), flush=True)


if __name__ == "__main__":
    main()

"""The router without network namespaces: delays the data of TCP connections between the sub-networks.

python -m bench.events.network.relay LISTEN=TARGET ...: each HOST:PORT to listen at, and its target in the other
sub-network. Commands and answers are those of bench.events.network.router; each received part of a stream counts as a
packet. Addresses in sub-network I are 127.*.0.*.
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
    """Forwards TCP connections. Direction 0 is from sub-network I to II, 1 is back."""

    def __init__(self) -> None:
        self.delay_s = 0.0
        self.packets, self.bytes = [0, 0], [0, 0]
        self._lock = threading.Lock()

    def listen(self, at: str, target: str) -> None:
        """Forward connections from an address to another one."""
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
        """Forward one direction of a connection, in order and with a delay of `delay_s`."""
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
    """Send the held parts when they are due. An empty part ends the stream."""
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

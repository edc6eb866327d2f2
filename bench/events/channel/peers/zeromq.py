"""ZeroMQ: publishers and subscribers around a forwarder in a process of its own.

python -m bench.events.channel.peers.zeromq PORT PORT    the forwarder
"""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.events.channel.peers.base import Broker, OneByOne, Receive, Start, free_port, lacking, listening

#: Publishers connect in the background and lose events before that: timeout for the first subscription [s].
_CONFIRM_S = 10.0
_HELLO = b"hello"


class _Supplier(OneByOne):
    def __init__(self, socket: Any) -> None:
        self._socket = socket

    def push(self, payload: bytes) -> None:
        self._socket.send(payload)


class ZeroMq:
    name, batches = "ZeroMQ forwarder", False

    def missing(self) -> str:
        return lacking(modules=["zmq"])

    @contextlib.contextmanager
    def broker(self, folder: Path, start: Start) -> Iterator[Broker]:
        ports = (free_port(), free_port())
        pid = start(sys.executable, "-m", __name__, *map(str, ports))
        for port in ports:
            listening(port)
        yield Broker(" ".join(map(str, ports)), pid)

    @contextlib.contextmanager
    def supplier(self, address: str) -> Iterator[_Supplier]:
        import zmq

        with _context() as context:
            socket = _socket(context, zmq.XPUB)
            socket.connect(f"tcp://127.0.0.1:{address.split()[0]}")
            if not socket.poll(int(_CONFIRM_S * 1000)):  # a consumer's subscription, passed on by the forwarder
                raise TimeoutError("no subscription reached the publisher")
            yield _Supplier(socket)

    @contextlib.contextmanager
    def consumer(self, address: str, receive: Receive) -> Iterator[None]:
        import zmq

        with _context() as context:
            socket = _socket(context, zmq.SUB)
            socket.connect(f"tcp://127.0.0.1:{address.split()[1]}")
            socket.setsockopt(zmq.SUBSCRIBE, b"")
            ended = threading.Event()

            def listen() -> None:
                while not ended.is_set():
                    if socket.poll(200):
                        with contextlib.suppress(zmq.Again):
                            while True:
                                receive((socket.recv(zmq.DONTWAIT),))

            thread = threading.Thread(target=listen, daemon=True)
            thread.start()
            try:
                yield
            finally:
                ended.set()
                thread.join(5)


@contextlib.contextmanager
def _context() -> Iterator[Any]:
    import zmq

    context = zmq.Context()
    try:
        yield context
    finally:
        context.destroy(linger=0)


def _socket(context: Any, kind: int) -> Any:
    import zmq

    socket = context.socket(kind)
    for option in (zmq.SNDHWM, zmq.RCVHWM):
        socket.setsockopt(option, 0)  # no limit; by default a queue drops messages beyond 1000
    return socket


def forward(publishers: str, subscribers: str) -> None:
    import zmq

    with _context() as context:
        incoming, outgoing = _socket(context, zmq.XSUB), _socket(context, zmq.XPUB)
        incoming.bind(f"tcp://127.0.0.1:{publishers}")
        outgoing.bind(f"tcp://127.0.0.1:{subscribers}")
        zmq.proxy(incoming, outgoing)


PEER = ZeroMq()

if __name__ == "__main__":
    forward(*sys.argv[1:])

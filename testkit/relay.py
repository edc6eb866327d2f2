"""A relay of TCP connections to one server, which can be closed, for all clients or for some: a firewall before it.

The server publishes the relay's address in its references (environment variable ORBendPointPublish), so that others
connect with it by the relay, while its own connections to them are direct."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable


class Relay:
    """Relays connections to `port` to those at `target` on this machine; ended with its `with`.

    refuses: whether a client with this local port may not connect."""

    def __init__(self, port: int, target: int, refuses: Callable[[int], bool] = lambda port: False) -> None:
        self._port, self._target, self._refuses = port, target, refuses
        self._lock = threading.Lock()
        self._listener: socket.socket | None = None
        #: Both sockets of each connection, with the port of the client.
        self._connections: dict[socket.socket, int] = {}

    def open(self) -> None:
        """Accept connections."""
        self._listener = socket.create_server(("127.0.0.1", self._port))
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def close(self) -> None:
        """Refuse connections, and end those that are there."""
        with self._lock:
            ending = [*self._connections, *([self._listener] if self._listener else [])]
            self._listener = None
        for each in ending:
            _end(each)

    def end_refused(self) -> None:
        """End the connections of clients that may not connect any more."""
        with self._lock:
            connections = dict(self._connections)
        refused = {port for port in set(connections.values()) if self._refuses(port)}
        for each, port in connections.items():
            if port in refused:
                _end(each)

    def __enter__(self) -> Relay:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self, listener: socket.socket) -> None:
        with listener, contextlib.suppress(OSError):
            while True:
                here, (_, port) = listener.accept()
                if self._refuses(port):
                    here.close()
                    continue
                try:
                    there = socket.create_connection(("127.0.0.1", self._target))
                except OSError:
                    here.close()
                    continue
                with self._lock:
                    self._connections |= {here: port, there: port}
                    is_closed = self._listener is not listener
                for one, other in ((here, there), (there, here)):
                    threading.Thread(target=self._copy, args=(one, other), daemon=True).start()
                if is_closed:
                    _end(here)

    def _copy(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
        for each in (source, sink):
            _end(each)
        with self._lock:
            self._connections.pop(source, None)
        source.close()


def _end(each: socket.socket) -> None:
    """End what waits at a socket; its own thread closes it."""
    with contextlib.suppress(OSError):
        each.shutdown(socket.SHUT_RDWR)

"""An object in a process of its own."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
from collections.abc import Callable
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection
from typing import Any


class RemoteObject:
    """The object of the context manager `make(*arguments)`, in a process that ends with the `with`."""

    def __init__(self, make: Callable[..., AbstractContextManager[Any]], *arguments: Any) -> None:
        processes = multiprocessing.get_context("spawn")
        self._ours, theirs = processes.Pipe()
        # Not a daemon: it may have child processes. It ends with the pipe.
        self._process = processes.Process(target=_answer, args=(theirs, make, arguments))
        self._process.start()
        theirs.close()

    def __enter__(self) -> RemoteObject:
        self.receive()
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        self._process.join()

    def call(self, method: str, *arguments: Any) -> Any:
        """The result of a method; it must not raise."""
        self.send(method, *arguments)
        return self.receive()

    def send(self, method: str, *arguments: Any) -> None:
        """Begin a call; `receive` gets the results in the order of the calls. Raises OSError where it has ended."""
        self._ours.send((method, arguments))

    def receive(self) -> Any:
        """Raises EOFError where it has ended."""
        return self._ours.recv()


def _answer(connection: Connection, make: Callable[..., AbstractContextManager[Any]], arguments: Any) -> None:
    with make(*arguments) as target, contextlib.suppress(EOFError):
        gc.collect()
        gc.freeze()  # as servers do
        connection.send(None)
        while True:
            method, more = connection.recv()
            connection.send(getattr(target, method)(*more))

"""The processes of a bench, started in a temporary folder and controlled by lines of JSON."""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from bench.common.processes import Process
from bench.events.channel.peers import PEERS
from bench.events.channel.peers.base import Broker

#: Timeout for a role to connect, which may wait for its broker to start [s].
START_LIMIT_S = 40.0
#: A consumer has received everything when no event arrived for this time [s].
QUIET_S = 2.0


class Stage:
    """Starts processes, and ends them in reverse order at the end of the `with`."""

    def __init__(self) -> None:
        self._stack = contextlib.ExitStack()
        self._logs = 0

    def __enter__(self) -> Stage:
        self.folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-bench-")))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()

    def start(self, *command: str) -> int:
        """Start a broker; see peers.base.Start."""
        return self._stack.enter_context(Process(command, self._new_log())).pid

    def broker(self, peer: str) -> Broker:
        """Start the broker of a peer."""
        return self._stack.enter_context(PEERS[peer].broker(self.folder, self.start))

    def supplier(self, peer: str, broker: Broker) -> Process:
        """Start a supplier; call `ready` before using it."""
        return self._role("supplier", peer, broker.address)

    def consumer(self, peer: str, broker: Broker, how_many: int = 1) -> Process:
        """Start consumers in one process."""
        return self._role("consumer", peer, broker.address, str(how_many))

    def _role(self, *arguments: str) -> Process:
        command = (sys.executable, "-m", "bench.events.channel.roles", *arguments)
        return self._stack.enter_context(Process(command, self._new_log()))

    def _new_log(self) -> Path:
        self._logs += 1
        return self.folder / f"{self._logs}.log"


def ready(*roles: Process) -> None:
    """Wait until they are connected. Raises ProcessFailed."""
    for role in roles:
        role.receive(START_LIMIT_S)


def collect(
    consumer: Process, sent: Sequence[range], limit_s: float, latencies_from: int | None = None
) -> list[dict[str, Any]]:
    """The results of the consumers of a process for the events of suppliers 0, 1, ... Raises ProcessFailed."""
    consumer.send(
        {
            "expect": sum(map(len, sent)),
            "sent": [[numbers.start, numbers.stop] for numbers in sent],
            "quiet_s": QUIET_S,
            "limit_s": limit_s,
            "latencies_from": latencies_from,
        }
    )
    return list(consumer.receive(limit_s + 30))


def trio(stage: Stage, peer: str) -> tuple[Broker, Process, Process]:
    """A broker with one consumer and one supplier, each a process of its own, all connected."""
    broker = stage.broker(peer)
    consumer = stage.consumer(peer, broker)
    ready(consumer)
    supplier = stage.supplier(peer, broker)
    ready(supplier)
    return broker, supplier, consumer

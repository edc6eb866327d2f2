"""The processes of a bench, started in a temporary folder and controlled by lines of JSON."""

from __future__ import annotations

import contextlib
import itertools
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from testkit.json_process import Process, checkout_command
from testkit.peers import PEERS
from testkit.peers.base import Broker

#: Timeout for a role to connect, which may wait for its broker to start [s].
START_LIMIT_S = 90.0
#: A consumer has received everything when no event arrived for this time [s].
QUIET_S = 2.0


class Stage(contextlib.ExitStack):
    """Starts processes, and ends them in reverse order at the end of the `with`."""

    def __enter__(self) -> Stage:
        super().__enter__()
        self.folder = Path(self.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-bench-")))
        self._logs = itertools.count(1)
        return self

    def start(self, *command: str) -> int:
        """Start a broker; see peers.base.Start."""
        return self._process(*command).pid

    def broker(self, peer: str) -> Broker:
        """Start the broker of a peer."""
        return PEERS[peer].broker(self.start, self.folder)

    def supplier(self, peer: str, broker: Broker) -> Process:
        """Start a supplier; call `ready` before using it."""
        return self._process(*checkout_command("bench.events.channel.roles", "supplier", peer, broker.address))

    def consumer(self, peer: str, broker: Broker, how_many: int = 1) -> Process:
        """Start consumers in one process."""
        return self._process(
            *checkout_command("bench.events.channel.roles", "consumer", peer, broker.address, str(how_many))
        )

    def _process(self, *command: str) -> Process:
        return self.enter_context(Process(command, self.folder / f"{next(self._logs)}.log"))


def ready(*roles: Process) -> float:
    """Wait until they are connected; the longest time that one of them took [s]. Raises ProcessFailed."""
    return max(float(role.receive(START_LIMIT_S)) for role in roles)


def send(supplier: Process, how: str, limit_s: float, **arguments: Any) -> dict[str, Any]:
    """Let a supplier send events; see SupplierRole. Raises ProcessFailed."""
    return dict(supplier.ask({"do": how, **arguments}, limit_s))


def collect(
    consumer: Process, sent: Sequence[range], limit_s: float, latencies_from: int | None = None
) -> list[dict[str, Any]]:
    """The results of the consumers of a process for the events of suppliers 0, 1, ... Raises ProcessFailed."""
    command = {
        "do": "collect",
        "expect": sum(map(len, sent)),
        "sent": [[numbers.start, numbers.stop] for numbers in sent],
        "quiet_s": QUIET_S,
        "limit_s": limit_s,
        "latencies_from": latencies_from,
    }
    return list(consumer.ask(command, limit_s + 30))


def trio(stage: Stage, peer: str) -> tuple[Process, Process]:
    """A supplier and a consumer of a new broker, each a process of its own, all connected."""
    broker = stage.broker(peer)
    consumer = stage.consumer(peer, broker)
    ready(consumer)
    supplier = stage.supplier(peer, broker)
    ready(supplier)
    return supplier, consumer

"""The processes of a bench: started in a folder of their own, spoken to by lines of JSON, and ended."""

from __future__ import annotations

import contextlib
import json
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from bench.event_channel.peers import PEERS
from bench.event_channel.peers.base import Broker

ROOT = Path(__file__).resolve().parents[2]
#: For a role to connect, which may wait for its broker to start.
START_LIMIT_S = 40.0
#: A consumer that got nothing for so long has everything that will come.
QUIET_S = 2.0


class RoleFailed(Exception):
    """A supplier or consumer did not answer in time, or ended."""


class Role:
    """A process of bench.event_channel.roles."""

    def __init__(self, process: subprocess.Popen[str], log: Path, what: str) -> None:
        self.process, self._log, self._what = process, log, what
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def say(self, command: Any) -> None:
        """Give it something to do."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(command) + "\n")
        self.process.stdin.flush()

    def hear(self, limit_s: float) -> Any:
        """Its next answer. Raises RoleFailed."""
        try:
            line = self._lines.get(timeout=limit_s)
        except queue.Empty:
            raise RoleFailed(f"{self._what} did not answer within {limit_s:g} s") from None
        if not line:
            raise RoleFailed(f"{self._what} ended: {self._log.read_text()[-2000:]}")
        return json.loads(line)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)
        self._lines.put("")


class Stage:
    """Whatever is started on it ends with its `with`, last come, first gone."""

    def __init__(self) -> None:
        self._stack = contextlib.ExitStack()
        self._started: list[subprocess.Popen[Any]] = []

    def __enter__(self) -> Stage:
        self.folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-bench-")))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for process in reversed(self._started):
            _end(process)
        self._stack.close()

    def start(self, *command: str) -> int:
        """Start a broker; see peers.base.Start."""
        with self._new_log().open("w") as log:
            process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        self._started.append(process)
        return process.pid

    def broker(self, peer: str) -> Broker:
        """Start the broker of a peer."""
        return self._stack.enter_context(PEERS[peer].broker(self.folder, self.start))

    def supplier(self, peer: str, broker: Broker) -> Role:
        """Start a supplier; `ready` before it is used."""
        return self._role("supplier", peer, broker.address)

    def consumer(self, peer: str, broker: Broker, how_many: int = 1) -> Role:
        """Start consumers in one process."""
        return self._role("consumer", peer, broker.address, str(how_many))

    def _role(self, *arguments: str) -> Role:
        log = self._new_log()
        command = (sys.executable, "-m", "bench.event_channel.roles", *arguments)
        with log.open("w") as errors:
            process = subprocess.Popen(
                command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True
            )
        self._started.append(process)
        return Role(process, log, " ".join(arguments[:2]))

    def _new_log(self) -> Path:
        return self.folder / f"{len(self._started)}.log"


def ready(*roles: Role) -> None:
    """Wait until they are connected. Raises RoleFailed."""
    for role in roles:
        role.hear(START_LIMIT_S)


def collect(
    consumer: Role, sent: Sequence[range], limit_s: float, latencies_from: int | None = None
) -> list[dict[str, Any]]:
    """What the consumers of a process got of the events that suppliers 0, 1, ... sent. Raises RoleFailed."""
    consumer.say(
        {
            "expect": sum(map(len, sent)),
            "sent": [[numbers.start, numbers.stop] for numbers in sent],
            "quiet_s": QUIET_S,
            "limit_s": limit_s,
            "latencies_from": latencies_from,
        }
    )
    return list(consumer.hear(limit_s + 30))


def trio(stage: Stage, peer: str) -> tuple[Broker, Role, Role]:
    """A broker with one consumer and one supplier, each a process of its own, all connected."""
    broker = stage.broker(peer)
    consumer = stage.consumer(peer, broker)
    ready(consumer)
    supplier = stage.supplier(peer, broker)
    ready(supplier)
    return broker, supplier, consumer


def _end(process: subprocess.Popen[Any]) -> None:
    if process.stdin:
        with contextlib.suppress(OSError):
            process.stdin.close()
    else:
        process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(10)

"""The processes of these benches: brokers, suppliers and consumers, controlled by lines of JSON on their stdin.

    python -m bench.events.channel.processes supplier|consumer PEER ADDRESS [HOW MANY]

They answer every line by one line on stdout, and end with their stdin. The first line comes when they are connected,
and is the time that this took, in seconds. Events have 100 bytes, with their number and time."""

from __future__ import annotations

import contextlib
import gc
import itertools
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testkit.json_process import Process, answer_commands, checkout_command
from testkit.peers import PEERS
from testkit.peers.base import PAYLOAD_BYTES, Broker, Supplier

#: Timeout for a role to connect, which may wait for its broker to start [s].
START_LIMIT_S = 90.0
#: A consumer has received everything when no event arrived for this time [s].
QUIET_S = 2.0
_STAMP = struct.Struct("<QQ")
_REST = bytes(PAYLOAD_BYTES - _STAMP.size)


def stamped(number: int) -> bytes:
    """Event `number` with the current time of CLOCK_MONOTONIC, which all processes of a machine share."""
    return _STAMP.pack(number, time.monotonic_ns()) + _REST


class Arrivals(NamedTuple):
    """The events of a consumer in order of arrival. Arrays of equal length; times in ns of CLOCK_MONOTONIC."""

    numbers: np.ndarray
    made: np.ndarray
    came: np.ndarray

    def latencies_us(self, first: int = 0) -> np.ndarray:
        """From just before the sending call to the arrival in the code of the consumer [us], from number `first` on."""
        return (self.came - self.made)[self.numbers >= first] / 1e3

    def quality(self, sent: Sequence[range]) -> dict[str, int]:
        """The events lost, repeated, and misordered (after a later one), given the numbers that each supplier sent."""
        lost = repeated = misordered = 0
        for numbers in sent:
            got = self.numbers[(self.numbers >= numbers.start) & (self.numbers < numbers.stop)]
            unique = len(np.unique(got))
            lost += len(numbers) - unique
            repeated += len(got) - unique
            misordered += int(np.count_nonzero(got[1:] < np.maximum.accumulate(got)[:-1]))
        return {"lost": lost, "repeated": repeated, "misordered": misordered}


class Tally:
    """Stores what arrives. `take` evaluates it later, so that the evaluation does not slow the broker down."""

    def __init__(self) -> None:
        self._came: list[int] = []
        self._payloads: list[Sequence[bytes]] = []
        self._lock = threading.Lock()
        self.count = 0

    def receive(self, payloads: Sequence[bytes]) -> None:
        """Store the payloads of one call; from any thread."""
        moment = time.monotonic_ns()
        with self._lock:
            self._came.append(moment)
            self._payloads.append(payloads)
            self.count += len(payloads)

    def take(self) -> Arrivals:
        """The arrivals since the last call."""
        with self._lock:
            came, payloads, self._came, self._payloads, self.count = self._came, self._payloads, [], [], 0
        stamps = b"".join(payload[: _STAMP.size] for together in payloads for payload in together)
        numbers, made = np.frombuffer(stamps, np.int64).reshape(-1, 2).T
        return Arrivals(numbers, made, np.repeat(np.array(came, np.int64), [len(each) for each in payloads]))

    def wait(self, count: int, quiet_s: float, limit_s: float) -> None:
        """Wait until `count` events have arrived, or none arrived for `quiet_s`, at most `limit_s`."""
        deadline = time.monotonic() + limit_s
        before, changed_at = -1, time.monotonic()
        while (now := time.monotonic()) < deadline and self.count < count:
            if self.count != before:
                before, changed_at = self.count, now
            elif now > changed_at + quiet_s:
                return
            time.sleep(0.01)


# ---- in their own processes ----


class SupplierRole:
    """Sends events. Each method returns when it began [ns], the numbers sent by each thread from and to, and the number
    of failed calls."""

    def __init__(self, supplier: Supplier) -> None:
        self._supplier = supplier

    def pace(self, first: int, count: int, rate: float) -> dict[str, Any]:
        """Send events numbered from `first` on at `rate` a second, without catching up after a delay."""
        began, failed = time.monotonic_ns(), 0
        due = time.monotonic()
        for number in range(first, first + count):
            due = max(due + 1 / rate, time.monotonic() - 1 / rate)
            time.sleep(max(0.0, due - time.monotonic()))
            failed += _attempt(self._supplier.push, stamped(number))
        return {"began": began, "sent": [(first, first + count)], "failed": failed}

    def flood(self, first: int, seconds: float, most: int, threads: int = 1, size: int = 1) -> dict[str, Any]:
        """Send at most `most` events as fast as possible, by threads, `size` events in a call."""
        began, deadline, each = time.monotonic_ns(), time.monotonic() + seconds, most // threads
        starts = [first + thread * each for thread in range(threads)]
        ends = list(starts)

        def payloads(thread: int) -> Iterator[bytes]:
            for number in range(starts[thread], starts[thread] + each):
                if number % 64 == 0 and time.monotonic() > deadline:
                    break
                ends[thread] += 1
                yield stamped(number)

        def send(thread: int) -> int:
            if size == 1:
                return _attempt(self._supplier.flood, payloads(thread))
            assert self._supplier.push_run, "the client library sends single events only"
            runs, failed = payloads(thread), 0
            while run := list(itertools.islice(runs, size)):
                failed += _attempt(self._supplier.push_run, run)
            return failed

        with ThreadPoolExecutor(threads) as pool:
            failed = sum(pool.map(send, range(threads)))
        return {"began": began, "sent": list(zip(starts, ends, strict=True)), "failed": failed}


class ConsumerRole:
    """Consumers in one process."""

    def __init__(self, tallies: list[Tally]) -> None:
        self._tallies = tallies

    def collect(self, sent: list[list[int]], limit_s: float, latencies_from: int | None) -> list[dict[str, Any]]:
        """Wait for the events with these numbers; of each consumer count, quality, time of the last one, latencies."""
        deadline, numbers = time.monotonic() + limit_s, [range(*ends) for ends in sent]
        found = []
        for tally in self._tallies:
            tally.wait(sum(map(len, numbers)), QUIET_S, max(0.0, deadline - time.monotonic()))
            arrivals = tally.take()
            first = np.inf if latencies_from is None else latencies_from
            latencies = arrivals.latencies_us(first).round(1).tolist()
            last = int(arrivals.came[-1]) if len(arrivals.came) else 0
            quality = arrivals.quality(numbers)
            found.append({"count": len(arrivals.numbers), **quality, "last": last, "latencies": latencies})
        return found


def _attempt(call: Callable[..., object], *arguments: Any) -> int:
    """1 if a call failed, else 0. An event whose call failed counts as lost only if it did not arrive."""
    try:
        call(*arguments)
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
        return 1
    return 0


def main(role: str, peer: str, address: str, how_many: str = "1") -> None:
    gc.disable()  # a garbage collection would look like a delay of the broker
    began = time.monotonic()
    if role == "supplier":
        with PEERS[peer].supplier(address) as supplier:
            found = SupplierRole(supplier)
            answer_commands(found.pace, found.flood, ready=time.monotonic() - began)
    else:
        tallies = [Tally() for _ in range(int(how_many))]
        with PEERS[peer].consumer(address, *(tally.receive for tally in tallies)):
            answer_commands(ConsumerRole(tallies).collect, ready=time.monotonic() - began)


# ---- their starter ----


class Stage(contextlib.ExitStack):
    """A broker of a kind, a supplier, and processes with so many consumers, all connected. subscribed_s: the longest
    time that a process of consumers took for that [s]. They end with the `with`."""

    def __init__(self, peer: str, consumers: Sequence[int] = (1,)) -> None:
        super().__init__()
        with contextlib.ExitStack() as stack:
            self.folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-bench-")))
            logs = itertools.count(1)

            def start(*command: str) -> Process:
                return stack.enter_context(Process(command, self.folder / f"{next(logs)}.log"))

            def role(*arguments: str) -> Process:
                return start(*checkout_command("bench.events.channel.processes", *arguments))

            self.broker: Broker = PEERS[peer].broker(lambda *command: start(*command).pid, self.folder)
            self._consumers = [role("consumer", peer, self.broker.address, str(count)) for count in consumers]
            self.subscribed_s = max(float(each.receive(START_LIMIT_S)) for each in self._consumers)
            self._supplier = role("supplier", peer, self.broker.address)
            self._supplier.receive(START_LIMIT_S)
            self.push(stack.pop_all().__exit__)

    def send(
        self, how: str, limit_s: float, latencies_from: int | None = None, **arguments: Any
    ) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """Let the supplier send events (see SupplierRole); its answer, and that of each consumer (see ConsumerRole).
        Raises ProcessFailed."""
        answer = self._supplier.ask({"do": how, **arguments}, limit_s)
        command = {"do": "collect", "sent": answer["sent"], "limit_s": limit_s, "latencies_from": latencies_from}
        for consumer in self._consumers:
            consumer.send(command)
        return answer, [one for consumer in self._consumers for one in consumer.receive(limit_s + 30)]


if __name__ == "__main__":
    main(*sys.argv[1:])

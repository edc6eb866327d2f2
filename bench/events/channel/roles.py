"""A process of a bench that supplies or consumes events, controlled by lines of JSON on its stdin.

python -m bench.events.channel.roles supplier PEER ADDRESS
python -m bench.events.channel.roles consumer PEER ADDRESS [HOW MANY]

It answers every line by one line on stdout, and ends with its stdin. The first line comes when it is connected, and is
the time that this took, in seconds.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from bench.events.channel.stamps import Arrivals, Tally, gaps, quality, stamped, stamped_run
from testkit.json_process import answer_commands
from testkit.peers import PEERS
from testkit.peers.base import Supplier

MAX_GAPS = 20


class SupplierRole:
    """Sends events. Each method returns when it began [ns], the number of events of each supplier, and the number of
    failed calls."""

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
        return {"began": began, "sent": [count], "failed": failed}

    def flood(self, first: int, seconds: float, most: int, threads: int = 1) -> dict[str, Any]:
        """Send at most `most` events as fast as possible; each thread is a supplier, numbered 0, 1, ..."""
        began, deadline = time.monotonic_ns(), time.monotonic() + seconds
        sent = [0] * threads

        def payloads(thread: int) -> Iterator[bytes]:
            for number in range(first, first + most // threads):
                if number % 64 == 0 and time.monotonic() > deadline:
                    break
                sent[thread] += 1
                yield stamped(number, thread)

        with ThreadPoolExecutor(threads) as pool:
            failed = sum(pool.map(lambda thread: _attempt(self._supplier.flood, payloads(thread)), range(threads)))
        return {"began": began, "sent": sent, "failed": failed}

    def runs(self, first: int, seconds: float, most: int, size: int) -> dict[str, Any]:
        """Like `flood`, in runs of `size` events."""
        assert self._supplier.push_run, "the client library sends single events only"
        began, failed = time.monotonic_ns(), 0
        number, deadline = first, time.monotonic() + seconds
        while number < first + most and time.monotonic() < deadline:
            failed += _attempt(self._supplier.push_run, stamped_run(number, size))
            number += size
        return {"began": began, "sent": [number - first], "failed": failed}


class ConsumerRole:
    """Consumers in one process."""

    def __init__(self, tallies: list[Tally]) -> None:
        self._tallies = tallies

    def collect(
        self, expect: int, quiet_s: float, limit_s: float, sent: list[list[int]], latencies_from: int | None
    ) -> list[dict[str, Any]]:
        """Wait for `expect` events; the result of each consumer."""
        deadline = time.monotonic() + limit_s
        for tally in self._tallies:
            tally.wait(expect, quiet_s, max(0.0, deadline - time.monotonic()))
        return [_verdict(tally.take(), [range(*ends) for ends in sent], latencies_from) for tally in self._tallies]


def _verdict(arrivals: Arrivals, sent: list[range], latencies_from: int | None) -> dict[str, Any]:
    """The result of one consumer: count, quality, times, and latencies if requested."""
    latencies = [] if latencies_from is None else arrivals.latencies_us(latencies_from).round(1).tolist()
    return {
        "count": len(arrivals.numbers),
        **quality(arrivals, sent)._asdict(),
        "gaps": gaps(arrivals, sent[0])[:MAX_GAPS] if len(sent) == 1 else [],
        "first": int(arrivals.came[0]) if len(arrivals.came) else 0,
        "last": int(arrivals.came[-1]) if len(arrivals.came) else 0,
        "latencies": latencies,
    }


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
            answer_commands(found.pace, found.flood, found.runs, ready=time.monotonic() - began)
    else:
        tallies = [Tally() for _ in range(int(how_many))]
        with PEERS[peer].consumer(address, *(tally.receive for tally in tallies)):
            answer_commands(ConsumerRole(tallies).collect, ready=time.monotonic() - began)


if __name__ == "__main__":
    main(*sys.argv[1:])

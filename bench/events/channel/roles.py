"""A process of a bench that supplies or consumes events, controlled by lines of JSON on its stdin.

python -m bench.events.channel.roles supplier PEER ADDRESS
python -m bench.events.channel.roles consumer PEER ADDRESS [HOW MANY]

It answers every line by one line on stdout, the first one when it is connected, and ends with its stdin.
"""

from __future__ import annotations

import gc
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from bench.events.channel.peers import PEERS
from bench.events.channel.peers.base import Supplier
from bench.events.channel.peers.stamps import Arrivals, Tally, gaps, quality, stamped, stamped_run

MAX_GAPS = 20


def supply(peer: str, address: str) -> None:
    """Execute supplier commands until stdin ends."""
    with PEERS[peer].supplier(address) as supplier:
        for command in _commands():
            how = _WAYS[command.pop("do")]
            began = time.monotonic_ns()
            sent, failed = how(supplier, **command)
            _answer({"began": began, "ended": time.monotonic_ns(), "sent": sent, "failed": failed})


def pace(supplier: Supplier, first: int, count: int, rate: float) -> tuple[list[int], int]:
    """Send events numbered from `first` on at `rate` a second, without catching up after a delay.

    Returns, as the other commands do, the number of events of each supplier and the number of failed calls."""
    failed = 0
    due = time.monotonic()
    for number in range(first, first + count):
        due = max(due + 1 / rate, time.monotonic() - 1 / rate)
        time.sleep(max(0.0, due - time.monotonic()))
        failed += _attempt(supplier.push, stamped(number))
    return [count], failed


def flood(supplier: Supplier, first: int, seconds: float, most: int, threads: int = 1) -> tuple[list[int], int]:
    """Send at most `most` events as fast as possible; each thread is a supplier, numbered 0, 1, ..."""
    failures: list[int] = []
    sent = [0] * threads
    deadline = time.monotonic() + seconds

    def payloads(thread: int) -> Iterator[bytes]:
        for number in range(first, first + most // threads):
            if number % 64 == 0 and time.monotonic() > deadline:
                break
            sent[thread] += 1
            yield stamped(number, thread)

    def one(thread: int) -> None:
        failures.append(_attempt(supplier.flood, payloads(thread)))

    started = [threading.Thread(target=one, args=(thread,), daemon=True) for thread in range(threads)]
    for thread in started:
        thread.start()
    for thread in started:
        thread.join()
    return sent, sum(failures)


def runs(supplier: Supplier, first: int, seconds: float, most: int, size: int) -> tuple[list[int], int]:
    """Like `flood`, in runs of `size` events."""
    failed = 0
    number, deadline = first, time.monotonic() + seconds
    while number < first + most and time.monotonic() < deadline:
        failed += _attempt(supplier.push_run, stamped_run(number, size))
        number += size
    return [number - first], failed


_WAYS: dict[str, Callable[..., tuple[list[int], int]]] = {"pace": pace, "flood": flood, "runs": runs}


def consume(peer: str, address: str, how_many: int = 1) -> None:
    """Run consumers in this process; each answer has an entry for each consumer."""
    tallies = [Tally() for _ in range(how_many)]
    with PEERS[peer].consumer(address, *(tally.receive for tally in tallies)):
        for command in _commands():
            deadline = time.monotonic() + command["limit_s"]
            for tally in tallies:
                tally.wait(command["expect"], command["quiet_s"], max(0.0, deadline - time.monotonic()))
            sent = [range(start, stop) for start, stop in command["sent"]]
            _answer([_verdict(tally.take(), sent, command["latencies_from"]) for tally in tallies])


def _verdict(arrivals: Arrivals, sent: list[range], latencies_from: int | None) -> dict[str, Any]:
    """The result of one consumer: count, quality, times, and latencies if requested."""
    counted = arrivals if latencies_from is None else arrivals.from_number(latencies_from)
    return {
        "count": len(arrivals),
        **quality(arrivals, sent)._asdict(),
        "gaps": gaps(arrivals, sent[0])[:MAX_GAPS] if len(sent) == 1 else [],
        "first": int(arrivals.came[0]) if len(arrivals) else 0,
        "last": int(arrivals.came[-1]) if len(arrivals) else 0,
        "latencies": [] if latencies_from is None else counted.latencies_us.round(1).tolist(),
    }


def _attempt(call: Callable[..., None], *arguments: Any) -> int:
    """1 if a call failed, else 0. An event whose call failed counts as lost only if it did not arrive."""
    try:
        call(*arguments)
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
        return 1
    return 0


def _commands() -> Iterator[dict[str, Any]]:
    _answer("ready")
    for line in sys.stdin:
        yield json.loads(line)


def _answer(value: Any) -> None:
    print(json.dumps(value), flush=True)


if __name__ == "__main__":
    gc.disable()  # a garbage collection would look like a delay of the broker
    role, peer, address, *how_many = sys.argv[1:]
    if role == "supplier":
        supply(peer, address)
    else:
        consume(peer, address, *map(int, how_many))

"""The payloads of these benches: 100 bytes with supplier, number and time."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testkit.peers.base import PAYLOAD_BYTES

_STAMP = struct.Struct("<QQ")
_REST = bytes(PAYLOAD_BYTES - _STAMP.size)
#: The bits of a stamp above these are the supplier, the lower ones the number.
_SUPPLIER_SHIFT = 48


def stamped(number: int, supplier: int = 0) -> bytes:
    """Event `number` of a supplier with the current time of CLOCK_MONOTONIC, which all processes of a machine share."""
    return _STAMP.pack(supplier << _SUPPLIER_SHIFT | number, time.monotonic_ns()) + _REST


def stamped_run(first: int, count: int, supplier: int = 0) -> list[bytes]:
    """`count` events from number `first` on, with the current time."""
    base, now = supplier << _SUPPLIER_SHIFT | first, time.monotonic_ns()
    return [_STAMP.pack(base + place, now) + _REST for place in range(count)]


class Arrivals(NamedTuple):
    """The events of a consumer in order of arrival. Arrays of equal length; times in ns of CLOCK_MONOTONIC."""

    suppliers: np.ndarray
    numbers: np.ndarray
    made: np.ndarray
    came: np.ndarray

    def latencies_us(self, first: int = 0) -> np.ndarray:
        """From just before the sending call to the arrival in the code of the consumer [us], from number `first` on."""
        return (self.came - self.made)[self.numbers >= first] / 1e3


class Quality(NamedTuple):
    """Errors of a delivery. misordered: events that arrived after a later one."""

    lost: int
    repeated: int
    misordered: int


def quality(arrivals: Arrivals, sent: Sequence[range]) -> Quality:
    """Compare the arrivals with the numbers that each supplier sent. The order counts for each supplier alone."""
    lost = repeated = misordered = 0
    for supplier, numbers in enumerate(sent):
        got = arrivals.numbers[arrivals.suppliers == supplier].astype(np.int64)
        got = got[(got >= numbers.start) & (got < numbers.stop)]
        unique = len(np.unique(got))
        lost += len(numbers) - unique
        repeated += len(got) - unique
        if len(got):
            misordered += int(np.count_nonzero(got < np.maximum.accumulate(got)))
    return Quality(lost, repeated, misordered)


def gaps(arrivals: Arrivals, sent: range) -> list[tuple[int, int]]:
    """The missing numbers of one supplier: (start, stop) of each contiguous range, ascending."""
    missing = np.setdiff1d(np.arange(sent.start, sent.stop), arrivals.numbers)
    stretches = np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)
    return [(int(stretch[0]), int(stretch[-1]) + 1) for stretch in stretches if len(stretch)]


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
        sizes = np.fromiter(map(len, payloads), np.int64, len(payloads))
        stamps = b"".join(payload[: _STAMP.size] for together in payloads for payload in together)
        words, made = np.frombuffer(stamps, np.uint64).reshape(-1, 2).T
        return Arrivals(
            (words >> np.uint64(_SUPPLIER_SHIFT)).astype(np.int64),
            (words & np.uint64((1 << _SUPPLIER_SHIFT) - 1)).astype(np.int64),
            made.astype(np.int64),
            np.repeat(np.array(came, np.int64), sizes),
        )

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

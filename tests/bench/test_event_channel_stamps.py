"""How the benches of the event channel judge what arrived."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from bench.events.channel.stamps import Quality, Tally, gaps, quality, stamped, stamped_run
from robocorba.testing.peers.base import PAYLOAD_BYTES


def test_an_event_says_who_sent_it_as_which_one_and_when() -> None:
    tally = Tally()
    before = time.monotonic_ns()
    payload = stamped(7, supplier=3)
    tally.receive((payload,))
    arrivals = tally.take()
    after = time.monotonic_ns()
    assert len(payload) == PAYLOAD_BYTES
    assert (arrivals.suppliers.tolist(), arrivals.numbers.tolist()) == ([3], [7])
    assert before <= arrivals.made[0] <= arrivals.came[0] <= after
    assert arrivals.latencies_us().tolist() == [(arrivals.came[0] - arrivals.made[0]) / 1000]


def test_a_run_has_an_event_for_each_number() -> None:
    tally = Tally()
    tally.receive(stamped_run(5, 3, supplier=1))
    arrivals = tally.take()
    assert arrivals.numbers.tolist() == [5, 6, 7]
    assert arrivals.suppliers.tolist() == [1, 1, 1]
    assert len(set(arrivals.made.tolist())) == 1


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ([0, 1, 2, 3], Quality(0, 0, 0)),
        ([0, 1, 3], Quality(1, 0, 0)),
        ([0, 1, 1, 2, 3], Quality(0, 1, 0)),
        ([0, 2, 1, 3], Quality(0, 0, 1)),
        ([3, 0, 1, 2], Quality(0, 0, 3)),
        ([], Quality(4, 0, 0)),
        ([0, 1, 2, 3, 99], Quality(0, 0, 0)),  # of an earlier flood
    ],
)
def test_quality(numbers: list[int], expected: Quality) -> None:
    tally = Tally()
    for number in numbers:
        tally.receive((stamped(number),))
    assert quality(tally.take(), [range(4)]) == expected


def test_suppliers_are_judged_each_for_itself() -> None:
    tally = Tally()
    for number, supplier in ((0, 1), (0, 0), (1, 1), (2, 0), (1, 0)):
        tally.receive((stamped(number, supplier),))
    assert quality(tally.take(), [range(3), range(3)]) == Quality(lost=1, repeated=0, misordered=1)


def test_gaps_are_stretches_of_what_did_not_come() -> None:
    tally = Tally()
    for number in (10, 11, 15, 16, 19):
        tally.receive((stamped(number),))
    assert gaps(tally.take(), range(10, 22)) == [(12, 15), (17, 19), (20, 22)]


def test_what_was_taken_is_gone_and_only_later_numbers_have_latencies() -> None:
    tally = Tally()
    tally.receive(stamped_run(0, 10))
    assert tally.count == 10
    assert len(tally.take().latencies_us(8)) == 2
    assert tally.count == len(tally.take().numbers) == 0


def test_waiting_ends_with_the_last_event_or_with_silence() -> None:
    tally = Tally()
    tally.wait(1, quiet_s=0.05, limit_s=60.0)
    sender = threading.Timer(0.05, tally.receive, (stamped_run(0, 3),))
    sender.start()
    tally.wait(3, quiet_s=60.0, limit_s=60.0)
    sender.join()
    assert tally.count == 3
    assert np.array_equal(tally.take().numbers, [0, 1, 2])

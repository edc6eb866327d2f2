"""Batches that are parted, merged and aged; conjunctions, which are delivered together; and the queue, beside a list of
single events."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.errors.events import InvalidEvent, InvalidQueue
from robocorba.events.account import Account
from robocorba.events.correlation import Correlator
from robocorba.events.event import (
    MAX_PAYLOAD_BYTES,
    CorrelatedEvents,
    Encoding,
    EventBatch,
    EventHeader,
    check,
    checked_header,
    merged,
)
from robocorba.events.queue import EventQueue, OverflowRule, QueueItem, QueuePolicy
from tests.events.samples import BOTH, NOW, events, numbers

AGES = st.lists(st.integers(-5, 5), min_size=1, max_size=12)


def aged(ages: list[int], first: int) -> EventBatch:
    """Events that were made `ages` seconds ago and last for 0.5 s."""
    return EventBatch(EventHeader("t", "A", expiry=0.5), [NOW - age for age in ages], list(range(len(ages))), first)


@given(st.lists(st.tuples(st.integers(1, 4), st.booleans(), st.sampled_from("ab"), st.sampled_from(["", "hall"]))))
def test_merging_keeps_the_events_in_as_few_batches_as_possible(pieces: list[tuple[int, bool, str, str]]) -> None:
    """Those of different types, or from different peers, are not merged."""
    batches: list[EventBatch] = []
    number = 1
    for count, has_gap, type, via in pieces:
        number += has_gap
        batches.append(events(number, count, type=type))
        batches[-1].via = via
        number += count
    result = merged(batches)

    def content(several: list[EventBatch]) -> list[tuple[int, str, str, object]]:
        return [(r.first + i, r.header.type, r.via, payload) for r in several for i, payload in enumerate(r.payloads)]

    assert content(result) == content(batches)
    for one, next in itertools.pairwise(result):
        assert (next.first, next.header, next.via) != (one.last + 1, one.header, one.via)


@given(AGES, st.integers(0, 100))
def test_events_with_numbers_keep_them_when_others_expire_and_no_live_one_is_lost(ages: list[int], first: int) -> None:
    """Those between live ones stay. Events without numbers, whose first is 0, expire one by one."""
    fresh = aged(ages, first).unexpired(NOW)
    alive = [place for place, age in enumerate(ages) if age < 0.5]
    if not first or not alive:
        assert (fresh.payloads if fresh else []) == alive
        return
    assert fresh is not None
    assert (fresh.payloads[0], fresh.payloads[-1]) == (alive[0], alive[-1])
    assert [number - first for number in numbers([fresh])] == fresh.payloads


def header(type: str = "t", source: str = "A", expiry: float = 0.0) -> EventHeader:
    return checked_header(type, source, 0, expiry, Encoding.MSGPACK)


def check_batch(times: list[float], *payloads: bytes) -> None:
    check(EventBatch(EventHeader("t", "A"), times, list(payloads)))


@pytest.mark.parametrize(
    ("field", "act"),
    [
        ("type", lambda: header("")),
        ("type", lambda: header("x" * 201)),
        ("source", lambda: header(source="x" * 201)),
        *(("expiry", lambda expiry=expiry: header(expiry=expiry)) for expiry in (-1.0, math.nan, math.inf)),
        ("times", lambda: check_batch([NOW], b"", b"")),
        *(("time", lambda time=time: check_batch([time], b"")) for time in (math.nan, -math.inf)),
        ("payload", lambda: check_batch([NOW], bytes(MAX_PAYLOAD_BYTES + 1))),
        *(("size", QueuePolicy(size).checked) for size in (0, 1_000_001)),
        *(("blockLimit", QueuePolicy(block_limit=limit_s).checked) for limit_s in (-0.1, 10.5, math.nan)),
    ],
)
def test_what_is_out_of_range_names_its_field(field: str, act: Callable[[], object]) -> None:
    with pytest.raises((InvalidEvent, InvalidQueue)) as refused:
        act()
    assert refused.value.field == field


def pair(window: float = 0.0, limit: int = 10) -> Correlator:
    return Correlator(0, BOTH[0]._replace(window=window), limit)


def made(number: int, at: float, expiry: float = 0.0) -> EventBatch:
    batch = events(number, expiry=expiry)
    batch.times = [NOW + at]
    return batch


@given(st.lists(st.integers(0, 1), max_size=40))
def test_each_event_is_used_once_and_the_oldest_first(patterns: list[int]) -> None:
    correlator = pair(limit=100)
    found = []
    for number, pattern in enumerate(patterns):
        if together := correlator.add((pattern,), events(number), NOW, Account()):
            found.append(tuple(numbers([together])))
    firsts = [number for number, pattern in enumerate(patterns) if pattern == 0]
    seconds = [number for number, pattern in enumerate(patterns) if pattern == 1]
    assert found == list(zip(firsts, seconds, strict=False))
    assert len(correlator) == len(patterns) - 2 * len(found)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3)), max_size=40), st.integers(1, 4))
def test_together_lie_within_the_window_and_each_event_is_counted(steps: list[tuple[int, int]], limit: int) -> None:
    correlator, account, at, used = pair(2.0, limit), Account(), 0.0, 0
    for number, (pattern, pause) in enumerate(steps):
        at += pause
        if together := correlator.add((pattern,), made(number, at), NOW + at, account):
            times = [batch.times[0] for batch in together.batches]
            assert max(times) - min(times) <= 2.0
            used += 2
        assert number + 1 == used + account.expired + account.discarded + len(correlator)


def test_an_event_that_waits_is_not_delivered_once_it_expired_or_there_are_too_many() -> None:
    """Nor one behind one that is too old."""
    correlator, account = pair(10.0), Account()
    correlator.add((0,), made(1, 0.0), NOW, account)
    correlator.add((0,), made(2, 15.0, expiry=1.0), NOW + 15.0, account)
    assert correlator.add((1,), made(3, 20.0), NOW + 20.0, account) is None
    assert (account.expired, len(correlator)) == (2, 1)
    correlator, account = pair(limit=2), Account()
    for number in (1, 2, 3):
        correlator.add((0,), events(number), NOW, account)
    together = correlator.add((0, 1), events(4), NOW, account)  # it waits where no event does
    assert together is not None and numbers([together]) == [2, 4]
    assert account.discarded == 1


@dataclass
class Model:
    """The same by the simplest means: (number, priority, last moment) of each event, in order."""

    size: int
    rule: OverflowRule
    waiting: list[tuple[int, int, float]] = field(default_factory=list)
    discarded = expired = 0

    def trim(self) -> None:
        while len(self.waiting) > self.size:
            lowest = min(priority for _, priority, _ in self.waiting)
            places = [place for place, (_, priority, _) in enumerate(self.waiting) if priority == lowest]
            del self.waiting[places[0 if self.rule is OverflowRule.DISCARD_OLDEST else -1]]
            self.discarded += 1


class QueueBesideModel(RuleBasedStateMachine):
    """Whatever is done to both, they hold the same events and have lost as many."""

    @initialize(size=st.integers(1, 12), when_full=st.sampled_from(OverflowRule))
    def start(self, size: int, when_full: OverflowRule) -> None:
        self.account = Account()
        self.queue, self.model = EventQueue(QueuePolicy(size, when_full), self.account), Model(size, when_full)
        self.number = 1
        self.now = NOW
        self.taken: list[QueueItem] = []

    @rule(
        count=st.integers(1, 8),
        priority=st.integers(-1, 1),
        expiry=st.sampled_from([0.0, 2.0]),
        apart_s=st.sampled_from([0.0, 0.9]),
    )
    def put(self, count: int, priority: int, expiry: float, apart_s: float) -> None:
        batch = events(self.number, count, priority=priority, expiry=expiry)
        batch.times = [self.now + apart_s * place for place in range(count)]
        self.number += count
        lasts = [time + expiry if expiry else math.inf for time in batch.times]
        self.model.waiting += [(number, priority, last) for number, last in zip(numbers([batch]), lasts, strict=True)]
        self.queue.put(batch)
        self.model.trim()
        self.taken = []

    @rule(most=st.integers(1, 10))
    def take(self, most: int) -> None:
        items = self.queue.take(most, self.now)
        expected: list[int] = []
        while self.model.waiting and len(expected) < most:
            number, _, last = self.model.waiting.pop(0)
            if last > self.now:
                expected.append(number)
            else:
                self.model.expired += 1
        assert numbers(items) == expected
        self.taken = items

    @rule()
    def put_back(self) -> None:
        for item in reversed(self.taken):
            assert isinstance(item, EventBatch)
            lasts = [time + item.header.expiry if item.header.expiry else math.inf for time in item.times]
            waiting = zip(numbers([item]), lasts, strict=True)
            self.model.waiting[:0] = [(number, item.priority, last) for number, last in waiting]
        self.queue.put_back(self.taken)
        self.model.trim()
        self.taken = []

    @rule(seconds=st.sampled_from([0.5, 1.5, 3.0]))
    def let_time_pass(self, seconds: float) -> None:
        self.now += seconds

    @rule(size=st.integers(1, 12))
    def resize(self, size: int) -> None:
        self.model.size = size
        self.queue.resize(self.queue.policy._replace(size=size))
        self.model.trim()

    @invariant()
    def same_length(self) -> None:
        if hasattr(self, "queue"):
            assert self.queue.length == len(self.model.waiting) <= self.model.size
            assert self.account == Account(discarded=self.model.discarded, expired=self.model.expired)


TestQueueBesideModel = QueueBesideModel.TestCase
TestQueueBesideModel.settings = settings(max_examples=30, stateful_step_count=30, deadline=None)


def test_a_conjunction_is_taken_alone_and_discarded_as_a_whole() -> None:
    queue = EventQueue(QueuePolicy(5), Account())
    queue.put(events(1))
    queue.put(CorrelatedEvents(0, [events(2), events(3)]))
    queue.put(events(4))
    assert [numbers(queue.take(9, NOW)) for _ in range(3)] == [[1], [2, 3], [4]]
    for _ in range(3):
        queue.put(CorrelatedEvents(0, [events(2), events(3)]))
    assert queue.length == 4  # the first one went, with both of its events

"""The queue beside a list of single events."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.errors.events import InvalidQueue
from robocorba.events.event import CorrelatedEvents
from robocorba.events.queue import EventQueue, OverflowRule, QueueItem, QueuePolicy
from tests.events.samples import NOW, events, numbers


@dataclass
class Model:
    """The same by the simplest means: (number, priority, last moment) of each event, in order."""

    size: int
    rule: OverflowRule
    waiting: list[tuple[int, int, float]] = field(default_factory=list)

    def trim(self) -> int:
        lost = 0
        while len(self.waiting) > self.size:
            lowest = min(priority for _, priority, _ in self.waiting)
            places = [place for place, (_, priority, _) in enumerate(self.waiting) if priority == lowest]
            del self.waiting[places[0 if self.rule is OverflowRule.DISCARD_OLDEST else -1]]
            lost += 1
        return lost


class QueueBesideModel(RuleBasedStateMachine):
    """Whatever is done to both, they hold the same events and have lost as many."""

    @initialize(size=st.integers(1, 12), when_full=st.sampled_from(OverflowRule))
    def start(self, size: int, when_full: OverflowRule) -> None:
        self.queue, self.model = EventQueue(QueuePolicy(size, when_full)), Model(size, when_full)
        self.number = 1
        self.now = NOW
        self.taken: list[QueueItem] = []

    @rule(count=st.integers(1, 8), priority=st.integers(-1, 1), expiry=st.sampled_from([0.0, 0.0, 2.0]))
    def put(self, count: int, priority: int, expiry: float) -> None:
        batch = events(self.number, count, priority=priority, expiry=expiry)
        batch.times = [self.now] * count
        self.number += count
        last = self.now + expiry if expiry else math.inf
        self.model.waiting += [(number, priority, last) for number in numbers([batch])]
        assert self.queue.put(batch) == self.model.trim()
        self.taken = []

    @rule(most=st.integers(1, 10))
    def take(self, most: int) -> None:
        items, expired = self.queue.take(most, self.now)
        expected: list[int] = []
        gone = 0
        while self.model.waiting and len(expected) < most:
            number, _, last = self.model.waiting.pop(0)
            if last > self.now:
                expected.append(number)
            else:
                gone += 1
        assert (numbers(items), expired) == (expected, gone)
        self.taken = items

    @rule()
    def put_back(self) -> None:
        for item in reversed(self.taken):
            last = item.batches[0] if isinstance(item, CorrelatedEvents) else item
            until = last.times[0] + last.header.expiry if last.header.expiry else math.inf
            self.model.waiting[:0] = [(number, item.priority, until) for number in numbers([item])]
        assert self.queue.put_back(self.taken) == self.model.trim()
        self.taken = []

    @rule(seconds=st.sampled_from([0.5, 3.0]))
    def let_time_pass(self, seconds: float) -> None:
        self.now += seconds

    @rule(size=st.integers(1, 12))
    def resize(self, size: int) -> None:
        self.model.size = size
        assert self.queue.resize(self.queue.policy._replace(size=size)) == self.model.trim()

    @invariant()
    def same_length(self) -> None:
        if hasattr(self, "queue"):
            assert len(self.queue) == len(self.model.waiting) <= self.model.size
            assert self.queue.room == self.model.size - len(self.model.waiting)


TestQueueBesideModel = QueueBesideModel.TestCase
TestQueueBesideModel.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)


def test_items_put_back_into_a_full_queue_are_the_oldest() -> None:
    queue = EventQueue(QueuePolicy(4))
    queue.put(events(1, 4))
    taken, _ = queue.take(2, NOW)
    queue.put(events(5, 2))
    assert queue.put_back(taken) == 2
    assert numbers(queue.take(9, NOW)[0]) == [3, 4, 5, 6]


def test_a_conjunction_is_taken_alone_and_discarded_as_a_whole() -> None:
    queue = EventQueue(QueuePolicy(5))
    queue.put(events(1))
    queue.put(CorrelatedEvents(0, [events(2), events(3)]))
    queue.put(events(4))
    assert [numbers(queue.take(9, NOW)[0]) for _ in range(3)] == [[1], [2, 3], [4]]
    for _ in range(3):
        queue.put(CorrelatedEvents(0, [events(2), events(3)]))
    assert len(queue) == 4  # the first one went, with both of its events


def test_max_bytes_does_not_limit_the_first_item() -> None:
    queue = EventQueue(QueuePolicy(10))
    for number in (1, 2, 3):
        batch = events(number)
        batch.payloads = [bytes(1000)]
        queue.put(batch)
    assert [len(queue.take(9, NOW, most)[0]) for most in (1, 1500)] == [1, 2]


def test_the_oldest_time_is_that_of_the_next_event() -> None:
    queue = EventQueue(QueuePolicy(10))
    assert queue.oldest_time() is None
    late, early = events(1, priority=1), events(2)
    late.times = [NOW + 1]
    queue.put(late)
    queue.put(early)
    assert queue.oldest_time() == NOW + 1
    assert queue.clear() == 2
    assert (len(queue), queue.oldest_time()) == (0, None)


@pytest.mark.parametrize(
    ("field", "policy"),
    [
        ("size", QueuePolicy(0)),
        ("size", QueuePolicy(1_000_001)),
        ("blockLimit", QueuePolicy(block_limit=-0.1)),
        ("blockLimit", QueuePolicy(block_limit=10.5)),
        ("blockLimit", QueuePolicy(block_limit=math.nan)),
    ],
)
def test_an_invalid_policy_names_its_field(field: str, policy: QueuePolicy) -> None:
    with pytest.raises(InvalidQueue) as refused:
        policy.checked()
    assert refused.value.field == field

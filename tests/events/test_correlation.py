"""Conjunctions: which events are delivered together."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robocorba.events.account import Account
from robocorba.events.correlation import Correlator
from robocorba.events.event import EventBatch
from robocorba.events.subscription import Clause, Pattern
from tests.events.samples import NOW, events, numbers


def pair(window: float = 0.0, limit: int = 10) -> Correlator:
    return Correlator(0, Clause((Pattern("a"), Pattern("b")), window), limit)


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
def test_together_lie_within_the_window_and_every_event_is_accounted_for(
    steps: list[tuple[int, int]], limit: int
) -> None:
    correlator, account, at, used = pair(2.0, limit), Account(), 0.0, 0
    for number, (pattern, pause) in enumerate(steps):
        at += pause
        if together := correlator.add((pattern,), made(number, at), NOW + at, account):
            times = [batch.times[0] for batch in together.batches]
            assert max(times) - min(times) <= 2.0
            used += 2
        assert number + 1 == used + account.expired + account.discarded + len(correlator)


def test_an_event_that_matches_both_patterns_waits_where_no_event_does() -> None:
    correlator = pair()
    assert correlator.add((0, 1), events(1), NOW, Account()) is None
    together = correlator.add((0, 1), events(2), NOW, Account())
    assert together is not None and numbers([together]) == [1, 2]


def test_an_event_that_expired_while_it_waited_is_not_delivered() -> None:
    correlator, account = pair(), Account()
    correlator.add((0,), made(1, 0.0, expiry=1.0), NOW, account)
    assert correlator.add((1,), made(2, 5.0), NOW + 5.0, account) is None
    assert (account.expired, len(correlator)) == (1, 1)


def test_an_event_that_expired_behind_one_that_is_too_old_is_not_delivered_either() -> None:
    correlator, account = pair(10.0), Account()
    correlator.add((0,), made(1, 0.0), NOW, account)
    correlator.add((0,), made(2, 15.0, expiry=1.0), NOW + 15.0, account)
    assert correlator.add((1,), made(3, 20.0), NOW + 20.0, account) is None
    assert (account.expired, len(correlator)) == (2, 1)


def test_beyond_the_limit_the_oldest_waiting_event_is_discarded() -> None:
    correlator, account = pair(limit=2), Account()
    for number in (1, 2, 3):
        correlator.add((0,), events(number), NOW, account)
    assert account.discarded == 1
    together = correlator.add((1,), events(4), NOW, account)
    assert together is not None and numbers([together]) == [2, 4]

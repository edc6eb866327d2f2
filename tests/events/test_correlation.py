"""Conjunctions: which events are delivered together."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robocorba.events.correlation import Correlator
from robocorba.events.event import EventRun
from robocorba.events.subscription import Clause, Pattern
from tests.events.samples import NOW, events, numbers


def pair(window: float = 0.0, limit: int = 10) -> Correlator:
    return Correlator(0, Clause((Pattern("a"), Pattern("b")), window), limit)


def made(number: int, at: float, expiry: float = 0.0) -> EventRun:
    run = events(number, expiry=expiry)
    run.times = [NOW + at]
    return run


@given(st.lists(st.integers(0, 1), max_size=40))
def test_each_event_is_used_once_and_the_oldest_first(places: list[int]) -> None:
    correlator = pair(limit=100)
    found = []
    for number, place in enumerate(places):
        outcome = correlator.add((place,), events(number), NOW)
        if outcome.together:
            found.append(tuple(numbers([outcome.together])))
    firsts = [number for number, place in enumerate(places) if place == 0]
    seconds = [number for number, place in enumerate(places) if place == 1]
    assert found == list(zip(firsts, seconds, strict=False))
    assert len(correlator) == len(places) - 2 * len(found)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3)), max_size=40), st.integers(1, 4))
def test_together_lie_within_the_window_and_every_event_is_accounted_for(
    steps: list[tuple[int, int]], limit: int
) -> None:
    correlator, at = pair(2.0, limit), 0.0
    used = expired = discarded = 0
    for number, (place, pause) in enumerate(steps):
        at += pause
        outcome = correlator.add((place,), made(number, at), NOW + at)
        expired += outcome.expired
        discarded += outcome.discarded
        if outcome.together:
            times = [run.times[0] for run in outcome.together.runs]
            assert max(times) - min(times) <= 2.0
            used += 2
        assert number + 1 == used + expired + discarded + len(correlator)


def test_an_event_that_fits_both_patterns_waits_where_nothing_does() -> None:
    correlator = pair()
    assert correlator.add((0, 1), events(1), NOW).together is None
    together = correlator.add((0, 1), events(2), NOW).together
    assert together is not None and numbers([together]) == [1, 2]


def test_what_has_expired_while_it_waited_is_not_delivered() -> None:
    correlator = pair()
    correlator.add((0,), made(1, 0.0, expiry=1.0), NOW)
    outcome = correlator.add((1,), made(2, 5.0), NOW + 5.0)
    assert (outcome.together, outcome.expired, len(correlator)) == (None, 1, 1)


def test_what_has_expired_behind_one_that_is_too_old_is_not_delivered_either() -> None:
    correlator = pair(10.0)
    correlator.add((0,), made(1, 0.0), NOW)
    correlator.add((0,), made(2, 15.0, expiry=1.0), NOW + 15.0)
    outcome = correlator.add((1,), made(3, 20.0), NOW + 20.0)
    assert (outcome.together, outcome.expired, len(correlator)) == (None, 2, 1)


def test_of_too_many_that_wait_the_oldest_goes() -> None:
    correlator = pair(limit=2)
    outcomes = [correlator.add((0,), events(number), NOW) for number in (1, 2, 3)]
    assert [outcome.discarded for outcome in outcomes] == [0, 0, 1]
    together = correlator.add((1,), events(4), NOW).together
    assert together is not None and numbers([together]) == [2, 4]

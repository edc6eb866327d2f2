"""Batches: parted, merged, aged."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.events import InvalidEvent
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
from tests.events.samples import NOW, events, numbers

AGES = st.lists(st.integers(-5, 5), min_size=1, max_size=12)


def aged(ages: list[int], first: int) -> EventBatch:
    """Events that were made `ages` seconds ago and last for 0.5 s."""
    return EventBatch(EventHeader("t", "A", expiry=0.5), [NOW - age for age in ages], list(range(len(ages))), first)


@given(st.integers(1, 20), st.integers(0, 20), st.integers(0, 20))
def test_a_part_keeps_its_events_and_numbers(count: int, start: int, stop: int) -> None:
    part = events(100, count).part(start, stop)
    assert part.payloads == list(range(100, 100 + count))[start:stop]
    assert len(part.times) == len(part)
    if len(part):
        assert numbers([part]) == part.payloads
        assert part.last == part.payloads[-1]


@given(st.lists(st.tuples(st.integers(1, 4), st.booleans(), st.sampled_from("ab")), max_size=15))
def test_merging_keeps_the_events_in_as_few_batches_as_possible(pieces: list[tuple[int, bool, str]]) -> None:
    batches: list[EventBatch] = []
    number = 1
    for count, has_gap, type in pieces:
        number += has_gap
        batches.append(events(number, count, type=type))
        number += count
    result = merged(batches)

    def content(several: list[EventBatch]) -> list[tuple[int, str, object]]:
        return [(r.first + i, r.header.type, payload) for r in several for i, payload in enumerate(r.payloads)]

    assert content(result) == content(batches)
    assert all(
        second.first != first.last + 1 or second.header != first.header for first, second in itertools.pairwise(result)
    )


def test_batches_from_different_peers_are_not_merged() -> None:
    first, second = events(1, 2), events(3, 2)
    second.via = "hall"
    assert merged([first, second]) == [first, second]


@given(AGES)
def test_events_without_numbers_expire_one_by_one(ages: list[int]) -> None:
    fresh = aged(ages, 0).unexpired(NOW)
    assert (fresh.payloads if fresh else []) == [place for place, age in enumerate(ages) if age < 0.5]


@given(AGES, st.integers(1, 100))
def test_events_with_numbers_keep_them_and_no_live_one_is_lost(ages: list[int], first: int) -> None:
    fresh = aged(ages, first).unexpired(NOW)
    alive = [place for place, age in enumerate(ages) if age < 0.5]
    if not alive:
        assert fresh is None
        return
    assert fresh is not None
    assert (fresh.payloads[0], fresh.payloads[-1]) == (alive[0], alive[-1])
    assert [number - first for number in numbers([fresh])] == fresh.payloads


def test_a_batch_without_expiry_is_returned_unchanged() -> None:
    batch = events(1, 3)
    assert batch.unexpired(math.inf) is batch


def test_a_conjunction_expires_with_any_of_its_events() -> None:
    together = CorrelatedEvents(0, [events(1), events(2, expiry=1.0)])
    assert together.unexpired(NOW + 0.5) is together
    assert together.unexpired(NOW + 1.5) is None


@pytest.mark.parametrize(
    ("field", "header"),
    [
        ("type", ("", "A", 0, 0.0)),
        ("type", ("x" * 201, "A", 0, 0.0)),
        ("source", ("t", "x" * 201, 0, 0.0)),
        ("expiry", ("t", "A", 0, -1.0)),
        ("expiry", ("t", "A", 0, math.nan)),
        ("expiry", ("t", "A", 0, math.inf)),
    ],
)
def test_a_header_that_is_out_of_range_names_its_field(field: str, header: tuple[str, str, int, float]) -> None:
    with pytest.raises(InvalidEvent) as refused:
        checked_header(*header, Encoding.MSGPACK)
    assert refused.value.field == field


@pytest.mark.parametrize(
    ("field", "times", "payloads"),
    [
        ("times", [NOW], [b"", b""]),
        ("time", [math.nan], [b""]),
        ("time", [-math.inf], [b""]),
        ("payload", [NOW], [bytes(MAX_PAYLOAD_BYTES + 1)]),
    ],
)
def test_times_and_payloads_that_are_out_of_range_name_their_field(
    field: str, times: list[float], payloads: list[bytes]
) -> None:
    with pytest.raises(InvalidEvent) as refused:
        check(EventBatch(EventHeader("t", "A"), times, payloads))
    assert refused.value.field == field

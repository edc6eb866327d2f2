"""Areas that robots reserve: all or none, first come first served, bounded waits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidReservation, ReservationsFull
from robocorba.maps.polygons import FloorArea
from robocorba.simulation.reservations import AreaRequest, Reservations, area_request
from robocorba.simulation.world_record import ReservationRecord
from robocorba.spatial.pose import XY

FLOORS = ("L1", "L2")


def box(x: float, y: float, width: float = 1.0, height: float = 1.0, floor: str = "L1") -> FloorArea:
    return floor, ((x, y), (x + width, y), (x + width, y + height), (x, y + height))


def wanted(*areas: FloorArea, limit_s: float = 60.0) -> AreaRequest:
    return area_request(areas, limit_s, FLOORS)


def granted(kept: Reservations) -> set[str]:
    return {request.owner for request in kept.requests.values() if request.granted_at is not None}


def longest_wait(kept: Reservations, owner: str) -> float:
    status = kept.find(owner, kept.now)
    assert status
    return status.longest_wait_s


def test_requests_are_granted_in_their_order() -> None:
    kept = Reservations()
    kept.reserve("A", wanted(box(0, 0, 3)))
    kept.reserve("B", wanted(box(2, 0, 3)))
    kept.reserve("C", wanted(box(4, 0, 3)))  # free of A's, but B asked before
    kept.reserve("D", wanted(box(9, 0)))
    kept.reserve("E", wanted(box(0, 0, 9, floor="L2")))
    assert granted(kept) == {"A", "D", "E"}
    assert kept.find("C", 0.0) == (False, 1, 120.0, 60.0)
    kept.release("A")
    assert granted(kept) == {"B", "D", "E"}
    kept.release("B")
    assert granted(kept) == {"C", "D", "E"}
    assert kept.find("B", 0.0) is None


def test_areas_are_granted_all_or_none() -> None:
    kept = Reservations()
    kept.reserve("A", wanted(box(0, 0)))
    kept.reserve("B", wanted(box(5, 0)))
    kept.reserve("C", wanted(box(0, 0), box(5, 0), box(9, 0)))
    kept.release("A")
    assert granted(kept) == {"B"}
    kept.reserve("D", wanted(box(9, 0)))  # it would be free, but C waits for it
    assert granted(kept) == {"B"}
    kept.release("B")
    assert granted(kept) == {"C"}


def test_neighbours_share_an_edge() -> None:
    kept = Reservations()
    kept.reserve("A", wanted(box(0, 0)))
    kept.reserve("B", wanted(box(1, 0)))
    kept.reserve("C", wanted(box(0.1 + 0.2 + 1.7, 0)))  # 2.0000000000000004
    assert granted(kept) == {"A", "B", "C"}


def test_areas_are_released_one_by_one() -> None:
    kept = Reservations()
    legs = [box(0, 0), box(1, 0), box(2, 0)]
    kept.reserve("A", wanted(*legs))
    kept.reserve("B", wanted(box(0, 0)))
    kept.reserve("C", wanted(box(0, 0), box(2, 0)))
    kept.keep("A", wanted(*legs[1:]).areas)
    assert granted(kept) == {"A", "B"}
    kept.keep("A", wanted(*legs[1:]).areas)  # once more, since the answer was lost
    with pytest.raises(InvalidReservation) as refused:
        kept.keep("A", wanted(legs[1], legs[0]).areas)
    assert refused.value.field == "areas[1]"
    kept.keep("C", wanted(box(2, 0)).areas)  # it waits, and wants less
    assert kept.requests["C"].ahead == {"A"}
    kept.keep("A", ())
    assert granted(kept) == {"B", "C"}
    with pytest.raises(InvalidReservation):
        kept.keep("A", ())


def test_a_grant_ends_at_its_limit() -> None:
    kept = Reservations(now=5.0)
    kept.reserve("A", wanted(box(0, 0), limit_s=10.0))
    kept.reserve("B", wanted(box(0, 0), limit_s=20.0))
    kept.reserve("C", wanted(box(0, 0), limit_s=30.0))
    assert [longest_wait(kept, owner) for owner in "ABC"] == [0.0, 10.0, 30.0]
    assert kept.advance(14.9) == []
    assert kept.find("A", 14.9) == (True, 0, 0.0, pytest.approx(0.1))
    # A long step: B's grant began when A's ended, not when somebody looked.
    assert [request.owner for request in kept.advance(35.5)] == ["A", "B"]
    assert kept.requests["C"].granted_at == 35.0
    assert [request.owner for request in kept.advance(65.0)] == ["C"]
    assert not kept.requests


def test_requests_are_restored_after_a_restart() -> None:
    kept = Reservations()
    kept.reserve("A", wanted(box(0, 0), box(3, 3), limit_s=10.0))
    kept.reserve("gone", wanted(box(5, 0)))
    kept.reserve("B", wanted(box(0, 0)))
    kept.reserve("C", wanted(box(0, 0)))
    kept.reserve("D", wanted(box(5, 0)))
    kept.advance(4.0)
    data = msgspec.msgpack.encode(kept.record())
    again = Reservations()
    again.restore(msgspec.msgpack.decode(data, type=list[ReservationRecord]), 3.9, {"A", "B", "C", "D"})
    assert granted(again) == {"A", "D"}  # D: who was before it is not there any more
    assert (longest_wait(again, "B"), longest_wait(again, "C")) == (pytest.approx(6.1), pytest.approx(66.1))
    again.keep("A", wanted(box(3, 3)).areas)
    assert granted(again) == {"A", "B", "D"}


@pytest.mark.parametrize(
    ("field", "areas", "limit_s"),
    [
        ("limit", [box(0, 0)], 0.0),
        ("limit", [box(0, 0)], math.nan),
        ("limit", [box(0, 0)], 600.1),
        ("areas", [], 1.0),
        ("areas", [box(2 * i, 0) for i in range(33)], 1.0),
        ("areas", [("L1", [(0.0, float(i)) for i in range(513)])], 1.0),
        ("areas[0].polygon", [("L1", ())], 1.0),
        ("areas[1].polygon", [box(0, 0), ("L1", ((0.0, 0.0), (1.0, 1.0)))], 1.0),
        ("areas[0].polygon[2]", [("L1", ((0.0, 0.0), (1.0, 1.0), (math.nan, 0.0)))], 1.0),
        ("areas[0].polygon[0]", [("L1", ((1e9, 0.0), (1.0, 1.0), (0.0, 0.0)))], 1.0),
        ("areas[0].polygon", [("L1", ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)))], 1.0),
        ("areas[0].polygon", [("L1", ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0)))], 1.0),
        ("areas[0].polygon", [box(0, 0, 5.0, 0.001)], 1.0),
    ],
)
def test_invalid_requests_name_the_field(field: str, areas: Sequence[FloorArea], limit_s: float) -> None:
    with pytest.raises(InvalidReservation) as refused:
        area_request(areas, limit_s, FLOORS)
    assert refused.value.field == field


def test_the_number_of_requests_is_limited() -> None:
    with pytest.raises(UnknownFloor) as unknown:
        wanted(box(0, 0), box(0, 0, floor="L9" * 999))
    assert (unknown.value.which, len(unknown.value.floor)) == ("areas[1]", 200)
    kept = Reservations(max_requests=2)
    kept.reserve("A", wanted(box(0, 0)))
    with pytest.raises(InvalidReservation) as refused:
        kept.reserve("A", wanted(box(5, 0)))
    assert refused.value.field == "robot"
    kept.reserve("B", wanted(box(0, 0)))
    with pytest.raises(ReservationsFull):
        kept.reserve("C", wanted(box(0, 0)))
    assert list(kept.requests) == ["A", "B"]


# ---- any actions of robots ----

#: Corners on a grid: two boxes overlap as sets of its squares, without any geometry.
boxes = st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(1, 3), st.integers(1, 3), st.sampled_from(FLOORS))
requests = st.tuples(st.just("reserve"), st.lists(boxes, min_size=1, max_size=3), st.sampled_from([1.0, 7.5, 60.0]))
owners = st.integers(0, 5)
actions = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.5, 3.0, 20.0]),
        owners,
        st.one_of(requests, st.just(("release", None, None)), st.just(("keep", None, None)), st.just(("kill", 0, 0))),
    ),
    max_size=40,
)
Squares = set[tuple[str, int, int]]


def squares(found: Sequence[tuple[int, int, int, int, str]]) -> Squares:
    return {(f, x + i, y + j) for x, y, w, h, f in found for i in range(w) for j in range(h)}


def squares_of(areas: Sequence[tuple[str, tuple[XY, ...]]]) -> Squares:
    ends = [(floor, min(polygon), max(polygon)) for floor, polygon in areas]
    return squares([(int(x), int(y), int(far - x), int(top - y), floor) for floor, (x, y), (far, top) in ends])


@settings(deadline=None, max_examples=150)
@given(actions)
def test_grants_never_overlap_and_no_request_waits_longer_than_its_bound(actions: list) -> None:
    kept, now = Reservations(), 0.0
    bounds: dict[str, float] = {}
    was_granted: dict[str, float] = {}
    asked: dict[str, int] = {}  # the number of each request that there is
    numbers = itertools.count()

    def look() -> None:
        found = {owner: squares_of(request.areas) for owner, request in kept.requests.items()}
        assert list(found) == sorted(found, key=lambda owner: asked[owner])
        has = granted(kept)
        for owner, mine in found.items():
            before = [other for other in found if asked[other] < asked[owner] and found[other] & mine]
            assert (owner in has) == (not before), "granted just when nobody is before it"
            if owner in has:
                at = kept.requests[owner].granted_at
                assert at is not None and at <= bounds[owner] + 1e-9
                assert was_granted.setdefault(owner, at) == at, "a grant is not taken back"
            else:
                assert now + longest_wait(kept, owner) <= bounds[owner] + 1e-9, "a bound only gets less"
                assert now <= bounds[owner] + 1e-9

    def forget(owner: str) -> None:
        for table in (bounds, was_granted, asked):
            table.pop(owner, None)

    def pass_time(until: float) -> None:
        for over in kept.advance(until):
            at = over.granted_at
            assert at is not None and at + over.limit_s <= until and at <= bounds[over.owner] + 1e-9
            forget(over.owner)

    for seconds, number, (action, what, limit_s) in actions:
        now += seconds
        pass_time(now)
        look()
        owner = f"R{number}"
        if action == "reserve" and owner not in kept.requests:
            areas = [box(x, y, width, height, floor) for x, y, width, height, floor in what]
            kept.reserve(owner, wanted(*areas, limit_s=limit_s))
            asked[owner], bounds[owner] = next(numbers), now + longest_wait(kept, owner)
            ahead_s = sum(request.limit_s for other, request in kept.requests.items() if other != owner)
            assert bounds[owner] <= now + ahead_s + 1e-9
        elif action == "release":
            kept.release(owner)
            forget(owner)
        elif action == "keep" and owner in kept.requests:
            kept.keep(owner, kept.requests[owner].areas[1:])
            if owner not in kept.requests:
                forget(owner)
        elif action == "kill":  # of the server: what it knows is what it wrote
            records = msgspec.msgpack.decode(msgspec.msgpack.encode(kept.record()), type=list[ReservationRecord])
            kept = Reservations()
            kept.restore(records, now, {record.owner for record in records})
        look()
    while kept.requests:
        now += 1.0
        pass_time(now)
        look()

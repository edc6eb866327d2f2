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
from robocorba.simulation.reservations import KEPT_S, AreaRequest, Reservations, area_request, area_requests
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
    kept.reserve("A", [wanted(box(0, 0, 3))])
    kept.reserve("B", [wanted(box(2, 0, 3))])
    kept.reserve("C", [wanted(box(4, 0, 3))])  # free of A's, but B asked before
    kept.reserve("D", [wanted(box(9, 0))])
    kept.reserve("E", [wanted(box(0, 0, 9, floor="L2"))])
    assert granted(kept) == {"A", "D", "E"}
    assert kept.find("C", 0.0) == (False, 1, 120.0, 60.0)
    kept.release("A")
    assert granted(kept) == {"B", "D", "E"}
    kept.release("B")
    assert granted(kept) == {"C", "D", "E"}
    assert kept.find("B", 0.0) is None


def test_areas_are_granted_all_or_none() -> None:
    kept = Reservations()
    kept.reserve("A", [wanted(box(0, 0))])
    kept.reserve("B", [wanted(box(5, 0))])
    kept.reserve("C", [wanted(box(0, 0), box(5, 0), box(9, 0))])
    kept.release("A")
    assert granted(kept) == {"B"}
    kept.reserve("D", [wanted(box(9, 0))])  # it would be free, but C waits for it
    assert granted(kept) == {"B"}
    kept.release("B")
    assert granted(kept) == {"C"}


def test_neighbours_share_an_edge() -> None:
    kept = Reservations()
    kept.reserve("A", [wanted(box(0, 0))])
    kept.reserve("B", [wanted(box(1, 0))])
    kept.reserve("C", [wanted(box(0.1 + 0.2 + 1.7, 0))])  # 2.0000000000000004
    assert granted(kept) == {"A", "B", "C"}


def test_areas_are_released_one_by_one() -> None:
    kept = Reservations()
    legs = [box(0, 0), box(1, 0), box(2, 0)]
    kept.reserve("A", [wanted(*legs)])
    kept.reserve("B", [wanted(box(0, 0))])
    kept.reserve("C", [wanted(box(0, 0), box(2, 0))])
    kept.keep("A", wanted(*legs[1:]).areas)
    assert granted(kept) == {"A", "B"}
    kept.keep("A", wanted(*legs[1:]).areas)  # once more, since the answer was lost
    with pytest.raises(InvalidReservation) as refused:
        kept.keep("A", wanted(legs[1], legs[0]).areas)
    assert refused.value.field == "areas[1]"
    kept.keep("C", wanted(box(2, 0)).areas)  # it waits, and wants less
    assert {request.owner for request in kept.requests["C"].ahead} == {"A"}
    kept.keep("A", ())
    assert granted(kept) == {"B", "C"}
    with pytest.raises(InvalidReservation):
        kept.keep("A", ())


def test_a_grant_ends_at_its_limit() -> None:
    kept = Reservations(now=5.0)
    kept.reserve("A", [wanted(box(0, 0), limit_s=10.0)])
    kept.reserve("B", [wanted(box(0, 0), limit_s=20.0)])
    kept.reserve("C", [wanted(box(0, 0), limit_s=30.0)])
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
    kept.reserve("A", [wanted(box(0, 0), box(3, 3), limit_s=10.0)])
    kept.reserve("gone", [wanted(box(5, 0))])
    kept.reserve("B", [wanted(box(0, 0))])
    kept.reserve("C", [wanted(box(0, 0))])
    kept.reserve("D", [wanted(box(5, 0))])
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
    kept.reserve("A", [wanted(box(0, 0))])
    with pytest.raises(InvalidReservation) as refused:
        kept.reserve("A", [wanted(box(5, 0))])
    assert refused.value.field == "robot"
    kept.reserve("B", [wanted(box(0, 0))])
    with pytest.raises(ReservationsFull):
        kept.reserve("C", [wanted(box(0, 0))])
    assert list(kept.requests) == ["A", "B"]


def test_one_of_several_alternatives_is_reserved() -> None:
    kept = Reservations()
    west, east = wanted(box(0, 0)), wanted(box(5, 0))
    assert [kept.reserve(owner, [west, east]) for owner in "ABCD"] == [0, 1, 0, 1]
    assert kept.reserve("E", [wanted(box(0, 0), box(5, 0)), wanted(box(9, 0))]) == 1
    kept.advance(20.0)
    kept.release("B")
    assert granted(kept) == {"A", "D", "E"}
    kept.release("C")
    assert kept.reserve("F", [east, west]) == 1  # A's grant ends before D's could
    assert [kept.requests[owner].ahead for owner in "AF"] == [set(), {kept.requests["A"]}]


@pytest.mark.parametrize("count", [0, 5])
def test_the_number_of_alternatives_is_limited(count: int) -> None:
    with pytest.raises(InvalidReservation) as refused:
        area_requests([[box(0, 0)]] * count, 1.0, FLOORS)
    assert refused.value.field == "alternatives"


def test_granted_areas_are_exchanged_if_nobody_waits_longer() -> None:
    kept = Reservations()
    kept.reserve("A", [wanted(box(0, 0), limit_s=60.0)])
    kept.reserve("B", [wanted(box(0, 0, 5))])  # waits for A
    kept.reserve("C", [wanted(box(9, 0))])
    kept.reserve("D", [wanted(box(9, 0, 5))])  # waits for C
    kept.advance(10.0)
    assert not kept.exchange("A", wanted(box(9, 0)), 1.0)  # C has it
    assert not kept.exchange("A", wanted(box(12, 0)), 1.0)  # D waits for it, and not for A
    assert not kept.exchange("A", wanted(box(3, 0)), 50.1)
    assert not kept.exchange("B", wanted(box(20, 0)), 1.0)  # it waits
    assert not kept.exchange("nobody", wanted(box(20, 0)), 1.0)
    assert kept.exchange("A", wanted(box(3, 0), box(20, 0)), 50.0)
    assert kept.find("A", 10.0) == (True, 0, 0.0, 50.0)
    assert (granted(kept), longest_wait(kept, "B")) == ({"A", "C"}, 50.0)
    kept.reserve("E", [wanted(box(20, 0))])
    assert granted(kept) == {"A", "C"}
    assert kept.exchange("A", wanted(box(20, 0)), 50.0)
    assert granted(kept) == {"A", "B", "C"}


def test_what_a_silent_robot_has_reserved_is_taken_over() -> None:
    kept = Reservations()
    kept.reserve("leader", [wanted(box(0, 0), box(5, 0), limit_s=60.0)])
    kept.reserve("other", [wanted(box(5, 0))])
    kept.reserve("waits", [wanted(box(5, 0))])
    kept.advance(10.0)
    kept.fall_silent("waits")  # it has nothing
    kept.fall_silent("leader")
    assert (granted(kept), longest_wait(kept, "other")) == (set(), 20.0)
    kept.advance(29.0)
    for owner, former, field in (("other", "leader", "robot"), ("successor", "waits", "former")):
        with pytest.raises(InvalidReservation) as refused:
            kept.take_over(owner, former)
        assert refused.value.field == field
    kept.take_over("successor", "leader")
    assert kept.find("successor", 29.0) == (True, 0, 0.0, 31.0)
    assert longest_wait(kept, "other") == 31.0
    kept.keep("successor", wanted(box(0, 0)).areas)
    assert granted(kept) == {"successor", "other"}
    kept.fall_silent("successor")
    assert [request.owner for request in kept.advance(58.0)] == ["successor"]


def test_what_is_kept_and_taken_over_outlives_a_restart() -> None:
    def restarted(before: Reservations) -> Reservations:
        records = msgspec.msgpack.decode(msgspec.msgpack.encode(before.record()), type=list[ReservationRecord])
        after = Reservations()
        after.restore(records, before.now, {"other", "successor"})
        return after

    kept = Reservations()
    kept.reserve("leader", [wanted(box(0, 0))])
    kept.reserve("other", [wanted(box(0, 0))])
    kept.advance(5.0)
    kept.fall_silent("leader")
    kept = restarted(kept)
    assert granted(kept) == set()
    assert longest_wait(kept, "other") == KEPT_S
    kept.take_over("successor", "leader")  # it is granted, behind `other` that waits for it
    kept = restarted(kept)
    assert granted(kept) == {"successor"}
    kept.fall_silent("successor", "leader")  # it could not be stored
    kept = restarted(kept)
    kept.take_over("successor", "leader")
    assert granted(kept) == {"successor"}


# ---- any actions of robots ----

#: Corners on a grid: two boxes overlap as sets of its squares, without any geometry.
boxes = st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(1, 3), st.integers(1, 3), st.sampled_from(FLOORS))
requests = st.tuples(st.just("reserve"), st.lists(boxes, min_size=1, max_size=3), st.sampled_from([1.0, 7.5, 60.0]))
owners = st.integers(0, 5)
actions = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.5, 3.0, 20.0]),
        owners,
        st.one_of(
            requests,
            st.sampled_from(
                [("release", None, None), ("keep", None, None), ("fall silent", None, None), ("kill", 0, 0)]
            ),
            st.tuples(st.just("take over"), owners, st.none()),
            st.tuples(st.just("exchange"), st.lists(boxes, min_size=1, max_size=3), st.sampled_from([0.0, 5.0])),
        ),
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
    silent: list[tuple[str, int, float]] = []  # owners whose areas are kept, with number and time
    numbers = itertools.count()

    def look() -> None:
        found = {owner: squares_of(request.areas) for owner, request in kept.requests.items()}
        has = granted(kept)
        waiting = [owner for owner in found if owner not in has]
        assert waiting == sorted(waiting, key=lambda owner: asked[owner])
        rest = [squares_of(areas) for _, areas, _ in kept.all(now)[len(found) :]]
        assert len(rest) == len(silent)
        for owner, mine in found.items():
            before = [other for other in found if asked[other] < asked[owner] and found[other] & mine]
            before += ["silent" for squares in rest if squares & mine]
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
            assert at is not None
            if over.kept_until is None:
                assert at + over.limit_s <= until and at <= bounds[over.owner] + 1e-9
                forget(over.owner)
            else:
                since = next(since for owner, _, since in silent if owner == over.owner)
                assert min(since + KEPT_S, at + over.limit_s) <= until
                silent[:] = [each for each in silent if each[0] != over.owner]

    for seconds, number, (action, what, limit_s) in actions:
        now += seconds
        pass_time(now)
        look()
        owner = f"R{number}"
        if action == "reserve" and owner not in kept.requests:
            areas = [box(x, y, width, height, floor) for x, y, width, height, floor in what]
            assert kept.reserve(owner, [wanted(*areas, limit_s=limit_s)]) == 0
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
        elif action == "fall silent" and owner not in [name for name, *_ in silent]:
            if owner in granted(kept):
                silent.append((owner, asked[owner], now))
            kept.fall_silent(owner)
            forget(owner)
        elif action == "take over" and owner not in kept.requests:
            former = f"R{what}"
            number = next((number for name, number, _ in silent if name == former), None)
            if number is None:
                with pytest.raises(InvalidReservation, match="nothing is kept of"):
                    kept.take_over(owner, former)
            else:
                kept.take_over(owner, former)
                request = kept.requests[owner]
                assert request.granted_at is not None and request.latest_end == request.granted_at + request.limit_s
                asked[owner], bounds[owner] = number, request.granted_at
                silent[:] = [each for each in silent if each[0] != former]
        elif action == "exchange":
            areas = [box(x, y, width, height, floor) for x, y, width, height, floor in what]
            before = kept.find(owner, now)
            if kept.exchange(owner, wanted(*areas), limit_s):
                assert before and before.granted and before.left_s >= limit_s
                assert squares_of(kept.requests[owner].areas) == squares(what)
            assert kept.find(owner, now) == before
        elif action == "kill":  # of the server: what it knows is what it wrote
            records = msgspec.msgpack.decode(msgspec.msgpack.encode(kept.record()), type=list[ReservationRecord])
            kept = Reservations()
            kept.restore(records, now, {record.owner for record in records})
        look()
    while kept.requests:
        now += 1.0
        pass_time(now)
        look()

"""Areas that robots reserve, beside what test_traffic.py tries: what is refused, and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidReservation, ReservationsFull
from robocorba.map_editor.polygons import FloorArea
from robocorba.simulation.reservations import AreaRequest, Reservations, area_request, area_requests

FLOORS = ("L1", "L2")


def box(x: float, y: float, width: float = 1.0, height: float = 1.0, floor: str = "L1") -> FloorArea:
    return floor, ((x, y), (x + width, y), (x + width, y + height), (x, y + height))


def wanted(*areas: FloorArea, limit_s: float = 60.0) -> AreaRequest:
    return area_request(areas, limit_s, FLOORS)


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


def test_the_numbers_of_requests_and_alternatives_are_limited() -> None:
    with pytest.raises(UnknownFloor) as unknown:
        wanted(box(0, 0), box(0, 0, floor="L9" * 999))
    assert (unknown.value.which, len(unknown.value.floor)) == ("areas[1]", 200)
    for count in (0, 5):
        with pytest.raises(InvalidReservation) as refused:
            area_requests([[box(0, 0)]] * count, 1.0, FLOORS)
        assert refused.value.field == "alternatives"
    kept = Reservations(max_requests=2)
    kept.reserve("A", [wanted(box(0, 0))])
    kept.fall_silent("A")
    kept.reserve("B", [wanted(box(0, 0))])
    with pytest.raises(InvalidReservation) as refused:
        kept.keep("B", wanted(box(0, 0), box(5, 0)).areas)
    assert refused.value.field == "areas[1]"
    with pytest.raises(ReservationsFull):
        kept.reserve("C", [wanted(box(0, 0))])
    assert list(kept.requests) == ["B"]

"""The table of a path: every unit and name as it is, though rich reads square brackets as markup."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from robocorba.commands.path import as_table, parse_place
from robocorba.errors.paths import InvalidRequest
from robocorba.planning.request import IndexedNames, Path, Place, PointKind


def test_names_and_units_stand_as_they_are() -> None:
    names = IndexedNames(["L[1]", ""], ["[/]", "[red]x", ""], ["E [bold]", ""])
    rows = [
        [PointKind.START.value, 0, 0, 1.0, 2.0, math.pi / 2, 0.0, 0.0, -1],
        [PointKind.ELEVATOR_ENTRY.value, 1, 0, 1.0, 5.25, 0.0, 3.25, 3.25, 0],
    ]
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(as_table(Path([list(map(float, row)) for row in rows], names, 7)))
    text = console.export_text()
    for word in (
        *("x [m]", "y [m]", "heading [°]", "distance [m]", "time [s]", "3.25 m, 3.2 s, 2 points (map version 7)"),
        *("[/]", "[red]x", "L[1]", "elevator entry E [bold]", "90", "5.25"),
    ):
        assert word in text, text


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("L1:3,4", Place("L1", 3.0, 4.0)),
        ("a:b:-1.5,2e1", Place("a:b", -1.5, 20.0)),
        (" 一階 :0,0", Place(" 一階 ", 0.0, 0.0)),
    ],
)
def test_places(text: str, place: Place) -> None:
    assert parse_place(text, "start") == place


@pytest.mark.parametrize("text", ["", "L1", "L1:3", ":3,4", "L1:3,4,5", "L1:a,b", "L1:3,", "3,4"])
def test_what_is_no_place_is_named(text: str) -> None:
    with pytest.raises(InvalidRequest) as refused:
        parse_place(text, "goal")
    assert refused.value.field == "goal"

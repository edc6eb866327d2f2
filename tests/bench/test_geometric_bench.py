"""The bench of geometric paths, on a small map and without its processes."""

from __future__ import annotations

from typing import Any, cast

from bench.planning.geometric import EDITS, Found, measure


class Report:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, Any]] = []

    def send(self, what: tuple[str, Any]) -> None:
        self.sent.append(what)


def test_every_figure_is_reported() -> None:
    report = Report()
    measure(cast(Any, report), "rooms of 16", 40, 0.5, 0.2)
    names = [name for name, _ in report.sent]
    assert names[:3] == ["ready", "planner", "first"] and names[-1] == "done"
    assert names.count("update") == names.count("after") == EDITS
    assert names.count("query") == names.count("length") > 200
    assert not {"failure", "touch"} & set(names)
    assert all(0.7 < to_octile <= 1.0 + 1e-9 <= to_straight + 2e-9 for to_octile, to_straight in lengths(report))


def lengths(report: Report) -> list[tuple[float, float]]:
    return [value for name, value in report.sent if name == "length"]


def test_a_map_without_answers_has_a_row() -> None:
    row = Found("cave", 1.0).row()
    assert row["queries"] == 0 and row["median ms"] is None and row["finished"] == "limit"

"""The bench of geometric paths, on a small map and without its processes."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, cast

from bench.planning.geometric import EDITS, measure, row


class Report:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.found: dict[str, list[Any]] = defaultdict(list)

    def send(self, what: tuple[str, Any]) -> None:
        self.found[what[0]].append(what[1])


def test_every_figure_is_reported() -> None:
    report = Report()
    measure(cast(Any, report), "rooms of 16", 40, 0.5, 0.2)
    found = report.found
    assert list(found)[:3] == ["ready", "planner", "first"] and list(found)[-1] == "done"
    assert len(found["update"]) == len(found["after"]) == EDITS
    assert len(found["query"]) == len(found["octile"]) == len(found["straight"]) > 200
    assert not {"failure", "touch"} & set(found)
    assert all(
        0.7 < to_octile <= 1.0 + 1e-9 <= to_straight + 2e-9
        for to_octile, to_straight in zip(found["octile"], found["straight"], strict=True)
    )


def test_a_map_without_answers_has_a_row() -> None:
    found = row("cave", 1.0, defaultdict(list))
    assert found["queries"] == 0 and found["median ms"] is None and found["finished"] == "limit"

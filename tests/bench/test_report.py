"""How the benches of the event channel report what they found."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from matplotlib.axes import Axes

from bench.events.channel.consumers import slope_an_hour
from robocorba.testing import report
from robocorba.testing.report import at_least, at_most, summarize

ROWS: list[dict[str, Any]] = [{"peer": "a", "p50": 1.5, "lost": 0}, {"peer": "b", "p50": None, "lost": 12345}]


def test_marks() -> None:
    assert at_most("x", 1.0, 1.0).is_reached
    assert not at_most("x", 1.1, 1.0).is_reached
    assert at_least("x", 1.0, 1.0).is_reached
    assert not at_least("x", 0.9, 1.0).is_reached
    assert not at_most("x", float("nan"), 1.0).is_reached


@pytest.mark.parametrize("value", [1.0, 3.0])
def test_a_summary_is_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], value: float
) -> None:
    monkeypatch.setattr(report, "RESULTS", tmp_path)

    def draw(axes: Axes) -> None:
        axes.plot([1, 2], [1, 2])

    reached = summarize("some", "A title", ROWS, [at_most("a ratio", value, 2.0)], draw)

    assert reached == (value <= 2.0)
    printed = capsys.readouterr().out
    assert "A title" in printed and "12,345" in printed
    assert ("reached" if reached else "missed") in printed
    found = json.loads((tmp_path / "some.json").read_text())
    assert found["rows"] == ROWS
    assert found["marks"] == [
        {"what": "a ratio", "value": value, "relation": "at most", "limit": 2.0, "reached": reached}
    ]
    with (tmp_path / "some.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == [
            {"peer": "a", "p50": "1.5", "lost": "0"},
            {"peer": "b", "p50": "", "lost": "12345"},
        ]
    assert (tmp_path / "some.png").read_bytes().startswith(b"\x89PNG")


def test_growth_is_judged_after_the_warm_up() -> None:
    seconds = [float(second) for second in range(0, 4000, 100)]
    sizes = [50 + (second / 100 if second < 1000 else 10 + (second - 1000) / 3600) for second in seconds]
    assert slope_an_hour(seconds, sizes) == pytest.approx(1.0, abs=0.05)
    assert slope_an_hour(seconds, [60.0] * len(seconds)) == pytest.approx(0.0, abs=1e-6)

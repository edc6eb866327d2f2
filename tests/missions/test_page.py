"""The page of a report: its contents, and that texts are escaped."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import pytest

from robocorba.missions import page, timeline


def report(**changed: Any) -> dict[str, Any]:
    """A mission of two robots of two sub-networks, in the form of `MissionReport.as_json`."""
    latency = {"median": 1.0, "p99": 8.5, "max": 12.25, "count": 40}
    done = {"name": "gathering", "began_s": 1.5, "done_s": {"A": 4.0, "C": 9.5}, "waited_for": "C", "skew_ms": 0.4}
    answer, offer = ({"at_s": 0.1, "type": f"mission.{kind}"} for kind in ("answer", "offer"))
    return {
        **{"mission": "A-1", "kind": "move table", "leader": "A", "result": "done", "reason": "", "thing": "table"},
        **{"robots": {"A": "leader", "C": "helper"}, "began": 0.0, "seconds": 20.0, "clocks": {}},
        "phases": [done, {**done, "name": "carrying", "done_s": {}, "waited_for": "", "skew_ms": None}],
        "tick_skew_ms": {"median": 0.1, "p99": 2.0, "max": 3.5, "count": 100},
        "farthest_grip_m": 0.0155,
        "latency_ms": {"hall": latency, "lab": {**latency, "median": 0.5}},
        "events": [
            {**answer, "source": "A", "origin": "lab", "latency_ms": 0.75},
            {**offer, "source": "C", "origin": "hall", "latency_ms": 2.125},
        ],
        **changed,
    }


def written(folder: Path, *more: Any, **changed: Any) -> str:
    file = page.write(report(**changed), folder, *more)
    assert file == folder / "report.html"
    return file.read_text()


def tags(text: str) -> list[str]:
    return re.findall(r"<(\w+)", text)


def test_the_page_shows_pictures_film_figures_and_tables(tmp_path: Path) -> None:
    facts = [("The simulation server says", "the table is 2 mm from its goal")]
    text = written(tmp_path, [("before.png", "Before"), ("after.png", "After")], "film.mp4", facts)
    assert re.findall(r"src='(.*?)'", text) == ["film.mp4", "before.png", "after.png"]
    assert tags(text).count("video") == 1 and tags(text).count("img") == 2
    for word in ("the table is 2 mm from its goal", "gathering", "8.0", "hall, through its gateway", "15.5 mm", "2.12"):
        assert f">{word}<" in text, word
    assert list(page.latencies(report())) == [
        ("lab, the leader's own", "40", "0.50", "8.50", "12.25"),
        ("hall, through its gateway", "40", "1.00", "8.50", "12.25"),
    ]
    assert list(page.phases(report())) == [("gathering", "1.5", "8.0", "C", "0.4"), ("carrying", "1.5", "0.0", "", "")]
    assert len(page.LATENCIES) == len(page.PHASES) == 5


def test_a_mission_that_never_began_has_a_page(tmp_path: Path) -> None:
    nothing: dict[str, Any] = {
        **{"result": "failed", "reason": "2 helpers are needed", "phases": [], "robots": {}, "thing": ""},
        **{"tick_skew_ms": None, "farthest_grip_m": None, "latency_ms": {}, "events": []},
    }
    text = written(tmp_path, **nothing)
    assert "2 helpers are needed" in text
    assert not {"video", "img"} & set(tags(text))
    timeline.draw(report(**nothing), tmp_path / timeline.PICTURE)
    assert (tmp_path / timeline.PICTURE).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("key", ["mission", "kind", "leader", "result", "reason", "thing"])
def test_text_of_robots_is_escaped(tmp_path: Path, key: str) -> None:
    evil = "'><script>alert(1)</script>"
    text = written(tmp_path, **{key: evil})
    assert tags(text) == tags(written(tmp_path))
    assert evil in html.unescape(text)

"""The page of a report: its contents, and that texts are escaped."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from robocorba.missions import page, timeline


def report(**changed: Any) -> dict[str, Any]:
    """A mission of two robots of two sub-networks, in the form of `MissionReport.as_json`."""
    latency = {"median": 1.0, "p99": 8.5, "max": 12.25, "count": 40}
    gathering = {
        "name": "gathering",
        "began_s": 1.5,
        "started_s": {"A": 1.5, "C": 1.5004},
        "done_s": {"A": 4.0, "C": 9.5},
        "waited_for": "C",
        "skew_ms": 0.4,
    }
    return {
        "mission": "A-1",
        "kind": "move table",
        "leader": "A",
        "result": "done",
        "reason": "",
        "robots": {"A": "leader", "C": "helper"},
        "thing": "table",
        "began": 0.0,
        "seconds": 20.0,
        "phases": [gathering],
        "tick_skew_ms": {"median": 0.1, "p99": 2.0, "max": 3.5, "count": 100},
        "farthest_grip_m": 0.0155,
        "clocks": {},
        "latency_ms": {"hall": latency, "lab": {**latency, "median": 0.5}},
        "events": [
            {"at_s": 0.1, "type": "mission.answer", "source": "A", "origin": "lab", "latency_ms": 0.75},
            {"at_s": 0.2, "type": "mission.offer", "source": "C", "origin": "hall", "latency_ms": 2.125},
        ],
        **changed,
    }


class Seen(HTMLParser):
    """Tags, sources and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.sources: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.sources += [value for name, value in attrs if name == "src" and value]

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_page_shows_pictures_film_and_figures(tmp_path: Path) -> None:
    facts = [("The simulation server says", "the table is 2 mm from its goal")]
    written = page.write(report(), tmp_path, [("before.png", "Before"), ("after.png", "After")], "film.mp4", facts)
    assert written == tmp_path / "report.html"
    seen = Seen(written.read_text())
    assert seen.sources == ["film.mp4", "before.png", "after.png"]
    assert seen.tags.count("video") == 1 and seen.tags.count("img") == 2
    for word in ("the table is 2 mm from its goal", "gathering", "8.0", "hall, through its gateway", "15.5 mm", "2.12"):
        assert word in seen.words, word


def test_the_leaders_own_sub_network_comes_first() -> None:
    rows = list(page.latencies(report()))
    assert [row[0] for row in rows] == ["lab, the leader's own", "hall, through its gateway"]
    assert rows[1] == ("hall, through its gateway", "40", "1.00", "8.50", "12.25")
    assert {len(row) for row in rows} == {len(page.LATENCIES)}


def test_an_unfinished_phase_has_no_duration() -> None:
    (row,) = page.phases(report(phases=[{**report()["phases"][0], "done_s": {}, "waited_for": "", "skew_ms": None}]))
    assert row == ("gathering", "1.5", "0.0", "", "")
    assert len(row) == len(page.PHASES)


def test_a_mission_that_never_began_has_a_page(tmp_path: Path) -> None:
    nothing = report(
        **{"result": "failed", "reason": "2 helpers are needed", "phases": [], "robots": {}, "thing": ""},
        **{"tick_skew_ms": None, "farthest_grip_m": None, "latency_ms": {}, "events": []},
    )
    text = page.write(nothing, tmp_path).read_text()
    assert "2 helpers are needed" in text
    assert "<video" not in text and "<img" not in text
    timeline.draw(nothing, tmp_path / timeline.PICTURE)
    assert (tmp_path / timeline.PICTURE).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("key", ["mission", "kind", "leader", "result", "reason", "thing"])
def test_text_of_robots_is_escaped(tmp_path: Path, key: str) -> None:
    evil = "'><script>alert(1)</script>"
    plain = Seen(page.write(report(), tmp_path).read_text())
    seen = Seen(page.write(report(**{key: evil}), tmp_path).read_text())
    assert seen.tags == plain.tags
    assert any(evil in word for word in seen.words)

"""Figures of README and docs are those of the results, and each way in which they might not be is found."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from docs.make_figures import Pages, value_of
from testkit.report import ROOT

RESULT = "bench/results/event_network-network-paper.json"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of all pages, pictures and results."""
    for name in ("docs", "bench/results"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("api"))
    shutil.copy(ROOT / "README.md", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "file, old, new, problem",
    [
        ("docs/benches.md", "| 4.16, 3.37 |", "| 4.16, 3.17 |", "docs/benches.md: a table differs"),
        ("README.md", "<!--figures-->", "", "README.md: <!--figures--> ... <!--end--> is missing"),
        (RESULT, '"fed ms": 3.36', '"fed ms": 3.16', "docs/figure-13.png differs"),
        (RESULT, "", None, "there is no result event_network-network-paper"),
        (RESULT, '"verdict": "reached"', '"verdict": ""', "has no verdict"),
        (RESULT, "1c0730a994b193a1", "0123456789abcdef", "the commit 0123456789abcdef"),
        (RESULT, "\n", " " * 200 + "\n", "is larger than"),
        ("bench/results/former.json", '"0.22 ms"', '"0.12 ms"', "README.md: a table differs"),
    ],
)
def test_what_does_not_fit_is_found(checkout: Path, file: str, old: str, new: str | None, problem: str) -> None:
    text = (checkout / file).read_text()
    assert old in text
    (checkout / file).unlink() if new is None else (checkout / file).write_text(text.replace(old, new))
    assert any(problem in each for each in Pages(checkout).problems())


def test_figures_are_the_same_each_time_and_a_former_row_moves_when_its_bench_has_a_result(checkout: Path) -> None:
    rays = {**json.loads((checkout / RESULT).read_text()), "is dirty": True}
    rays["rows"] = [{"by": "pymunk", "M rays/s": rate} for rate in (0.15, 0.24)]
    keys, unit = ("what", "value", "relation", "limit", "verdict"), "walls, million rays a second"
    marks = (f"300 {unit}", 25.123, "at least", 8, "reached"), (f"6000 {unit}", 7.5, "at least", 8, "missed by 0.5")
    rays["marks"] = [dict(zip(keys, mark, strict=True)) for mark in marks]
    (checkout / "bench" / "results" / "rays.json").write_text(json.dumps(rays))
    Pages(checkout).write()
    files = [file for file in checkout.rglob("*.*") if file.is_file()]
    before = [file.read_bytes() for file in files]
    assert "| 25.1; **7.5**; 0.15 to 0.24 million | 8 | 30, 1c0730a9 |" in (checkout / "docs/benches.md").read_text()
    assert "rays a second" not in (checkout / "bench" / "results" / "former.json").read_text()
    pages = Pages(checkout)
    pages.write()
    assert [file.read_bytes() for file in files] == before and list(pages.problems()) == []
    assert "results/rays.json was measured with uncommitted changes" in pages.old()


def test_what_was_not_measured_is_no_number() -> None:
    result = {"date": "2026-12-01", "commit": "0", "marks": [], "rows": [{"a": "not measured"}, {"b": "inf"}, {"b": 2}]}
    for key, text in (("a", "not measured"), ("b|max", "inf"), ("b|span", "2 to inf")):
        assert value_of(key, [result])[0] == text

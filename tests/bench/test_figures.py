"""Figures of README and docs are those of the results, and each way in which they might not be is found."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from docs.make_figures import Pages, value_of
from testkit.report import ROOT

FIGURE_13, RAYS = "bench/results/event_network-network-paper.json", "bench/results/rays.json"


def test_pages_pictures_and_results_are_right() -> None:
    assert list(Pages().problems()) == []


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    shutil.copytree(ROOT / "bench" / "results", tmp_path / "bench" / "results")
    shutil.copy(ROOT / "README.md", tmp_path)
    rays = {**json.loads((tmp_path / FIGURE_13).read_text()), "date": "2026-12-01 10:00", "is dirty": True}
    rays["rows"] = [{"by": "pymunk", "M rays/s": 0.15}, {"by": "pymunk", "M rays/s": 0.24}]
    keys, unit = ("what", "value", "relation", "limit", "verdict"), "walls, million rays a second"
    marks = (f"300 {unit}", 25.123, "at least", 8, "reached"), (f"6000 {unit}", 7.5, "at least", 8, "missed by 0.5")
    rays["marks"] = [dict(zip(keys, mark, strict=True)) for mark in marks]
    (tmp_path / RAYS).write_text(json.dumps(rays, indent=1))
    Pages(tmp_path).write()
    return tmp_path


@pytest.mark.parametrize(
    "file, old, new, problem",
    [
        ("docs/benches.md", "25.1; **7.5**", "25.1; 7.5", "docs/benches.md: a table differs"),
        ("README.md", "<!--figures-->", "", "README.md: <!--figures--> ... <!--end--> is missing"),
        (FIGURE_13, '"title": "', '"title": "The ', "docs/figure-13.png differs"),
        (RAYS, "", None, "there is no result rays"),
        (RAYS, '"verdict": "reached"', '"verdict": ""', "'300 walls, million rays a second' has no verdict"),
        (RAYS, '"commit": "', '"commit": "0', "rays.json: the commit 0"),
        (RAYS, "\n", " " * 10_000 + "\n", "rays.json is larger than"),
        ("bench/results/former.json", '"0; 1.000"', '"0; 1.001"', "docs/benches.md: a table differs"),
    ],
    ids=range(8),
)
def test_what_does_not_fit_is_found(checkout: Path, file: str, old: str, new: str | None, problem: str) -> None:
    path = checkout / file
    path.unlink() if new is None else path.write_text(path.read_text().replace(old, new))
    assert any(problem in each for each in Pages(checkout).problems())


def test_figures_are_the_same_each_time_and_a_former_row_moves_when_its_bench_has_a_result(checkout: Path) -> None:
    assert "| 25.1; **7.5**; 0.15 to 0.24 million | 8 | 12-01, " in (checkout / "docs" / "benches.md").read_text()
    assert "rays a second" not in (checkout / "bench" / "results" / "former.json").read_text()
    files = [file for file in checkout.rglob("*.*") if file.is_file()]
    before, pages = [file.read_bytes() for file in files], Pages(checkout)
    pages.write()
    assert [file.read_bytes() for file in files] == before and not [*pages.problems()]
    assert "results/rays.json was measured with uncommitted changes" in pages.old()


def test_what_was_not_measured_is_no_number() -> None:
    result = {"date": "2026-12-01", "commit": "0", "marks": [], "rows": [{"a": "not measured"}, {"b": "inf"}, {"b": 2}]}
    assert [value_of(key, [result])[0] for key in ("a", "b|max", "b|span")] == ["not measured", "inf", "2 to inf"]

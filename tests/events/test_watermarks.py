"""The last numbers seen of each channel, over restarts and with more channels than there is room for."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.events import watermarks
from robocorba.events.watermarks import Watermarks
from tests.damage import damage


def test_the_numbers_of_a_killed_process_are_restored(tmp_path: Path) -> None:
    killed = Watermarks(tmp_path / "seen")
    killed.raise_to("lab", 7)
    killed.raise_to("hall", 2**59)
    with Watermarks(tmp_path / "seen") as successor:  # nothing was closed, nothing flushed
        assert [successor.last(name) for name in ("lab", "hall", "yard")] == [7, 2**59, 0]


def test_a_number_of_the_future_is_forgotten(tmp_path: Path) -> None:
    with Watermarks(tmp_path / "seen") as marks:
        marks.raise_to("lab", 2**63)
        marks.raise_to("hall", 7)
    with Watermarks(tmp_path / "seen") as again:
        assert (again.last("lab"), again.last("hall")) == (0, 7)
        again.raise_to("lab", 8)
        assert again.last("lab") == 8


def test_damaged_entries_are_set_aside_and_the_others_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "lab.seen"
    with Watermarks(file) as marks:
        marks.raise_to("lab", 7)
        marks.raise_to("hall", 8)
    former = damage(file)
    with Watermarks(file) as again:
        assert (again.last("lab"), again.last("hall")) == (0, 8)
        again.raise_to("yard", 9)
    assert "lab.seen is damaged (1 of its entries)" in caplog.text
    assert (tmp_path / "lab.seen.damaged").read_bytes() == former
    caplog.clear()
    with Watermarks(file) as third:
        assert (third.last("hall"), third.last("yard")) == (8, 9)
    assert caplog.text == ""


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2 * watermarks.MAX_ORIGINS), st.integers(1, 2**59)), max_size=600))
def test_the_most_recent_origins_are_remembered(raised: list[tuple[int, int]]) -> None:
    expected: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as folder:
        with Watermarks(Path(folder) / "seen") as marks:
            for origin, number in raised:
                marks.raise_to(f"c{origin}", number)
                expected.pop(f"c{origin}", None)
                expected[f"c{origin}"] = number
        recent = dict(list(expected.items())[-watermarks.MAX_ORIGINS :])
        with Watermarks(Path(folder) / "seen") as again:
            assert {name: again.last(name) for name in expected} == {name: recent.get(name, 0) for name in expected}

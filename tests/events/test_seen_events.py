"""Which events were seen, against a plain set: over restarts, with gaps and with more of all than there is room for."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robocorba.events import seen_events
from robocorba.events.event_numbers import first_number_of
from robocorba.events.seen_events import SeenEvents
from tests.damage import damage


def add(seen: SeenEvents, origin: str, first: int, last: int) -> list[tuple[int, int]]:
    return seen.add(origin, first, last)[0]


def test_lives_are_independent_of_each_other_and_restored_after_a_kill(tmp_path: Path) -> None:
    """The life of a channel that has lost its state may be below the one before."""
    streams = [
        (origin, first_number_of(life)) for origin, life in (("lab", 7), ("lab", 2**31), ("lab", 3), ("hall", 7))
    ]
    killed = SeenEvents(tmp_path / "seen")
    for origin, first in streams:
        assert add(killed, origin, first, first + 9) == [(first, first + 9)]
        assert add(killed, origin, first, first + 9) == []
    border = 12 << 32  # a batch over the end of a life
    assert add(killed, "lab", border - 2, border + 1) == [(border - 2, border - 1), (border, border + 1)]
    with SeenEvents(tmp_path / "seen") as successor:  # nothing was closed, nothing flushed
        for origin, first in streams:
            assert add(successor, origin, first - 1, first + 10) == [(first - 1, first - 1), (first + 10, first + 10)]
        assert add(successor, "lab", border, border) == add(successor, "lab", border - 1, border - 1) == []
        assert add(successor, "yard", 1, 1) == [(1, 1)]


def test_what_is_damaged_is_set_aside_and_other_entries_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file, aside = tmp_path / "lab.seen", tmp_path / "lab.seen.damaged"
    with SeenEvents(file) as seen:
        add(seen, "lab", 1, 7)
        add(seen, "hall", 1, 8)
    content = bytearray(file.read_bytes())
    content[16:20] = b"\xff\xff\xff\xff"
    file.write_bytes(content)
    with SeenEvents(file) as again:
        assert add(again, "lab", 1, 7) == [(1, 7)]
        assert add(again, "hall", 8, 9) == [(9, 9)]
    assert "lab.seen is damaged (1 of its entries)" in caplog.text
    assert aside.read_bytes() == content
    former = damage(file)
    with SeenEvents(file) as again:
        assert add(again, "lab", 1, 7) == [(1, 7)]
    assert "lab.seen is damaged (its beginning)" in caplog.text
    assert aside.read_bytes() == former
    caplog.clear()
    with SeenEvents(file) as third:
        assert add(third, "lab", 7, 7) == []
    file.write_bytes(b"\x07" * 256 * 216)  # of the first release, which is of no use
    with SeenEvents(file) as again:
        assert add(again, "lab", 1, 7) == [(1, 7)]
    assert caplog.text == ""


def test_the_most_recent_lives_are_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seen_events, "MAX_LIVES", 8)
    with SeenEvents(tmp_path / "seen") as seen:
        for life in range(1, 9):
            add(seen, "lab", first_number_of(life), first_number_of(life))
        add(seen, "lab", first_number_of(1) + 1, first_number_of(1) + 1)
        add(seen, "hall", 1, 1)
    with SeenEvents(tmp_path / "seen") as again:
        assert [life for life in range(1, 9) if again.has_seen("lab", first_number_of(life))] == [1, *range(3, 9)]
        assert again.has_seen("hall", 1)
        add(again, "yard", 1, 1)  # which one was used last is known after a restart, too
        assert [life for life in range(1, 9) if again.has_seen("lab", first_number_of(life))] == [1, *range(4, 9)]


ROOM = 4


class SeenAgainstASet(RuleBasedStateMachine):
    """The model is the set of all numbers that were seen or forgotten, which are those below the horizon."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(seen_events, "MAX_INTERVALS", ROOM)
        self.had: set[int] = set()
        self.horizon = 0

    @initialize()
    def open(self) -> None:
        self.seen = SeenEvents(Path(self.folder.name) / "seen")

    @rule(first=st.integers(1, 40), count=st.integers(1, 6))
    def see(self, first: int, count: int) -> None:
        batch = range(first, first + count)
        parts, late = self.seen.add("lab", batch[0], batch[-1])
        new = [number for number in batch if number not in self.had]
        assert [number for part in parts for number in range(part[0], part[1] + 1)] == new
        assert late == sum(number < self.horizon for number in batch)
        for part in parts:
            self._note(range(part[0], part[1] + 1))

    def _note(self, part: range) -> None:
        runs = sorted(number for number in self.had if number + 1 not in self.had)  # the last number of each
        is_apart = part[0] - 1 not in self.had and part[-1] + 1 not in self.had
        if is_apart and len(runs) == ROOM:
            self.horizon = runs[1] + 1
            self.had.update(range(1, self.horizon))
        self.had.update(part)

    @precondition(lambda self: self.had)
    @rule()
    def restart(self) -> None:
        self.seen = SeenEvents(Path(self.folder.name) / "seen")

    @invariant()
    def has_seen_the_same(self) -> None:
        if self.had:
            assert [number for number in range(60) if number > 0 and self.seen.has_seen("lab", number)] == sorted(
                self.had
            )

    def teardown(self) -> None:
        self.patch.undo()
        self.folder.cleanup()


TestSeenAgainstASet = SeenAgainstASet.TestCase
TestSeenAgainstASet.settings = settings(max_examples=30, stateful_step_count=40, deadline=None)

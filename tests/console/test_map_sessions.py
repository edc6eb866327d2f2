"""Sessions of the console's tabs end after silence, and are bounded."""

from __future__ import annotations

import pytest

from robocorba.console.map_sessions import MAX_SESSIONS, SILENCE_S, NoSession, TabSessions
from tests.clock import Clock


class Remote:
    is_closed = False

    def close(self) -> None:
        self.is_closed = True


class Editor:
    def __init__(self) -> None:
        self.opened: list[Remote] = []

    def open_session(self, author: str) -> Remote:
        self.opened.append(Remote())
        return self.opened[-1]


def test_a_silent_session_ends_when_another_opens() -> None:
    editor, clock = Editor(), Clock(0.0)
    sessions = TabSessions(editor, clock)
    silent, busy = sessions.open("A."), sessions.open("B.")
    clock.now = SILENCE_S * 0.9
    sessions.find(busy)
    clock.now = SILENCE_S * 1.1
    sessions.open("C.")
    assert [remote.is_closed for remote in editor.opened] == [True, False, False]
    assert sessions.find(busy).author == "B."
    with pytest.raises(NoSession):
        sessions.find(silent)


def test_the_one_that_is_silent_for_longest_makes_place() -> None:
    editor, clock = Editor(), Clock(0.0)
    sessions = TabSessions(editor, clock)
    for clock.now in range(MAX_SESSIONS + 2):
        sessions.open("A.")
    assert [remote.is_closed for remote in editor.opened] == [True] * 2 + [False] * MAX_SESSIONS

"""The edit sessions of the console's tabs: one for each, ended when its tab is silent for long."""

from __future__ import annotations

import contextlib
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from robocorba.errors.base import RoboCorbaError

#: Maximum number of sessions of a console; the one that has been silent for longest makes place for a new one.
MAX_SESSIONS = 64
#: A session ends after this time without a call [s].
SILENCE_S = 1800.0


class NoSession(RoboCorbaError):
    """The tab's session has ended, or never began."""


class Editor(Protocol):
    """The map editor, as far as sessions need it."""

    def open_session(self, author: str) -> Any:
        """A new session of the author."""


@dataclass
class TabSession:
    """A tab's session. remote: its session at the map editor. used_s: on the clock of TabSessions."""

    author: str
    remote: Any
    used_s: float
    #: One edit of a tab at a time.
    lock: threading.Lock = field(default_factory=threading.Lock)


class TabSessions:
    """The sessions by key. Thread-safe."""

    def __init__(self, editor: Editor, clock: Callable[[], float] = time.monotonic) -> None:
        self._editor, self._clock = editor, clock
        self._lock = threading.Lock()
        self._sessions: dict[str, TabSession] = {}

    def open(self, author: str) -> str:
        """The key of a new session. Raises what the map editor raises, such as InvalidElement for the author's name."""
        session = TabSession(author, self._editor.open_session(author), self._clock())
        key = secrets.token_urlsafe(12)
        with self._lock:
            self._sessions[key] = session
            ended = self._ended()
        for each in ended:
            _close(each)
        return key

    def find(self, key: str) -> TabSession:
        """The session, which is used now. Raises NoSession."""
        with self._lock:
            session = self._sessions.get(key)
            if session is None:
                raise NoSession("the session of this page has ended; open another one")
            session.used_s = self._clock()
            return session

    def renew(self, session: TabSession) -> None:
        """Replace a session that the map editor has ended."""
        session.remote = self._editor.open_session(session.author)

    def close(self, key: str) -> None:
        """End a session; nothing happens if it has ended."""
        with self._lock:
            session = self._sessions.pop(key, None)
        if session is not None:
            _close(session)

    def _ended(self) -> list[TabSession]:
        """Remove the sessions that are silent for too long, or are too many."""
        oldest_first = sorted(self._sessions.items(), key=lambda item: item[1].used_s)
        too_many = len(oldest_first) - MAX_SESSIONS
        limit_s = self._clock() - SILENCE_S
        ended = [key for n, (key, each) in enumerate(oldest_first) if n < too_many or each.used_s < limit_s]
        return [self._sessions.pop(key) for key in ended]


def _close(session: TabSession) -> None:
    with contextlib.suppress(RoboCorbaError):  # the map editor ends it, too
        session.remote.close()

"""The edit sessions of the console's tabs, one for each."""

from __future__ import annotations

import contextlib
import secrets
import threading
from dataclasses import dataclass, field

from robocorba.console.arguments import NotPossible
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.corba.remote_edit_session import RemoteEditSession, RemoteMapEditor

#: Maximum number of sessions of a console; the one that has been silent for longest makes place for a new one. The map
#: editor ends those that are silent for an hour.
MAX_SESSIONS = 64


@dataclass
class TabSession:
    """A tab's session. remote: its session at the map editor."""

    author: str
    remote: RemoteEditSession
    #: One edit of a tab at a time.
    lock: threading.Lock = field(default_factory=threading.Lock)


class TabSessions:
    """The sessions by key. Thread-safe."""

    def __init__(self, editor: RemoteMapEditor) -> None:
        self._editor = editor
        self._lock = threading.Lock()
        #: The one that was used last is the last one.
        self._sessions: dict[str, TabSession] = {}

    def open(self, author: str) -> str:
        """The key of a new session. Raises what the map editor raises, such as InvalidElement for the author's name."""
        session = TabSession(author, self._editor.open_session(author))
        key = secrets.token_urlsafe(12)
        with self._lock:
            self._sessions[key] = session
            silent = [self._sessions.pop(each) for each in list(self._sessions)[:-MAX_SESSIONS]]
        for each in silent:
            _close(each)
        return key

    def find(self, key: str) -> TabSession:
        """The session, which is used now. Raises NotPossible."""
        with self._lock:
            if key not in self._sessions:
                raise NotPossible("the session of this page has ended; open another one")
            session = self._sessions[key] = self._sessions.pop(key)
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


def _close(session: TabSession) -> None:
    with contextlib.suppress(RoboCorbaError):  # the map editor ends it, too
        session.remote.close()

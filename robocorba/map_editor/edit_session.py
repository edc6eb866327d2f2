"""Sessions of the map building agent: the edits of one author, who can undo and redo them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.errors.maps import SessionEnded
from robocorba.map_editor.author_history import AuthorHistory, check_author
from robocorba.map_editor.idle import Opened, OpenedByClients
from robocorba.map_editor.map_building_agent import BuildingEditor, Transaction
from robocorba.map_editor.model import Element, ElementKind
from robocorba.map_editor.store import DEFAULT_LIMITS, MapLimits


class EditSession(Opened):
    """The edits of one author. Every method raises SessionEnded after `close`, or after an hour without a call.

    Edits as in BuildingEditor; they return the building's new version. is_open: whether it was neither closed nor has
    timed out."""

    def __init__(self, sessions: EditSessions, author: str) -> None:
        self._sessions, self._editor, self._history = sessions, sessions.editor, AuthorHistory(author)

    @property
    def author(self) -> str:
        """The author's name."""
        return self._history.author

    @property
    def undoable(self) -> str:
        """A summary of the edit that `undo` would revert; empty if there is none."""
        return self._editor.last_summary(self._in_use().done)

    @property
    def redoable(self) -> str:
        """A summary of the edit that `redo` would repeat; empty if there is none."""
        return self._editor.last_summary(self._in_use().undone)

    def find(self, kind: ElementKind, floor: str, name: str) -> Element | None:
        """An element, None if there is none."""
        return self._editor.building.find(kind, floor, name)

    def create(self, floor: str, element: Element) -> int:
        """As BuildingEditor.create."""
        return self._editor.create(floor, element, self._in_use())

    def change(self, floor: str, element: Element, expected: int) -> int:
        """As BuildingEditor.change."""
        return self._editor.change(floor, element, expected, self._in_use())

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> int:
        """As BuildingEditor.remove."""
        return self._editor.remove(kind, floor, name, expected, self._in_use())

    def rename(self, kind: ElementKind, floor: str, name: str, new_name: str, expected: int) -> int:
        """As BuildingEditor.rename."""
        return self._editor.rename(kind, floor, name, new_name, expected, self._in_use())

    def begin(self) -> Transaction:
        """As BuildingEditor.begin; its commit is one edit of this author."""
        return self._editor.begin(self._in_use())

    def undo(self) -> int:
        """Revert this author's last edit.

        Raises NothingToUndo, InvalidElement if the result would break a rule, and EditedByOthers if somebody else has
        changed an element of the edit since. The next undo then takes the author's edit before it."""
        return self._editor.undo_own(self._in_use())

    def redo(self) -> int:
        """Repeat the edit that this author undid last. Raises NothingToRedo, InvalidElement, EditedByOthers."""
        return self._editor.redo_own(self._in_use())

    def close(self) -> None:
        """End the session. Its edits stay."""
        self._sessions.close(self)

    def _in_use(self) -> AuthorHistory:
        with self._sessions.lock:
            self._sessions.check_open(self)
        return self._history


class EditSessions:
    """The sessions of the authors who edit a building. Safe from any thread. `clock` returns the time [s]."""

    def __init__(
        self, editor: BuildingEditor, limits: MapLimits = DEFAULT_LIMITS, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.editor, self._limits = editor, limits
        self.lock = threading.Lock()
        self._open = OpenedByClients[EditSession](clock, limits.session_timeout_s, limits.forgotten_session_s)

    def open(self, author: str) -> EditSession:
        """A session for an author, in place of one that its client has forgotten if there are too many.

        Raises InvalidElement for the name, TooManyTransactions."""
        check_author(author)
        with self.lock:
            self._open.end_idle()
            if len(self._open.all) >= self._limits.sessions:
                self._open.make_place(self._open.all, self._limits.sessions)
            session = EditSession(self, author)
            self._open.add(session)
            return session

    def close(self, session: EditSession) -> None:
        """End a session. Raises SessionEnded."""
        with self.lock:
            self.check_open(session)
            self._open.close(session)

    def end_idle(self) -> None:
        """End those that have timed out."""
        with self.lock:
            self._open.end_idle()

    def check_open(self, session: EditSession) -> None:
        """A session is called: its timeout starts again. Raises SessionEnded. Requires the lock."""
        if not self._open.use(session):
            raise SessionEnded("the edit session was closed, or was without a call for too long")

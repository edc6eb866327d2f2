"""Servants of the map building agent: the map editor, its sessions and transactions."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol

from robocorba.errors.maps import InvalidElement, MapFileError, ReplyTooLarge, VersionUnavailable
from robocorba.errors.services import ServiceError
from robocorba.map_editor import native
from robocorba.map_editor.corba import maps
from robocorba.map_editor.edit_session import EditSession, EditSessions
from robocorba.map_editor.long_requests import LongRequests
from robocorba.map_editor.map_building_agent import BuildingEditor, Transaction
from robocorba.map_editor.pages import MAX_PAGE
from robocorba.map_editor.proposals import Proposals
from robocorba.map_editor.time_limit import time_limit
from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.extras import require_extra

#: Closed transactions whose servants stay active and raise TransactionClosed; older ones are deactivated.
CLOSED_TRANSACTIONS_KEPT = 100
#: Maximum number of findings in a reply: each takes about 500 bytes, and a reply is limited to 64 MiB.
MAX_FINDINGS = 10_000


class Activator(Protocol):
    """Activates and deactivates servants, e.g. robocorba.orb.orb.Orb."""

    def activate(self, servant: Any) -> Any:
        """Activate a servant; its object reference."""

    def deactivate(self, servant: Any) -> None:
        """Deactivate a servant."""


class TransactionServant(RoboCorba__POA.Transaction):
    """RoboCorba::Transaction."""

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction

    @property
    def is_open(self) -> bool:
        """Whether it is neither committed, rolled back nor timed out."""
        return self._transaction.is_open

    @translating
    def create(self, onFloor: str, value: Any) -> None:
        self._transaction.create(onFloor, maps.element_of(value))

    @translating
    def change(self, onFloor: str, value: Any, expected: int) -> None:
        self._transaction.change(onFloor, maps.replacement_of(value, onFloor, self._transaction.find), expected)

    @translating
    def setFact(self, fact: Any, expected: int) -> None:
        self._transaction.change(*maps.edited(fact, self._transaction.find), expected)

    @translating
    def remove(self, id: Any, expected: int) -> None:
        self._transaction.remove(*maps.key_of(id), expected)

    commit = forwarded("_transaction", Transaction.commit)
    rollBack = forwarded("_transaction", Transaction.roll_back)

    @translating
    def problems(self) -> list[Any]:
        return maps.findings(self._transaction.problems()[:MAX_FINDINGS])


class ActiveServants:
    """The servants of objects that are open or ended lately; those that ended before are deactivated."""

    def __init__(self, activator: Activator, ended_kept: int) -> None:
        self._activator, self._ended_kept = activator, ended_kept
        self._servants: list[Any] = []
        self._changing = threading.Lock()

    def activate(self, make: Callable[[], Any]) -> Any:
        """A reference to the servant that `make` returns."""
        with self._changing:
            servant = make()
            self._deactivate_ended()
            self._servants.append(servant)
            return self._activator.activate(servant)

    def deactivate_ended(self) -> None:
        """Deactivate those that ended before the ones that are kept."""
        with self._changing:
            self._deactivate_ended()

    def _deactivate_ended(self) -> None:
        ended = [each for each in self._servants if not each.is_open]
        for oldest in ended[: max(len(ended) - self._ended_kept, 0)]:
            self._servants.remove(oldest)
            self._activator.deactivate(oldest)


class EditSessionServant(RoboCorba__POA.EditSession):
    """RoboCorba::EditSession."""

    def __init__(
        self, session: EditSession, proposals: Proposals, transactions: ActiveServants, ended: Callable[[], None]
    ) -> None:
        self._session, self._proposals, self._transactions, self._ended = session, proposals, transactions, ended

    @property
    def is_open(self) -> bool:
        """Whether it was neither closed nor has timed out."""
        return self._session.is_open

    def _get_author(self) -> str:
        return self._session.author

    @translating
    def _get_undoable(self) -> str:
        return self._session.undoable

    @translating
    def _get_redoable(self) -> str:
        return self._session.redoable

    @translating
    def create(self, onFloor: str, value: Any) -> int:
        return self._session.create(onFloor, maps.element_of(value))

    @translating
    def change(self, onFloor: str, value: Any, expected: int) -> int:
        return self._session.change(onFloor, maps.replacement_of(value, onFloor, self._session.find), expected)

    @translating
    def setFact(self, fact: Any, expected: int) -> int:
        return self._session.change(*maps.edited(fact, self._session.find), expected)

    @translating
    def remove(self, id: Any, expected: int) -> int:
        return self._session.remove(*maps.key_of(id), expected)

    @translating
    def rename(self, id: Any, name: str, expected: int) -> int:
        return self._session.rename(*maps.key_of(id), name, expected)

    @translating
    def acceptProposal(self, name: str) -> int:
        proposal = self._proposals.find(name)
        return self._session.create(proposal.floor, proposal.element)

    @translating
    def begin(self) -> Any:
        return self._transactions.activate(lambda: TransactionServant(self._session.begin()))

    undo = forwarded("_session", EditSession.undo)
    redo = forwarded("_session", EditSession.redo)

    @translating
    def close(self) -> None:
        self._session.close()
        self._ended()


class MapEditorServant(ServerServant, RoboCorba__POA.MapEditor):
    """RoboCorba::MapEditor for a BuildingEditor, the sessions of its authors, and proposals that follow it."""

    def __init__(self, sessions: EditSessions, proposals: Proposals, activator: Activator) -> None:
        self._editor, self._sessions, self._proposals = sessions.editor, sessions, proposals
        self._transactions = ActiveServants(activator, CLOSED_TRANSACTIONS_KEPT)
        self._session_servants = ActiveServants(activator, 0)
        self._long_requests = LongRequests()

    def _get_buildingName(self) -> str:
        return self._editor.building.name

    def _get_currentVersion(self) -> int:
        return self._editor.version

    def floors(self) -> list[str]:
        return list(self._editor.building.floors)

    @translating
    def elements(self, kind: Any, onFloor: str) -> list[Any]:
        kind = maps.kind_of(kind)
        with self._admitted(self._editor.count(kind, onFloor)):
            found = self._editor.elements(kind, onFloor)
            if len(found) > 500_000:  # with short names, each takes about 100 bytes of the 64 MiB of a reply
                raise ReplyTooLarge(f"{len(found)} elements don't fit into a message; read them in pages")
            return [maps.record(onFloor, value, changed_in) for value, changed_in in found]

    def _admitted(self, size: int) -> AbstractContextManager[None]:
        """Admission of a request for so many elements or changes: more than a page waits for other long ones."""
        return self._long_requests.admitted() if size > MAX_PAGE else nullcontext()

    @translating
    def read(self, id: Any) -> Any:
        key = maps.key_of(id)
        return maps.record(key.floor, *self._editor.read(*key))

    @translating
    def create(self, onFloor: str, value: Any) -> int:
        return self._editor.create(onFloor, maps.element_of(value))

    @translating
    def change(self, onFloor: str, value: Any, expected: int) -> int:
        return self._editor.change(onFloor, maps.replacement_of(value, onFloor, self._editor.building.find), expected)

    @translating
    def readFacts(self, part: Any) -> list[Any]:
        return maps.facts_of(self._editor.building, maps.selection_of(part))

    @translating
    def setFact(self, fact: Any, expected: int) -> int:
        return self._editor.change(*maps.edited(fact, self._editor.building.find), expected)

    @translating
    def remove(self, id: Any, expected: int) -> int:
        return self._editor.remove(*maps.key_of(id), expected)

    @translating
    def begin(self) -> Any:
        return self._transactions.activate(lambda: TransactionServant(self._editor.begin()))

    @translating
    def rename(self, id: Any, name: str, expected: int) -> int:
        return self._editor.rename(*maps.key_of(id), name, expected)

    @translating
    def openSession(self, author: str) -> Any:
        def servant() -> EditSessionServant:
            session = self._sessions.open(author)
            ended = self._session_servants.deactivate_ended
            return EditSessionServant(session, self._proposals, self._transactions, ended)

        return self._session_servants.activate(servant)

    @translating
    def editsSince(self, since: int) -> list[Any]:
        return [maps.edit(each) for each in self._editor.edits_since(since)]

    @translating
    def propose(self, onFloor: str, outline: Any, certainty: float, seenBy: str) -> str:
        return self._proposals.propose(onFloor, [maps.xy_of(point) for point in outline], certainty, seenBy)

    def proposals(self) -> list[Any]:
        return [maps.proposal(each) for each in self._proposals.open()]

    rejectProposal = forwarded("_proposals", Proposals.reject)

    @translating
    def getUnderlay(self, onFloor: str) -> Any:
        return maps.underlay(self._editor.underlay(onFloor))

    @translating
    def setUnderlay(self, onFloor: str, value: Any) -> None:
        self._editor.set_underlay(onFloor, maps.underlay_of(value))

    undo = forwarded("_editor", BuildingEditor.undo)
    redo = forwarded("_editor", BuildingEditor.redo)

    @translating
    def changesSince(self, since: int) -> list[Any]:
        # Changes in a reply: 2 s of work for the server. readChanges has no such limit.
        count, limit = self._editor.count_changes(since), 100_000
        if count > limit:
            raise VersionUnavailable(since, self._editor.oldest_within(limit), self._editor.version)
        with self._admitted(count):
            return maps.changes(self._editor.changes_since(since))

    @translating
    def readChanges(self, start: Any, part: Any, limit: int) -> Any:
        position, selection = maps.position_of(start), maps.selection_of(part)
        return maps.change_page(self._editor.change_page(position, selection, min(limit or MAX_PAGE, MAX_PAGE)))

    @translating
    def readElements(self, start: int, part: Any, limit: int) -> Any:
        selection = maps.selection_of(part)
        return maps.element_page(self._editor.element_page(start, selection, min(limit or MAX_PAGE, MAX_PAGE)))

    @translating
    def buildTopologicalMap(self, onFloor: str, robotRadius: float) -> int:
        try:
            require_extra("maps", "generated topological maps")
        except ServiceError as error:
            raise InvalidElement("floor", "", onFloor, str(error)) from None
        # Imported here: it takes 0.5 s to load, and a server must restart quickly.
        from robocorba.map_editor.topology import topological_map

        check_time = time_limit(f"the topological map of {onFloor[:80]}")
        roads = topological_map(self._editor.building, onFloor, robotRadius, check_time=check_time)
        return self._editor.replace_topology(onFloor, roads)

    @translating
    def check(self) -> list[Any]:
        from robocorba.map_editor.checking import findings  # imported here for the same reason

        check_time = time_limit("the check of the building")
        return maps.findings(findings(self._editor.building, check_time=check_time)[:MAX_FINDINGS])

    @translating
    def checkFloor(self, onFloor: str, robotRadius: float) -> list[Any]:
        from robocorba.map_editor.checking import floor_findings  # imported here for the same reason

        check_time = time_limit(f"the check of {onFloor[:80]}")
        found = floor_findings(self._editor.building, onFloor, robotRadius, check_time)
        return maps.findings(found[:MAX_FINDINGS])

    @translating
    def exportMap(self) -> str:
        with self._long_requests.admitted():
            document = native.dumps(self._editor.building)
        limit = 64 * 1024 * 1024 - 1024  # bytes of a message, less its header
        if len(document) > limit or len(document.encode()) > limit:
            raise ReplyTooLarge("the map file does not fit into a message; read the building in pages")
        return document

    @translating
    def importMap(self, document: str, expected: int) -> int:
        with self._long_requests.admitted():
            try:
                gc.disable()  # each search for cycles among millions of new objects stops all threads for up to 0.4 s
                building = native.loads(document, "document")
            except MapFileError as error:
                raise RoboCorba.InvalidMap(error.line, error.key, error.reason) from error
            finally:
                gc.enable()
            try:
                return self._editor.replace(building, expected)
            except InvalidElement as error:  # valid, but too large
                raise RoboCorba.InvalidMap(0, "", str(error)) from error

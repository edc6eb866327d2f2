"""Clients that edit the building: the map editor, the session of an author, transactions. With values of maps.model."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.maps import SessionEnded, TransactionClosed
from robocorba.map_editor.corba import maps
from robocorba.map_editor.corba.remote_map import RemoteMap, changes_after, element_pages, facts_of
from robocorba.map_editor.edits import EditRecord, Finding, MapChange
from robocorba.map_editor.model import Building, Element, ElementKind
from robocorba.map_editor.pages import Selection
from robocorba.map_editor.proposals import Proposal
from robocorba.map_editor.underlays import Underlay
from robocorba.orb.calls import set_call_timeout
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject, translated
from robocorba.stubs import RoboCorba

#: Timeouts [s]: to resolve the map editor, which also limits the rate of attempts; of edits and queries; of operations
#: that analyse or replace the whole building.
RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S, LONG_CALL_TIMEOUT_S = 2.0, 5.0, 60.0
WHAT = "the map editor"

Answer = TypeVar("Answer")


class RemoteMapEditor:
    """The map editor: reads, checks and sessions. Thread-safe.

    Every method raises NotReachable if the map editor does not answer, and the errors of robocorba.errors.maps."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._editor = RemoteObject(orb, "MapEditor", RoboCorba.MapEditor, WHAT, RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S)
        self._slow_editor = RemoteObject(
            orb, "MapEditor", RoboCorba.MapEditor, WHAT, RESOLVE_TIMEOUT_S, LONG_CALL_TIMEOUT_S
        )

    def version(self) -> int:
        """The building's version."""
        return int(self._editor.call(lambda editor: editor._get_currentVersion()))

    def building_name(self) -> str:
        """The building's name."""
        return str(self._editor.call(lambda editor: editor._get_buildingName()))

    def building(self) -> tuple[Building, int]:
        """The whole building and its version."""
        loaded = RemoteMap(self._orb, RESOLVE_TIMEOUT_S, with_topology=True)
        return loaded.building, loaded.version

    def elements(self, kind: ElementKind, floor: str = "") -> list[tuple[Element, int]]:
        """All elements of a kind on a floor, with the version that last changed each. Raises UnknownElement."""
        part = Selection((kind,), floor)
        pages = self._editor.call(lambda editor: list(element_pages(editor, part)))
        records = [record for page in pages for record in page.elements]
        if not records:
            records = self._editor.call(lambda editor: editor.elements(maps.enumerator_of(kind), floor))
        return self._with_facts(part, records)

    def read(self, kind: ElementKind, floor: str, name: str) -> tuple[Element, int]:
        """An element and the version that last changed it. Raises UnknownElement."""
        record = self._editor.call(lambda editor: editor.read(maps.element_id(kind.value, floor, name)))
        return self._with_facts(Selection((kind,), floor), [record])[0]

    def _with_facts(self, part: Selection, records: Sequence[Any]) -> list[tuple[Element, int]]:
        """The elements of records of one kind and floor, with their facts and versions."""
        found = {value.name: value for value in (maps.element_of(record.value) for record in records)}
        if known := maps.fact_keys(part.kinds[0]):
            for fact in self._editor.call(lambda editor: list(facts_of(editor, part))):
                if fact.id.name in found and fact.key in known:
                    found[fact.id.name] = maps.with_fact(found[fact.id.name], fact)
        return [(value, record.changedAt) for value, record in zip(found.values(), records, strict=True)]

    def changes_since(self, version: int) -> list[MapChange]:
        """The changes after `version`, in order. Raises VersionUnavailable."""
        return self._editor.call(lambda editor: list(changes_after(editor, version)))

    def edits_since(self, version: int) -> list[EditRecord]:
        """The edits after `version`, oldest first. Raises VersionUnavailable."""
        return [maps.edit_of(each) for each in self._editor.call(lambda editor: editor.editsSince(version))]

    def check(self) -> list[Finding]:
        """What robots of the usual radius can't do in the building."""
        return maps.findings_of(self._slow_editor.call(lambda editor: editor.check()))

    def check_floor(self, floor: str, radius_m: float) -> list[Finding]:
        """What a robot of `radius_m` can't do on a floor. Raises UnknownElement, InvalidElement for the radius."""
        return maps.findings_of(self._slow_editor.call(lambda editor: editor.checkFloor(floor, radius_m)))

    def build_topological_map(self, floor: str, radius_m: float) -> int:
        """Generate the topological map of a floor again, as one edit without an author. Returns the new version."""
        return int(self._slow_editor.call(lambda editor: editor.buildTopologicalMap(floor, radius_m)))

    def import_map(self, document: str, expected: int) -> int:
        """Replace the building by a native map file, as one edit. Returns the new version.

        Raises MapFileError with line and key, StaleVersion unless the building is at version `expected`."""
        return int(self._slow_editor.call(lambda editor: editor.importMap(document, expected)))

    def undo(self, expected: int) -> int:
        """Revert the last edit of any author. Returns the new version. Raises StaleVersion, NothingToUndo."""
        return int(self._slow_editor.call(lambda editor: editor.undo(expected)))

    def proposals(self) -> list[Proposal]:
        """The open proposals, oldest first."""
        return [maps.proposal_of(each) for each in self._editor.call(lambda editor: editor.proposals())]

    def reject_proposal(self, name: str) -> None:
        """Close a proposal. Raises UnknownElement if it is not open."""
        self._editor.call(lambda editor: editor.rejectProposal(name))

    def underlay(self, floor: str) -> Underlay | None:
        """The picture below a floor, if there is one. Raises UnknownElement."""
        return maps.underlay_of(self._slow_editor.call(lambda editor: editor.getUnderlay(floor)))

    def set_underlay(self, floor: str, underlay: Underlay | None) -> None:
        """Set or remove the picture below a floor. Raises UnknownElement, InvalidElement."""
        self._slow_editor.call(lambda editor: editor.setUnderlay(floor, maps.underlay(underlay)))

    def open_session(self, author: str) -> RemoteEditSession:
        """A session for the edits of one author (1 to 60 characters). Raises InvalidElement, TooManyTransactions."""
        return RemoteEditSession(self._editor.call(lambda editor: editor.openSession(author)), author)


class _Reference:
    """A reference to an object that ends: a call to an ended one raises `ended`."""

    def __init__(self, reference: Any, ended: RoboCorbaError) -> None:
        self._reference, self._ended = reference, ended
        set_call_timeout(reference, CALL_TIMEOUT_S)

    def call(self, operation: Callable[[Any], Answer]) -> Answer:
        with translated(WHAT):
            try:
                return operation(self._reference)
            except (CORBA.OBJECT_NOT_EXIST, CORBA.OBJ_ADAPTER):
                raise type(self._ended)(str(self._ended)) from None

    def call_long(self, operation: Callable[[Any], Answer]) -> Answer:
        """`call` of an operation on an edit of any size, which may take as long as one on the whole building."""
        set_call_timeout(self._reference, LONG_CALL_TIMEOUT_S)
        try:
            return self.call(operation)
        finally:
            set_call_timeout(self._reference, CALL_TIMEOUT_S)


class RemoteEditSession:
    """An author's edits. All methods raise SessionEnded once the session has ended: closed, an hour without a call, or
    the map editor was restarted. Edits return the building's new version."""

    def __init__(self, reference: Any, author: str) -> None:
        self.author = author
        self._session = _Reference(reference, SessionEnded("the edit session has ended; open another one"))

    def create(self, floor: str, element: Element) -> int:
        """Add an element. Raises DuplicateElement, UnknownElement for the floor, InvalidElement."""
        if not maps.facts(floor, element):
            return self._version(lambda session: session.create(floor, maps.element(element)))
        transaction = self.begin()
        transaction.create(floor, element)
        return transaction.commit()

    def change(self, floor: str, element: Element, expected: int) -> int:
        """Replace the element of that kind, floor and name. Raises UnknownElement, StaleEdit, InvalidElement."""
        if not maps.facts(floor, element):
            return self._version(lambda session: session.change(floor, maps.element(element), expected))
        transaction = self.begin()
        transaction.change(floor, element, expected)
        return transaction.commit()

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> int:
        """Remove an element. Raises UnknownElement, StaleEdit, InvalidElement if a remaining element refers to it."""
        return self._version(lambda session: session.remove(maps.element_id(kind.value, floor, name), expected))

    def rename(self, kind: ElementKind, floor: str, name: str, new_name: str, expected: int) -> int:
        """Rename an element, also where others refer to it. Raises UnknownElement, DuplicateElement, StaleEdit,
        InvalidElement."""
        return self._version(
            lambda session: session.rename(maps.element_id(kind.value, floor, name), new_name, expected)
        )

    def accept_proposal(self, name: str) -> int:
        """Make the object of a proposal. Raises UnknownElement if it is not open, DuplicateElement, InvalidElement."""
        return self._version(lambda session: session.acceptProposal(name))

    def begin(self) -> RemoteTransaction:
        """A transaction, which is one edit of this author. Raises TooManyTransactions."""
        return RemoteTransaction(self._session.call(lambda session: session.begin()))

    def undoable(self) -> str:
        """What `undo` would revert; empty if there is nothing."""
        return str(self._session.call(lambda session: session._get_undoable()))

    def redoable(self) -> str:
        """What `redo` would repeat; empty if there is nothing."""
        return str(self._session.call(lambda session: session._get_redoable()))

    def undo(self) -> int:
        """Revert this author's last edit. Raises NothingToUndo, InvalidElement, and EditedByOthers if somebody else has
        changed an element of it since; the next undo takes the edit before it then."""
        return int(self._session.call_long(lambda session: session.undo()))

    def redo(self) -> int:
        """Repeat the edit that was undone last. Raises NothingToRedo, InvalidElement, EditedByOthers."""
        return int(self._session.call_long(lambda session: session.redo()))

    def close(self) -> None:
        """End the session. Its edits stay. Closing an ended session has no effect."""
        with contextlib.suppress(SessionEnded):
            self._session.call(lambda session: session.close())

    def _version(self, operation: Callable[[Any], int]) -> int:
        return self._session.call(operation)


class RemoteTransaction:
    """Several edits that take effect together or not at all. All methods raise TransactionClosed once it has ended."""

    def __init__(self, reference: Any) -> None:
        self._transaction = _Reference(reference, TransactionClosed("the transaction has ended"))

    def create(self, floor: str, element: Element) -> None:
        """As RemoteEditSession.create."""
        self._transaction.call(lambda transaction: transaction.create(floor, maps.element(element)))
        self._set_facts(floor, element, 0)

    def change(self, floor: str, element: Element, expected: int) -> None:
        """As RemoteEditSession.change. An element that this transaction created has version 0."""
        self._transaction.call(lambda transaction: transaction.change(floor, maps.element(element), expected))
        self._set_facts(floor, element, expected)

    def _set_facts(self, floor: str, element: Element, expected: int) -> None:
        for fact in maps.facts(floor, element):
            self._transaction.call(lambda transaction: transaction.setFact(fact, expected))  # noqa: B023

    def remove(self, kind: ElementKind, floor: str, name: str, expected: int) -> None:
        """As RemoteEditSession.remove."""
        self._transaction.call(
            lambda transaction: transaction.remove(maps.element_id(kind.value, floor, name), expected)
        )

    def problems(self) -> list[Finding]:
        """Every rule that the building as changed so far would break at the commit. Changes nothing."""
        return maps.findings_of(self._transaction.call(lambda transaction: transaction.problems()))

    def commit(self) -> int:
        """Make all edits as one. Returns the building's version. After an error the transaction is closed."""
        return int(self._transaction.call_long(lambda transaction: transaction.commit()))

    def roll_back(self) -> None:
        """Discard all edits."""
        self._transaction.call(lambda transaction: transaction.rollBack())

"""Edits that the map page asks for, made in one transaction with what has to change with them."""

from __future__ import annotations

import contextlib
from typing import Any, NamedTuple

from robocorba.console.arguments import InvalidArguments, text, whole
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.maps import InvalidElement, MapError, StaleEdit, UnknownElement
from robocorba.map_editor.changes import ElementKey, key
from robocorba.map_editor.consequences import with_consequences
from robocorba.map_editor.corba.remote_edit_session import RemoteMapEditor
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.element_json import from_json
from robocorba.map_editor.model import COLLECTION_OF, Building, Element, ElementKind, FloorMap

#: Maximum number of edits in one step.
MAX_EDITS = 5000


class Refused(MapError):
    """The edits together break rules; `problems` lists all of them with their places."""

    def __init__(self, reason: str, problems: list[Finding]) -> None:
        self.problems = problems
        super().__init__(reason)


class Edit(NamedTuple):
    """One edit. element: of create and change. version: of the element that the page has. to: the name to give."""

    do: str
    kind: ElementKind
    floor: str
    name: str
    element: Element | None = None
    version: int = 0
    to: str = ""

    @property
    def key(self) -> ElementKey:
        """The key of the element."""
        return key(self.kind, self.floor, self.name)


def read_edits(values: Any) -> list[Edit]:
    """The edits of JSON objects. Raises InvalidArguments, InvalidElement."""
    if not isinstance(values, list) or not 0 < len(values) <= MAX_EDITS:
        raise InvalidArguments(f"give a list of 1 to {MAX_EDITS} edits")
    return [_edit(value) for value in values]


def _edit(value: Any) -> Edit:
    try:
        do, kind = value["do"], ElementKind(value["kind"])
        floor, name, to = (text(each, value.get(each, "")) for each in ("floor", "name", "to"))
        version = whole("version", value.get("version", 0))
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InvalidArguments("an edit has do, kind, floor, name and version") from None
    if do not in ("create", "change", "remove", "rename"):
        raise InvalidArguments(f"{str(do)[:40]!r} is none of create, change, remove, rename")
    floor = floor if kind in COLLECTION_OF else ""
    if do in ("remove", "rename"):
        return Edit(do, kind, floor, name, version=version, to=to)
    element = from_json(kind, floor, value.get("members"))
    if element.name != name:
        raise InvalidArguments(
            f"{kind.value} {name[:80]!r} would get the name {element.name[:80]!r}; rename it instead"
        )
    return Edit(do, kind, floor, name, element, version)


def apply_edits(editor: RemoteMapEditor, session: Any, edits: list[Edit]) -> int:
    """Make the edits in one transaction of a session. Returns the version of the building.

    Raises Refused with all problems, and what the session raises."""
    building, versions = _read(editor, edits)
    versions.update({edit.key: edit.version for edit in edits if edit.do != "create"})
    wanted = {edit.key: edit.element for edit in edits}
    created = {edit.key for edit in edits if edit.do == "create"}
    steps = [
        (touched, after, touched in created or (touched not in wanted and building.find(*touched) is None))
        for touched, after in with_consequences(building, wanted).items()
        if touched in wanted or building.find(*touched) != after
    ]
    steps.sort(key=lambda step: _rank(step[0], step[1]))
    try:
        return _commit(session, steps, versions)
    except InvalidElement as error:
        problems = _problems(session, steps, versions)
        raise Refused(str(error), problems) from None


Step = tuple[ElementKey, Element | None, bool]


def _read(editor: RemoteMapEditor, edits: list[Edit]) -> tuple[Building, dict[ElementKey, int]]:
    """The parts of the building that the edits may concern, with the versions of their elements."""
    floors = editor.elements(ElementKind.FLOOR)
    building = Building("", {found.name: FloorMap(found) for found, _ in floors})  # type: ignore[arg-type]
    whole = any(edit.kind in (ElementKind.ELEVATOR, ElementKind.FLOOR) for edit in edits)
    names = {edit.floor for edit in edits} - {""}
    rows = [(ElementKind.FLOOR, "", *each) for each in floors]
    rows += [(ElementKind.ELEVATOR, "", *each) for each in editor.elements(ElementKind.ELEVATOR)]
    for floor in building.floors if whole else names & building.floors.keys():
        for kind in COLLECTION_OF if floor in names else (ElementKind.NODE, ElementKind.EDGE):
            rows += [(kind, floor, *each) for each in editor.elements(kind, floor)]
    building = building.with_changes((kind, floor, element.name, element) for kind, floor, element, _ in rows)
    return building, {ElementKey(kind, floor, element.name): at for kind, floor, element, at in rows}


def _rank(key: ElementKey, after: Element | None) -> int:
    """Floors are created first and removed last; what others need is created before and removed after these."""
    order = {ElementKind.FLOOR: 0, ElementKind.ELEVATOR: 1, ElementKind.NODE: 2}.get(key.kind, 3)
    return 10 - order if after is None else order


def _commit(session: Any, steps: list[Step], versions: dict[ElementKey, int]) -> int:
    transaction = session.begin()
    try:
        _fill(transaction, steps, versions)
    except RoboCorbaError:
        _roll_back(transaction)
        raise
    return int(transaction.commit())


def _problems(session: Any, steps: list[Step], versions: dict[ElementKey, int]) -> list[Finding]:
    """Everything that is wrong with the steps together; empty if an element alone is invalid."""
    transaction = session.begin()
    try:
        _fill(transaction, steps, versions)
        found: list[Finding] = transaction.problems()
        return found
    except MapError:
        return []
    finally:
        _roll_back(transaction)


def _fill(transaction: Any, steps: list[Step], versions: dict[ElementKey, int]) -> None:
    for touched, after, is_new in steps:
        if after is None:
            transaction.remove(*touched, versions.get(touched, 0))
        elif is_new:
            transaction.create(touched.floor, after)
        else:
            transaction.change(touched.floor, after, versions.get(touched, 0))


def _roll_back(transaction: Any) -> None:
    with contextlib.suppress(RoboCorbaError):  # it has ended, or ends by itself
        transaction.roll_back()


def stale_of(error: Exception) -> dict[str, str] | None:
    """The element that somebody else has changed or removed meanwhile, if that is why."""
    if isinstance(error, StaleEdit | UnknownElement):
        return {"kind": error.kind, "floor": error.floor, "name": error.name}
    return None

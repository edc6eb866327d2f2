"""Clients of the map editor: copies of its building or of one floor, and positions of path nodes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.corba import maps
from robocorba.map_editor.edits import MapChange
from robocorba.map_editor.lineage import FOLLOWED, SAME_NAMES, Lineage
from robocorba.map_editor.model import Area, Building, ElementKind, MapObject
from robocorba.map_editor.pages import (
    EVERYTHING,
    MAX_PAGE,
    ChangePosition,
    Selection,
    building_of,
    size_of_copy,
    with_changes_of,
)
from robocorba.map_editor.proposals import Proposal
from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject, translated
from robocorba.stubs import RoboCorba

#: Element kinds of a RemoteFloorMap: those that can be obstacles.
_FLOOR_KINDS = (ElementKind.FLOOR, ElementKind.ELEVATOR, ElementKind.WALL, ElementKind.OBJECT, ElementKind.DOOR)

_log = logging.getLogger(__name__)


class RemoteMap:
    """A copy of the geometrical maps and elevators of the building, loaded once and then updated by changes.

    Both are read in pages, so an edit of any size arrives; a read that fails continues where it was. A copy that is far
    behind is loaded again. with_topology: also of the topological maps. One thread may use it. Raises NotReachable if
    there is no map editor within `timeout_s`, or if loading fails. An editor that compiles for the first time starts
    slowly; the starter of this process waits no longer than the default."""

    building: Building
    version: int

    def __init__(self, orb: Orb, timeout_s: float = 300.0, with_topology: bool = False) -> None:
        topological = (ElementKind.NODE, ElementKind.EDGE)  # only the path planning agent uses them
        kinds = () if with_topology else tuple(kind for kind in ElementKind if kind not in topological)
        self._part = Selection(kinds)
        self._editor = orb.resolve("MapEditor", RoboCorba.MapEditor, timeout_s)
        #: Changes that have been read, but not all of their version, and where the next page of them begins.
        self._pending: list[MapChange] = []
        self._next = ChangePosition(0)
        self._load()

    def follow(self) -> bool:
        """Apply the editor's new changes; whether there were any. Raises NotReachable."""
        before = self.version
        try:
            if self._editor._get_currentVersion() != before and not self._apply_changes():
                self._load()
        except CORBA.SystemException as error:
            raise NotReachable(f"the map editor does not answer ({describe(error)})") from None
        return self.version != before

    def lineage(self, since: int) -> Lineage:
        """Which elements of the copy are those of an earlier version; by their names if its changes are not kept any
        more. Raises NotReachable."""
        try:
            return _lineage(self._editor, since, self.version)
        except CORBA.SystemException as error:
            raise NotReachable(f"the map editor does not answer ({describe(error)})") from None

    def proposals(self) -> list[Proposal]:
        """The open proposals, oldest first; none of a map editor that does not know them. Raises NotReachable."""
        with translated("the map editor"):
            try:
                return [maps.proposal_of(each) for each in self._editor.proposals()]
            except CORBA.BAD_OPERATION:
                return []

    def _load(self) -> None:
        """Load the building at least as it is now."""
        try:
            for _ in range(3):
                pages = element_pages(self._editor, self._part)
                first = next(pages)
                version, name = first.readAt, self._editor._get_buildingName()
                elements = chain(first.elements, chain.from_iterable(page.elements for page in pages))
                building = building_of(name, ((record.onFloor, maps.element_of(record.value)) for record in elements))
                self.building, self.version = maps.with_facts(building, facts_of(self._editor, self._part)), version
                self._pending, self._next = [], ChangePosition(version)
                if self._apply_changes(at_any_cost=True):  # edits during loading
                    return
        except CORBA.Exception as error:
            raise NotReachable(f"the map can't be loaded from the map editor ({describe(error)})") from None
        raise NotReachable("the map was edited faster than it could be loaded, 3 times")

    def _apply_changes(self, at_any_cost: bool = False) -> bool:
        """Read the changes up to the current version, then apply them together. Returns False, unless `at_any_cost`, if
        they are more than the elements of the copy; in any case if they are not kept any more. Load it again then."""
        part, is_last = maps.selection(self._part), False
        while not is_last:
            try:
                page = self._editor.readChanges(maps.position(self._next), part, 0)
            except RoboCorba.VersionUnavailable:
                return False
            self._pending += maps.changes_of(page.changes)
            self._next, is_last = maps.position_of(page.next), page.isLast
            count = len(self._pending) + page.left
            if count > max(MAX_PAGE, size_of_copy(self.building)) and not at_any_cost:
                return False
        self.building, self.version = with_changes_of(self.building, self._pending), self._next.since
        if any(isinstance(change.element, MapObject | Area) for change in self._pending):
            self.building = maps.with_facts(self.building, facts_of(self._editor, self._part))
        self._pending = []
        return True


class _CachedFloor(NamedTuple):
    """The floor that was requested last, with the map's version and content for it."""

    floor: str
    version: int
    building: Building


class RemoteFloorMap:
    """The map of one floor at a time; resolves the map editor at the first call and after each failure. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        # Timeouts [s]: to resolve a map editor that does not answer, which also limits the rate of attempts; of a call.
        self._editor = RemoteObject(orb, "MapEditor", RoboCorba.MapEditor, "the map editor", 0.2, 2.0)
        self._cached: _CachedFloor | None = None

    def of(self, floor: str) -> Building:
        """A building of this floor with all its obstacles, and of all elevators.

        Raises UnknownFloor, NotReachable."""
        cached = self._cached

        def current(editor: Any) -> _CachedFloor:
            version = editor._get_currentVersion()  # edits from here on are found by the next call
            if cached is None or cached.floor != floor or (cached.version != version and _has_changed(editor, cached)):
                return _load_floor(editor, floor)
            return _CachedFloor(floor, version, cached.building)

        self._cached = found = self._editor.call(current)
        return found.building

    def floors_since(self, version: int) -> dict[str, str]:
        """The present names of floors by those of an earlier version. Raises NotReachable."""

        def names(editor: Any) -> dict[str, str]:
            now = editor._get_currentVersion()
            return _lineage(editor, version, now).floors(editor.floors())

        return self._editor.call(names)


def _lineage(editor: Any, since: int, until: int) -> Lineage:
    """Which elements of version `until` are those of version `since`; by their names if the changes between are not
    kept any more."""
    if since >= until:
        return SAME_NAMES
    try:
        changes = [change for change in changes_after(editor, since, Selection(FOLLOWED)) if change.version <= until]
    except RoboCorba.VersionUnavailable:
        _log.warning("the changes of the map since version %d are not kept any more: elements go by names", since)
        return SAME_NAMES
    return Lineage(changes)


def path_node_positions(orb: Orb, floor: str) -> Iterator[tuple[str, float, float]]:
    """Floor, x and y [m] of the path nodes of a floor (of the first floor if `floor` is empty).

    Raises UnknownFloor, NotReachable."""
    return ((chosen, *node.at) for chosen, node in elements_of_floor(orb, ElementKind.NODE, floor))


def elements_of_floor(orb: Orb, kind: ElementKind, floor: str) -> Iterator[tuple[str, Any]]:
    """The elements of a kind, each with its floor, as `path_node_positions`."""
    editor = orb.resolve("MapEditor", RoboCorba.MapEditor, 5.0)
    with translated("the map editor"):
        floors = list(editor.floors())
        chosen = floor or floors[0]
        if chosen not in floors:
            raise UnknownFloor("floor", floor, floors)
        pages = list(element_pages(editor, Selection((kind,), chosen)))
    for page in pages:
        for record in page.elements:
            yield chosen, maps.element_of(record.value)


def map_at_editor(orb: Orb) -> Callable[[], tuple[str, int]]:
    """Returns name and present version of the map. Raises NotReachable."""
    editor = RemoteObject(orb, "MapEditor", RoboCorba.MapEditor, "the map editor", 2.0, 2.0)
    return lambda: editor.call(lambda asked: (str(asked._get_buildingName()), int(asked._get_currentVersion())))


def exported(orb: Orb, timeout_s: float) -> str:
    """The map as the text of a map file. timeout_s: to resolve the map editor. Raises NotReachable."""
    editor = orb.resolve("MapEditor", RoboCorba.MapEditor, timeout_s)
    with translated("the map editor"):
        return str(editor.exportMap())


def element_pages(editor: Any, part: Selection) -> Iterator[Any]:
    """The ElementPages of a part of the building."""
    start, is_last = 0, False
    while not is_last:
        page = editor.readElements(start, maps.selection(part), 0)
        yield page
        start, is_last = page.next, page.isLast


def facts_of(editor: Any, part: Selection) -> Any:
    """The ElementFacts of a part of the building; none of a map editor that does not know them."""
    try:
        return editor.readFacts(maps.selection(part))
    except CORBA.BAD_OPERATION:
        return ()


def changes_after(editor: Any, version: int, part: Selection = EVERYTHING) -> Iterator[MapChange]:
    """The changes of a part of the building after a version, in order. Raises RoboCorba.VersionUnavailable."""
    position, is_last = RoboCorba.ChangePosition(version, 0), False
    while not is_last:
        page = editor.readChanges(position, maps.selection(part), 0)
        yield from maps.changes_of(page.changes)
        position, is_last = page.next, page.isLast


def _load_floor(editor: Any, floor: str) -> _CachedFloor:
    """The floor at the current version. Raises UnknownFloor."""
    pages = list(element_pages(editor, Selection(_FLOOR_KINDS, floor)))
    records = chain.from_iterable(page.elements for page in pages)
    building = building_of("", ((record.onFloor, maps.element_of(record.value)) for record in records))
    if floor not in building.floors:
        raise UnknownFloor("floor", floor, list(building.floors))
    this_floor = Building("", {floor: building.floors[floor]}, building.elevators)
    return _CachedFloor(floor, pages[0].readAt, this_floor)


def _has_changed(editor: Any, cached: _CachedFloor) -> bool:
    """Whether an edit since the cached version may concern the floor; edits of other floors do not."""
    part = maps.selection(Selection(_FLOOR_KINDS, cached.floor))
    try:
        page = editor.readChanges(maps.position(ChangePosition(cached.version)), part, 1)
    except RoboCorba.VersionUnavailable:
        return True
    return bool(page.changes)

"""Clients of the map editor: copies of its building or of one floor, and positions of path nodes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import maps
from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import RemoteObject, translated
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.maps.model import COLLECTION_OF, KIND_OF, Building, ElementKind, FloorMap, GeometricalMap
from robocorba.stubs import RoboCorba

#: Default timeout to resolve the map editor [s]. An editor that compiles for the first time starts slowly; the
#: starter of this process waits no longer than this.
LOAD_TIMEOUT_S = 300.0
#: Timeout to resolve the map editor of a running system [s].
RESOLVE_TIMEOUT_S = 5.0
#: Timeouts of RemoteFloorMap [s]: to resolve a map editor that does not answer, which also limits the rate of attempts,
#: and of each call.
FLOOR_RESOLVE_TIMEOUT_S, FLOOR_CALL_TIMEOUT_S = 0.2, 2.0
#: Element kinds that RemoteMap omits by default: only the path planning agent uses the topological map.
_TOPOLOGICAL_KINDS = (ElementKind.NODE, ElementKind.EDGE)
#: Element kinds that are not on one floor.
_KINDS_OF_ALL_FLOORS = (ElementKind.FLOOR, ElementKind.ELEVATOR)
#: Kinds of obstacles on a floor, by the names of their collections in the geometrical map.
_OBSTACLE_KINDS = {"walls": ElementKind.WALL, "objects": ElementKind.OBJECT, "doors": ElementKind.DOOR}


class RemoteMap:
    """A copy of the geometrical maps and elevators of the building, loaded once and then updated by changes.

    with_topology: also of the topological maps. Raises NotReachable if there is no map editor within `timeout_s`, or if
    loading fails."""

    def __init__(self, orb: Orb, timeout_s: float = LOAD_TIMEOUT_S, with_topology: bool = False) -> None:
        self._omitted = () if with_topology else _TOPOLOGICAL_KINDS
        self._editor = orb.resolve("MapEditor", RoboCorba.MapEditor, timeout_s)
        self._load()

    def follow(self) -> bool:
        """Apply the editor's new changes; whether there were any. Raises NotReachable."""
        before = self.version
        try:
            if self._editor._get_currentVersion() != before:
                self._apply_changes()
        except RoboCorba.VersionUnavailable:
            self._load()
        except CORBA.SystemException as error:
            raise NotReachable(f"the map editor does not answer ({describe(error)})") from None
        return self.version != before

    def _load(self) -> None:
        try:
            self.version: int = self._editor._get_currentVersion()
            name = self._editor._get_buildingName()
            kinds = [kind for kind in COLLECTION_OF if kind not in self._omitted]
            floors = {
                floor: FloorMap.of(element, {kind: _elements(self._editor, kind, floor) for kind in kinds})
                for floor, element in _elements(self._editor, ElementKind.FLOOR).items()
            }
            self.building = Building(name, floors, _elements(self._editor, ElementKind.ELEVATOR))
            with contextlib.suppress(RoboCorba.VersionUnavailable):
                self._apply_changes()  # edits during loading
        except CORBA.Exception as error:
            raise NotReachable(f"the map can't be loaded from the map editor ({describe(error)})") from None

    def _apply_changes(self) -> None:
        building, version = self.building, self.version
        for change in self._editor.changesSince(version):
            version, element = change.changedTo, maps.element_of(change.value)
            kind = KIND_OF[type(element)]
            if kind in self._omitted:
                continue
            with contextlib.suppress(KeyError):  # on a floor that was removed later
                if change.kind == RoboCorba.REMOVED:
                    building = building.without(kind, change.onFloor, element.name)
                else:
                    building = building.with_element(change.onFloor, element)
        self.building, self.version = building, version


class _CachedFloor(NamedTuple):
    """The floor that was requested last, with the map's version and content for it."""

    floor: str
    version: int
    building: Building


class RemoteFloorMap:
    """The map of one floor at a time; resolves the map editor at the first call and after each failure. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        timeouts = FLOOR_RESOLVE_TIMEOUT_S, FLOOR_CALL_TIMEOUT_S
        self._editor = RemoteObject(orb, "MapEditor", RoboCorba.MapEditor, "the map editor", *timeouts)
        self._cached: _CachedFloor | None = None

    def of(self, floor: str) -> Building:
        """A building of this floor with all its obstacles, and of all elevators.

        Raises UnknownFloor, NotReachable."""
        cached = self._cached

        def current(editor: Any) -> _CachedFloor:
            version = editor._get_currentVersion()  # edits from here on are found by the next call
            if cached is None or cached.floor != floor or (cached.version != version and _has_changed(editor, cached)):
                return _CachedFloor(floor, version, _load_floor(editor, floor))
            return _CachedFloor(floor, version, cached.building)

        self._cached = found = self._editor.call(current)
        return found.building


def path_node_positions(orb: Orb, floor: str) -> Iterator[tuple[str, float, float]]:
    """Floor, x and y [m] of the path nodes of a floor (of the first floor if `floor` is empty).

    Raises UnknownFloor, NotReachable."""
    editor = orb.resolve("MapEditor", RoboCorba.MapEditor, RESOLVE_TIMEOUT_S)
    with translated("the map editor"):
        floors = _elements(editor, ElementKind.FLOOR)
        chosen = floor or next(iter(floors))
        if chosen not in floors:
            raise UnknownFloor("floor", floor, list(floors))
        nodes = _elements(editor, ElementKind.NODE, chosen)
    for node in nodes.values():
        yield chosen, *node.at


def _elements(editor: Any, kind: ElementKind, floor: str = "") -> dict[str, Any]:
    """Elements of a kind by name; floor: empty for floors and elevators."""
    records = editor.elements(getattr(RoboCorba, f"{kind.name}_ELEMENT"), floor)
    return {element.name: element for element in (maps.element_of(record.value) for record in records)}


def _load_floor(editor: Any, floor: str) -> Building:
    floors = _elements(editor, ElementKind.FLOOR)
    if floor not in floors:
        raise UnknownFloor("floor", floor, list(floors))
    obstacles = {collection: _elements(editor, kind, floor) for collection, kind in _OBSTACLE_KINDS.items()}
    elevators = _elements(editor, ElementKind.ELEVATOR)
    return Building("", {floor: FloorMap(floors[floor], GeometricalMap(**obstacles))}, elevators)


def _has_changed(editor: Any, cached: _CachedFloor) -> bool:
    """Whether an edit since the cached version may concern the floor; edits of other floors do not."""
    try:
        changes = editor.changesSince(cached.version)
    except RoboCorba.VersionUnavailable:
        return True
    kinds = [(KIND_OF[type(maps.element_of(change.value))], change.onFloor) for change in changes]
    obstacles = _OBSTACLE_KINDS.values()
    return any(kind in _KINDS_OF_ALL_FLOORS or (kind in obstacles and floor == cached.floor) for kind, floor in kinds)

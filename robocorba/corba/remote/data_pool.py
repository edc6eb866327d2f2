"""Follows the running system into a robot's own data pool; client of other robots' data pools."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, NamedTuple

from robocorba.corba.calls import set_call_timeout
from robocorba.corba.conversion import floors, maps, plans
from robocorba.corba.orb import Orb
from robocorba.corba.remote.floors import CALL_LIMIT_S, RemoteDatabase
from robocorba.corba.remote.remote_object import RemoteObject, translated
from robocorba.data_pool.plans import Plan
from robocorba.data_pool.pool import DataPool
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.maps.model import KIND_OF, Building, ElementKind, FloorMap, GeometricalMap
from robocorba.names import ROBOTS
from robocorba.repeating import Repeating
from robocorba.spatial.floor_update import FloorUpdate
from robocorba.stubs import RoboCorba

#: Interval between requests for the floor's changes [s].
FOLLOW_S = 0.033
#: Interval between requests for the map's version [s].
MAP_CHECK_S = 0.25
#: Timeout of each call for resolving a server that is away [s]. It also limits the call rate while the server is away.
RESOLVE_TIMEOUT_S = 0.2
#: Kinds of obstacles on a floor, by the names of their collections in the geometrical map.
_BLOCKING_KINDS = {"walls": ElementKind.WALL, "objects": ElementKind.OBJECT, "doors": ElementKind.DOOR}
_KINDS_OF_ALL_FLOORS = (ElementKind.FLOOR, ElementKind.ELEVATOR)


class PoolFollower:
    """Keeps `pool` up to date with the running system from `start` to `close`; servers may restart meanwhile.

    own_name: the robot's name in the simulation. Change floors with `pool.change_floor`."""

    def __init__(self, orb: Orb, floor: str, own_name: str = "", interval_s: float = FOLLOW_S) -> None:
        self.pool = DataPool(RemoteDatabase(orb, RESOLVE_TIMEOUT_S), RemoteFloorMap(orb).of, floor, own_name)
        self._tasks = [
            Repeating("data pool", self.pool.follow, interval_s),
            Repeating("data pool's map", self._follow_map, MAP_CHECK_S),
        ]

    def start(self) -> PoolFollower:
        for task in self._tasks:
            task.start()
        return self

    def close(self) -> None:
        for task in self._tasks:
            task.close()

    def _follow_map(self) -> None:
        with contextlib.suppress(NotReachable, UnknownFloor):  # a deleted floor has no map
            self.pool.follow_map()


class _CachedFloor(NamedTuple):
    """The floor that was requested last, with the map's version and content for it."""

    floor: str
    version: int
    building: Building


class RemoteFloorMap:
    """The map editor's map of one floor at a time. Resolves the map editor at the first call, and after each failure.
    Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        what = "the map editor"
        self._editor = RemoteObject(orb, "MapEditor", RoboCorba.MapEditor, what, RESOLVE_TIMEOUT_S, CALL_LIMIT_S)
        self._known: _CachedFloor | None = None

    def of(self, floor: str) -> Building:
        """A building of this floor with all its obstacles, and of all elevators.

        Raises UnknownFloor, NotReachable."""
        known = self._known

        def current(editor: Any) -> _CachedFloor:
            version = editor._get_currentVersion()  # the next call sees edits from here on
            if known is None or known.floor != floor or (known.version != version and _has_changed(editor, known)):
                return _CachedFloor(floor, version, _load(editor, floor))
            return _CachedFloor(floor, version, known.building)

        self._known = found = self._editor.call(current)
        return found.building


def _load(editor: Any, floor: str) -> Building:
    storeys = _elements(editor, ElementKind.FLOOR, "")
    if floor not in storeys:
        raise UnknownFloor("floor", floor, list(storeys))
    obstacles = {collection: _elements(editor, kind, floor) for collection, kind in _BLOCKING_KINDS.items()}
    elevators = _elements(editor, ElementKind.ELEVATOR, "")
    return Building("", {floor: FloorMap(storeys[floor], GeometricalMap(**obstacles))}, elevators)


def _elements(editor: Any, kind: ElementKind, floor: str) -> dict[str, Any]:
    records = editor.elements(getattr(RoboCorba, f"{kind.name}_ELEMENT"), floor)
    return {element.name: element for element in (maps.element_of(record.value) for record in records)}


def _has_changed(editor: Any, known: _CachedFloor) -> bool:
    """Whether an edit since the cached version may concern the floor; edits of other floors do not."""
    try:
        changes = editor.changesSince(known.version)
    except RoboCorba.VersionUnavailable:
        return True
    kinds = [(KIND_OF[type(maps.element_of(change.value))], change.onFloor) for change in changes]
    blocking = _BLOCKING_KINDS.values()
    return any(kind in _KINDS_OF_ALL_FLOORS or (kind in blocking and floor == known.floor) for kind, floor in kinds)


class RemotePool:
    """Client of another robot's data pool, a RoboCorba::DataPool. Raises NotReachable if the robot does not answer."""

    def __init__(self, reference: Any) -> None:
        self._pool = reference
        set_call_timeout(reference, CALL_LIMIT_S)

    @classmethod
    def of_robot(cls, orb: Orb, robot: str, timeout_s: float = 10.0) -> RemotePool:
        """The data pool of the robot of this name; waits up to `timeout_s` for the robot. Raises NotReachable."""
        agent = orb.resolve(f"{ROBOTS}/{robot}", RoboCorba.RobotAgent, timeout_s, CALL_LIMIT_S)
        reference = _answer(agent._get_pool)
        if reference is None:
            raise NotReachable(f"{robot} has no data pool")
        return cls(reference)

    @property
    def floor(self) -> str:
        """The floor that its robot is on."""
        return str(_answer(self._pool._get_floorName))

    @property
    def lag_s(self) -> float:
        """The greatest age of its content [s]."""
        return float(_answer(self._pool._get_lag))

    def content(self) -> FloorUpdate:
        """The whole floor."""
        return floors.update_of(_answer(self._pool.content))

    def plan(self, name: str) -> Plan:
        """Raises UnknownPlan."""
        return plans.plan_of(_answer(self._pool.plan, name))

    def plans(self) -> list[Plan]:
        """Plans of all missions that its robot leads, sorted by name."""
        return [plans.plan_of(record) for record in _answer(self._pool.plans)]


def _answer(call: Callable[..., Any], *arguments: Any) -> Any:
    with translated("the robot's data pool"):
        return call(*arguments)

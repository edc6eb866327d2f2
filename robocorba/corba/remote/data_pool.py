"""A robot's own data pool, which follows the running system, and the data pools of other robots."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.corba.calls import describe, limit_calls
from robocorba.corba.conversion import floors, maps, plans
from robocorba.corba.conversion.errors import domain_error
from robocorba.corba.orb import Orb
from robocorba.corba.remote.floors import CALL_LIMIT_S, RemoteDatabase
from robocorba.data_pool.plans import Plan
from robocorba.data_pool.pool import DataPool
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.maps.model import KIND_OF, Building, ElementKind, FloorMap, GeometricalMap
from robocorba.names import ROBOTS
from robocorba.repeating import Repeating
from robocorba.spatial.floor_update import FloorUpdate
from robocorba.stubs import RoboCorba

#: The floor is followed, and the map is asked for edits, so often, s.
FOLLOW_S, MAP_CHECK_S = 0.033, 0.25
#: A server that was away is looked for so long by each call, s; while it is away, calls are not more often than that.
FIND_S = 0.2
#: What can stand in the way on a floor, by the name of its collection in the geometrical map.
_PLAN = {"walls": ElementKind.WALL, "objects": ElementKind.OBJECT, "doors": ElementKind.DOOR}
_OF_ALL_FLOORS = (ElementKind.FLOOR, ElementKind.ELEVATOR)


class PoolFollower:
    """Keeps `pool` up to date from the running system, from `start` to `close`; servers may come and go meanwhile.

    oneself: the robot's name in the simulation. Let the pool go to another floor by its own `go_to`."""

    def __init__(self, orb: Orb, floor: str, oneself: str = "", every_s: float = FOLLOW_S) -> None:
        self.pool = DataPool(RemoteDatabase(orb, FIND_S), RemoteFloorMap(orb).of, floor, oneself)
        self._tasks = [
            Repeating("data pool", self.pool.follow, every_s),
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
        with contextlib.suppress(NotReachable, UnknownFloor):  # a floor that is gone has nothing to follow
            self.pool.follow_map()


class _Known(NamedTuple):
    """The floor that was asked for last, the version of the map, and what it says of the floor."""

    floor: str
    version: int
    building: Building


class RemoteFloorMap:
    """The map of one floor at a time, as the map editor has it. That is found when it is first needed, and again where
    it was away. Any thread may ask."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._found: Any = None
        self._known: _Known | None = None

    def of(self, floor: str) -> Building:
        """A building of this floor with all that can stand in the way there, and of all elevators.

        Raises UnknownFloor, NotReachable."""
        known = self._known
        try:
            editor = self._find()
            version = editor._get_currentVersion()  # what is edited from now on is there the next time
            if known is None or known.floor != floor or (known.version != version and _has_changed(editor, known)):
                building = _load(editor, floor)
            else:
                building = known.building
        except CORBA.SystemException as wrong:
            self._found = None
            raise NotReachable(f"the map editor does not answer ({describe(wrong)})") from None
        self._known = _Known(floor, version, building)
        return building

    def _find(self) -> Any:
        found = self._found
        if found is None:
            found = self._found = self._orb.resolve("MapEditor", RoboCorba.MapEditor, FIND_S, CALL_LIMIT_S)
        return found


def _load(editor: Any, floor: str) -> Building:
    storeys = _elements(editor, ElementKind.FLOOR, "")
    if floor not in storeys:
        raise UnknownFloor("floor", floor, list(storeys))
    plan = GeometricalMap(**{collection: _elements(editor, kind, floor) for collection, kind in _PLAN.items()})
    elevators = _elements(editor, ElementKind.ELEVATOR, "")
    return Building("", {floor: FloorMap(storeys[floor], plan)}, elevators)


def _elements(editor: Any, kind: ElementKind, floor: str) -> dict[str, Any]:
    records = editor.elements(getattr(RoboCorba, f"{kind.name}_ELEMENT"), floor)
    return {element.name: element for element in (maps.element_of(record.value) for record in records)}


def _has_changed(editor: Any, known: _Known) -> bool:
    """Whether an edit since then may concern the floor; those of other floors are left where they are."""
    try:
        changes = editor.changesSince(known.version)
    except RoboCorba.VersionUnavailable:
        return True
    kinds = [(KIND_OF[type(maps.element_of(change.value))], change.onFloor) for change in changes]
    return any(kind in _OF_ALL_FLOORS or (kind in _PLAN.values() and floor == known.floor) for kind, floor in kinds)


class RemotePool:
    """The data pool of another robot, a RoboCorba::DataPool. Raises NotReachable where its robot does not answer."""

    def __init__(self, reference: Any) -> None:
        self._pool = reference
        limit_calls(reference, CALL_LIMIT_S)

    @classmethod
    def of_robot(cls, orb: Orb, robot: str, timeout_s: float = 10.0) -> RemotePool:
        """That of a robot by its name, which is waited for so long. Raises NotReachable."""
        agent = orb.resolve(f"{ROBOTS}/{robot}", RoboCorba.RobotAgent, timeout_s, CALL_LIMIT_S)
        reference = _answer(agent._get_pool)
        if reference is None:
            raise NotReachable(f"{robot} has no data pool")
        return cls(reference)

    @property
    def floor(self) -> str:
        """Where its robot is."""
        return str(_answer(self._pool._get_floorName))

    @property
    def lag_s(self) -> float:
        """How old is what it knows."""
        return float(_answer(self._pool._get_lag))

    def content(self) -> FloorUpdate:
        """The whole floor."""
        return floors.update_of(_answer(self._pool.content))

    def plan(self, name: str) -> Plan:
        """Raises UnknownPlan."""
        return plans.plan_of(_answer(self._pool.plan, name))

    def plans(self) -> list[Plan]:
        """All that its robot leads, by name."""
        return [plans.plan_of(record) for record in _answer(self._pool.plans)]


def _answer(call: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return call(*arguments)
    except CORBA.UserException as wrong:
        raise (domain_error(wrong) or wrong) from None
    except CORBA.SystemException as wrong:
        raise NotReachable(f"the robot's data pool does not answer ({describe(wrong)})") from None

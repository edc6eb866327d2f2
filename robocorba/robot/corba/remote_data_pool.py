"""Follows the running system into a robot's own data pool; client of other robots' data pools."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable
from typing import Any

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import RobotLost
from robocorba.errors.services import NotReachable
from robocorba.map_editor.corba.remote_map import RemoteFloorMap
from robocorba.map_editor.spatial.floor_update import BodyKind, FloorUpdate
from robocorba.map_editor.spatial.posture import Posture
from robocorba.orb.calls import set_call_timeout
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.robot.corba import plans
from robocorba.robot.data_pool.plans import Plan
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.postures import PoolPostures
from robocorba.robot.data_pool.snapshot import FloorSnapshot
from robocorba.simulation.corba import floors, sessions
from robocorba.simulation.corba.remote_database import CALL_TIMEOUT_S, RemoteDatabase
from robocorba.stubs import RoboCorba
from robocorba.system.names import ROBOTS
from robocorba.system.repeating import Repeating

#: Interval between requests for the floor's changes [s].
FOLLOW_INTERVAL_S = 0.033
#: Interval between requests for the map's version [s].
MAP_CHECK_INTERVAL_S = 0.25
#: Both intervals while nobody needs the pool [s].
REST_INTERVAL_S, MAP_REST_INTERVAL_S = 1.0, 2.0
#: Time for which the pool is followed closely after somebody has read it [s].
ATTENTION_S = 2.0
#: Timeout of `attend` [s].
ATTEND_LIMIT_S = 0.3
#: Timeout to resolve the servers before a robot logs on [s].
START_TIMEOUT_S = 5.0
#: Timeout to resolve a server that does not answer [s]; it also limits the rate of attempts.
RESOLVE_TIMEOUT_S = 0.2


class PoolFollower:
    """Keeps a robot's own `pool` up to date with the running system from `start` to `close`; servers may restart.

    own_name: the robot's name in the simulation. floor_of_robot: returns the floor that the robot is on; without it,
    change floors with `pool.change_floor`. rests: whether nobody needs the pool but readers who call `attend`."""

    def __init__(
        self,
        orb: Orb,
        floor: str,
        own_name: str = "",
        interval_s: float = FOLLOW_INTERVAL_S,
        floor_of_robot: Callable[[], str] | None = None,
        rests: Callable[[], bool] = lambda: False,
    ) -> None:
        self._interval_s, self._floor_of_robot, self._rests = interval_s, floor_of_robot, rests
        self._own_name = own_name
        self._attended_at = -math.inf
        #: Updates of the pool that have begun, and the last one that has ended; guarded by the condition.
        self._updated = threading.Condition()
        self._begun = self._ended = 0
        database, self._map = RemoteDatabase(orb, RESOLVE_TIMEOUT_S), RemoteFloorMap(orb)
        self.pool = DataPool(database, self._map.of, floor, own_name)
        #: The floor on which the robot was seen last, and the version of the map then.
        self._seen = (floor, 0)
        #: Postures on the pool's floor.
        self.postures = PoolPostures(database.postures, lambda: self.pool.floor)
        self._tasks = [
            Repeating("data pool", self._follow, lambda: REST_INTERVAL_S if self._is_resting else interval_s),
            Repeating(
                *("data pool's map", self._follow_map),
                lambda: MAP_REST_INTERVAL_S if self._is_resting else MAP_CHECK_INTERVAL_S,
            ),
        ]

    def start(self) -> PoolFollower:
        for task in self._tasks:
            task.start()
        return self

    def close(self) -> None:
        for task in self._tasks:
            task.close()

    def attend(self) -> None:
        """Follow closely for ATTENTION_S. If the pool rests, wait until it is up to date, at most ATTEND_LIMIT_S."""
        is_resting, self._attended_at = self._is_resting, time.monotonic()
        if is_resting:
            with self._updated:
                awaited = self._begun + 1  # one that is under way may have read already
            for task in self._tasks:
                task.wake()
            with self._updated:
                self._updated.wait_for(lambda: self._ended >= awaited, ATTEND_LIMIT_S)

    def floors_since(self, floor: str) -> dict[str, str]:
        """The present names of floors by those of the time at which the robot was seen last, if that was on this floor;
        else none. Raises NotReachable."""
        seen_on, version = self._seen
        return self._map.floors_since(version) if version and seen_on == floor else {}

    @property
    def _is_resting(self) -> bool:
        return time.monotonic() - self._attended_at > ATTENTION_S and self._rests()

    def _follow(self) -> None:
        with self._updated:
            self._begun += 1
        with contextlib.suppress(UnknownFloor, RobotLost):  # the floor may have just been deleted
            if self._floor_of_robot and (floor := self._floor_of_robot()) != self.pool.floor:
                self.pool.change_floor(floor)
        self.pool.follow()
        snapshot = self.pool.snapshot()
        if (BodyKind.ROBOT, self._own_name) in snapshot.bodies.row_of:
            self._seen = snapshot.floor, snapshot.map_version
        with self._updated:
            self._ended = self._begun
            self._updated.notify_all()

    def _follow_map(self) -> None:
        with contextlib.suppress(NotReachable, UnknownFloor):  # a deleted floor has no map
            self.pool.follow_map()


def floor_now(orb: Orb, floor: str) -> FloorSnapshot:
    """The present state of a floor. Raises UnknownFloor, NotReachable."""
    source, map_source = RemoteDatabase(orb, START_TIMEOUT_S), RemoteFloorMap(orb).of
    pool = DataPool(source, map_source, floor)
    pool.follow()
    return pool.loaded_snapshot()


class RemotePool:
    """Client of another robot's data pool, a RoboCorba::DataPool. Raises NotReachable if the robot does not answer.

    what: its name in messages."""

    def __init__(self, reference: Any, what: str = "the robot's data pool") -> None:
        self._pool, self._what = reference, what
        set_call_timeout(reference, CALL_TIMEOUT_S)

    @staticmethod
    def of_robot(orb: Orb, robot: str, timeout_s: float = 10.0) -> RemotePool:
        """The data pool of the robot of this name; waits up to `timeout_s` for the robot. Raises NotReachable."""
        agent = orb.resolve(f"{ROBOTS}/{robot}", RoboCorba.RobotAgent, timeout_s, CALL_TIMEOUT_S)
        return RemotePool(pool_of(agent, robot))

    @property
    def floor(self) -> str:
        """The floor that its robot is on."""
        return str(self._answer(self._pool._get_floorName))

    @property
    def lag_s(self) -> float:
        """The greatest age of its content [s]."""
        return float(self._answer(self._pool._get_lag))

    def content(self) -> FloorUpdate:
        """The whole floor."""
        return floors.update_of(self._answer(self._pool.content))

    def changes(self, since: int) -> FloorUpdate:
        """What changed since a version; the whole floor if the robot does not remember that version, which may be
        another floor's: versions of different floors don't compare."""
        return floors.update_of(self._answer(self._pool.changes, since))

    def postures(self, time_s: float) -> list[Posture]:
        """Postures on the floor that were reported after a simulated time [s]."""
        return [sessions.posture_of(posture) for posture in self._answer(self._pool.postures, time_s)]

    def plan(self, name: str) -> Plan:
        """Raises UnknownPlan."""
        return plans.plan_of(self._answer(self._pool.plan, name))

    def plans(self) -> list[Plan]:
        """Plans of all missions that its robot leads, sorted by name."""
        return [plans.plan_of(record) for record in self._answer(self._pool.plans)]

    def _answer(self, call: Callable[..., Any], *arguments: Any) -> Any:
        with translated(self._what):
            return call(*arguments)


def pool_of(agent: Any, robot: str) -> Any:
    """The reference of the data pool of a robot, whose RobotAgent this is. Raises NotReachable."""
    with translated(f"robot {robot}"):
        pool = agent._get_pool()
    if pool is None:
        raise NotReachable(f"{robot} has no data pool")
    return pool

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
from robocorba.robot.corba import robot_states
from robocorba.robot.data_pool.plans import Plan
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.postures import PoolPostures
from robocorba.robot.data_pool.snapshot import FloorSnapshot
from robocorba.simulation.corba import floors, sessions
from robocorba.simulation.corba.remote_database import CALL_TIMEOUT_S, RemoteDatabase
from robocorba.stubs import RoboCorba
from robocorba.system.names import ROBOTS
from robocorba.system.repeating import Repeating

#: Interval between requests for the floor's changes while nobody needs the pool [s].
REST_INTERVAL_S = 1.0
#: Time for which the pool is followed closely after somebody has read it [s].
ATTENTION_S = 2.0
#: Timeout of `attend` [s].
ATTEND_LIMIT_S = 0.3


class PoolFollower:
    """Keeps a robot's own `pool` up to date with the running system from `start` to `close`; servers may restart.

    own_name: the robot's name in the simulation. floor_of_robot: returns the floor that the robot is on; without it,
    change floors with `pool.change_floor`. rests: whether nobody needs the pool but readers who call `attend`."""

    def __init__(
        self,
        orb: Orb,
        floor: str,
        own_name: str = "",
        floor_of_robot: Callable[[], str] | None = None,
        rests: Callable[[], bool] = lambda: False,
    ) -> None:
        self._floor_of_robot, self._rests = floor_of_robot, rests
        self._own_name = own_name
        self._attended_at = -math.inf
        #: Updates of the pool that have begun, and the last one that has ended; guarded by the condition.
        self._updated = threading.Condition()
        self._begun = self._ended = 0
        # The timeout to resolve a server that does not answer [s] also limits the rate of attempts.
        database, self._map = RemoteDatabase(orb, 0.2), RemoteFloorMap(orb)
        self.pool = DataPool(database.changes, self._map.of, floor, own_name)
        #: The floor on which the robot was seen last, and the version of the map then.
        self._seen = (floor, 0)
        #: Postures on the pool's floor.
        self.postures = PoolPostures(database.postures, lambda: self.pool.floor)
        self._tasks = [
            Repeating("data pool", self._follow, lambda: REST_INTERVAL_S if self._is_resting else 0.033),
            Repeating("data pool's map", self._follow_map, lambda: 2.0 if self._is_resting else 0.25),
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
    pool = DataPool(RemoteDatabase(orb, 5.0).changes, RemoteFloorMap(orb).of, floor)
    pool.follow()
    return pool.loaded_snapshot()


class RemotePool:
    """Client of another robot, for its path and its data pool, a RoboCorba::DataPool. The constructor waits up to
    `timeout_s` for the robot. Raises NotReachable if the robot does not answer."""

    def __init__(self, orb: Orb, robot: str, timeout_s: float = 10.0) -> None:
        self._agent = orb.resolve(f"{ROBOTS}/{robot}", RoboCorba.RobotAgent, timeout_s, CALL_TIMEOUT_S)
        self._robot = robot
        self._pool = self._answer(self._agent._get_pool)
        if self._pool is None:
            raise NotReachable(f"{robot} has no data pool")
        set_call_timeout(self._pool, CALL_TIMEOUT_S)

    def path(self) -> list[dict[str, Any]]:
        """The path that the base drives, from its start: floor, x, y [m], heading [rad] of each point."""
        return [
            {"floor": point.position.floor, "x": point.position.x, "y": point.position.y, "heading": point.heading}
            for point in self._answer(self._agent._get_path)
        ]

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
        return robot_states.plan_of(self._answer(self._pool.plan, name))

    def plans(self) -> list[Plan]:
        """Plans of all missions that its robot leads, sorted by name."""
        return [robot_states.plan_of(record) for record in self._answer(self._pool.plans)]

    def _answer(self, call: Callable[..., Any], *arguments: Any) -> Any:
        with translated(f"robot {self._robot}"):
            return call(*arguments)

"""Servant of a robot's data pool."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.orb.exceptions import translating
from robocorba.robot.corba import robot_states
from robocorba.robot.data_pool.plans import Plans
from robocorba.robot.data_pool.pool import DataPool
from robocorba.robot.data_pool.postures import PoolPostures
from robocorba.simulation.corba import floors, sessions
from robocorba.stubs import RoboCorba__POA


class DataPoolServant(RoboCorba__POA.DataPool):
    """RoboCorba::DataPool, read-only. attend: brings the pool up to date before each reading."""

    def __init__(
        self, pool: DataPool, plans: Plans, postures: PoolPostures, attend: Callable[[], None] = lambda: None
    ) -> None:
        self._pool, self._plans, self._postures, self._attend = pool, plans, postures, attend

    def _get_floorName(self) -> str:
        self._attend()
        return self._pool.floor

    def _get_lag(self) -> float:
        self._attend()
        return self._pool.lag_s

    def content(self) -> Any:
        self._attend()
        return floors.update(self._pool.snapshot().as_update())

    def changes(self, since: int) -> Any:
        self._attend()
        return floors.update(self._pool.snapshot().changes(since))

    def postures(self, since: float) -> list[Any]:
        self._attend()
        return [sessions.posture(posture) for posture in self._postures.since(since)]

    @translating
    def plan(self, name: str) -> Any:
        return robot_states.plan_record(self._plans.get(name))

    def plans(self) -> list[Any]:
        return [robot_states.plan_record(plan) for plan in self._plans.all()]

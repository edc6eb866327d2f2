"""Servant of a robot's data pool."""

from __future__ import annotations

from typing import Any

from robocorba.corba.conversion import floors, simulation
from robocorba.corba.conversion import plans as conversion
from robocorba.corba.conversion.errors import translating
from robocorba.data_pool.plans import Plans
from robocorba.data_pool.pool import DataPool
from robocorba.data_pool.postures import PoolPostures
from robocorba.stubs import RoboCorba__POA


class DataPoolServant(RoboCorba__POA.DataPool):
    """RoboCorba::DataPool, read-only."""

    def __init__(self, pool: DataPool, plans: Plans, postures: PoolPostures) -> None:
        self._pool, self._plans, self._postures = pool, plans, postures

    def _get_floorName(self) -> str:
        return self._pool.floor

    def _get_lag(self) -> float:
        return self._pool.lag_s

    def content(self) -> Any:
        return floors.update(self._pool.snapshot().as_update())

    def changes(self, since: int) -> Any:
        return floors.update(self._pool.snapshot().changes(since))

    def postures(self, since: float) -> list[Any]:
        return [simulation.posture(posture) for posture in self._postures.since(since)]

    @translating
    def plan(self, name: str) -> Any:
        return conversion.record(self._plans.get(name))

    def plans(self) -> list[Any]:
        return [conversion.record(plan) for plan in self._plans.all()]

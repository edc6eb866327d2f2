"""Calls of the simulation server's objects wait for others of their own kind only."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import pytest

from robocorba.corba.servants.mission_control import MissionControlServant
from robocorba.corba.servants.omni_database import OmniDatabaseServant
from robocorba.corba.servants.simulation_server import SimulationServerServant
from robocorba.errors.paths import UnknownFloor
from robocorba.servers.simulation import FOLLOWING, limit_calls
from robocorba.stubs import RoboCorba


class Database:
    """Its floors are known, and what changed on them at the end of the `with`."""

    def __init__(self) -> None:
        self.called, self.go_on = threading.Semaphore(0), threading.Event()
        self.floors = ["L1"]

    def __enter__(self) -> Database:
        return self

    def __exit__(self, *raised: object) -> None:
        self.go_on.set()

    def changes(self, name: str, since: int) -> None:
        self.called.release()
        assert self.go_on.wait(60.0)
        raise UnknownFloor("name", name, self.floors)


def test_readers_do_not_wait_for_robots_that_follow_a_floor() -> None:
    database, nobody = Database(), cast(Any, None)
    servant = OmniDatabaseServant(cast(Any, database), nobody, nobody)
    server = SimulationServerServant(nobody, nobody, nobody, nobody, nobody)
    limit_calls(server, servant, MissionControlServant(nobody))
    with ThreadPoolExecutor(FOLLOWING + 1) as robots, database:
        calls = ("floorChanges", "typedFloorChanges")
        following = [robots.submit(getattr(servant, calls[i % 2]), "L9", 0) for i in range(FOLLOWING)]
        for _ in range(FOLLOWING):
            assert database.called.acquire(timeout=60.0)
        assert robots.submit(servant.floors).result(60.0) == ["L1"]
    for call in following:
        with pytest.raises(RoboCorba.UnknownFloor):
            call.result(60.0)

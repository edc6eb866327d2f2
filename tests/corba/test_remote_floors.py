"""Copies of floors, also while the database does not answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.corba.conversion import floors as conversion
from robocorba.corba.remote.omni_database import RemoteFloor, RemoteFloors
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate
from robocorba.stubs import RoboCorba


class Database:
    """A database whose robots move with each call."""

    def __init__(self) -> None:
        self.names = ["L1", "L2"]
        self.version = 0
        self.error: Exception | None = None

    def floors(self) -> list[str]:
        return self._answer(lambda: self.names)

    def getFloor(self, floor: str) -> Any:
        return self.floorChanges(floor, WHOLE)

    def floorChanges(self, floor: str, since: int) -> Any:
        return self._answer(lambda: conversion.update(self._update(floor, since)))

    def _update(self, floor: str, since: int) -> FloorUpdate:
        if floor not in self.names:
            raise RoboCorba.UnknownFloor("floorName", floor, self.names)
        self.version += 1
        came = [Body(1, BodyKind.ROBOT, "A", 0.4, (), 127.0)] if since == WHOLE else []
        rows = np.array([(1, 0.0, 0.0, 0.0, float(self.version), 0.0, 0.0)], MOTION)
        return FloorUpdate(floor, since, self.version, 0.1, 1, came, [], rows, {})

    def _answer(self, make: Callable[[], Any]) -> Any:
        if self.error:
            raise self.error
        return make()


class Naming:
    """An ORB that resolves the database if there is one."""

    def __init__(self, database: Database) -> None:
        self.database: Database | None = database
        self.resolved: list[tuple[str, float]] = []

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> Database:
        assert interface is RoboCorba.OmniDatabase
        self.resolved.append((name, timeout_s))
        if self.database is None:
            raise NotReachable("not bound")
        return self.database


def gone() -> CORBA.SystemException:
    return CORBA.COMM_FAILURE(0, CORBA.COMPLETED_MAYBE)


def test_a_floor_is_loaded_and_then_followed() -> None:
    floor = RemoteFloor(Database(), "L1")
    assert floor.follow().since == WHOLE
    second = floor.follow()
    assert (second.since, second.version) == (1, 2)
    assert floor.view.version == 2
    assert floor.view.motion(1)["x"] == 2.0


def test_errors_of_the_database_are_domain_errors() -> None:
    database = Database()
    with pytest.raises(UnknownFloor, match="L9"):
        RemoteFloor(database, "L9").follow()
    floor = RemoteFloor(database, "L1")
    floor.follow()
    database.error = gone()
    with pytest.raises(NotReachable, match="Omni database"):
        floor.follow()
    assert floor.view.version == 1


def test_all_floors_are_followed_unless_some_are_chosen() -> None:
    database = Database()
    everything = RemoteFloors(Naming(database))  # type: ignore[arg-type]
    assert [update.floor for update in everything.follow(1.0)] == ["L1", "L2"]
    database.names = ["L2", "L3"]
    assert [(update.floor, update.since > 0) for update in everything.follow(1.0)] == [("L2", True), ("L3", False)]
    assert list(everything.views) == ["L2", "L3"]
    chosen = RemoteFloors(Naming(database), ["L3"])  # type: ignore[arg-type]
    assert [update.floor for update in chosen.follow(1.0)] == ["L3"]
    with pytest.raises(UnknownFloor, match="L1"):
        RemoteFloors(Naming(database), ["L3", "L1"]).follow(1.0)  # type: ignore[arg-type]


def test_a_floor_that_is_renamed_after_its_name_was_read_is_left_out() -> None:
    database = Database()
    floors = RemoteFloors(Naming(database))  # type: ignore[arg-type]
    floors.follow(1.0)
    database.names, read = ["ground", "L2"], database.floors
    database.floors = lambda: ["L1", "L2"]  # type: ignore[method-assign]
    assert [update.floor for update in floors.follow(1.0)] == ["L2"]
    database.floors = read  # type: ignore[method-assign]
    assert [(update.floor, update.since > 0) for update in floors.follow(1.0)] == [("ground", False), ("L2", True)]


def test_after_a_failure_whole_floors_are_loaded() -> None:
    database = Database()
    naming = Naming(database)
    floors = RemoteFloors(naming, ["L1"])  # type: ignore[arg-type]
    floors.follow(3.0)
    floors.follow(3.0)
    assert naming.resolved == [("OmniDatabase", 3.0)]
    database.error = gone()
    with pytest.raises(NotReachable):
        floors.follow(0.5)
    assert floors.views == {}
    naming.database = None
    with pytest.raises(NotReachable, match="not bound"):
        floors.follow(0.5)
    naming.database, database.error = database, None
    (update,) = floors.follow(0.5)
    assert update.since == WHOLE
    assert len(naming.resolved) == 3

"""What is new in the running system: nothing twice, and nothing lost when the Omni database does not answer."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from robocorba.corba.remote import live_system
from robocorba.corba.remote.live_system import LiveSystem
from robocorba.errors.services import NotReachable
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate, FloorView
from robocorba.spatial.posture import Posture


class System:
    """Floors, Omni database and mission control in one. time_s: simulated."""

    def __init__(self) -> None:
        self.views: dict[str, FloorView] = {}
        self.floor = "L1"
        self.time_s, self.version = 10.0, 0
        self.reported: list[Posture] = []
        self.is_away = False
        self.timeouts_s: list[float] = []

    def follow(self, resolve_timeout_s: float) -> list[FloorUpdate]:
        self.timeouts_s.append(resolve_timeout_s)
        view = self.views.setdefault(self.floor, FloorView(self.floor))
        self.version += 1
        update = FloorUpdate(
            self.floor, view.version or WHOLE, self.version, self.time_s, 1, [], [], np.empty(0, MOTION), {}
        )
        view.apply(update)
        return [update]

    def postures(self, floor: str, time_s: float) -> list[Posture]:
        if self.is_away:
            raise NotReachable("away")
        return [posture for posture in self.reported if posture.time > time_s]

    def scans_since(self, floor: str, time_s: float) -> list[Any]:
        return []

    def missions_since(self, version: int) -> list[Any]:
        return []


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> tuple[System, LiveSystem]:
    monkeypatch.setattr(live_system, "SENSORS_S", 0.0)
    found: Any = System()
    return found, LiveSystem(found, found, found)


def test_a_floor_that_is_gone_becomes_empty_once(system: tuple[System, LiveSystem]) -> None:
    """Else viewers and recordings keep its robots beside those of the floor that has its robots now."""
    world, live = system
    first = live.follow(0.0)
    world.floor, world.time_s, world.is_away = "ground", 10.5, True
    with pytest.raises(NotReachable):
        live.follow(0.0)
    world.is_away = False
    second = live.follow(0.0)
    assert [update.floor for update in first.updates] == ["L1"]
    here, gone = second.updates
    assert (here.floor, gone.floor, gone.since, gone.time) == ("ground", "L1", WHOLE, 10.5)
    assert (gone.came, len(gone.motions), gone.elevators) == ([], 0, {})
    assert [update.floor for update in live.follow(0.0).updates] == ["ground"]


def test_each_posture_comes_once(system: tuple[System, LiveSystem]) -> None:
    world, live = system
    world.reported = [Posture("A", 9.9, ()), Posture("B", 9.95, ())]
    assert [posture.robot for posture in live.follow(0.0).postures] == ["A", "B"]
    assert live.follow(0.0).postures == []
    world.time_s = 10.1
    world.reported = [Posture("A", 10.05, ()), Posture("B", 9.95, ()), Posture("C", 9.93, ())]  # C's is late
    assert [posture.robot for posture in live.follow(0.0).postures] == ["A", "C"]
    world.time_s = 5.0  # a server that was restored from an earlier moment
    world.reported = [Posture("A", 4.9, ())]
    assert [posture.robot for posture in live.follow(0.0).postures] == ["A"]


def test_floors_come_whole_after_updates_that_nobody_has_seen(system: tuple[System, LiveSystem]) -> None:
    world, live = system
    assert live.follow(0.0).updates[0].since == WHOLE
    assert live.follow(0.0).updates[0].since == 1
    world.is_away = True
    with pytest.raises(NotReachable):
        live.follow(0.0)
    world.is_away = False
    assert live.follow(0.0).updates[0].since == WHOLE


def test_a_server_that_restarts_is_waited_for_at_the_beginning(system: tuple[System, LiveSystem]) -> None:
    world, live = system
    world.is_away = True
    with pytest.raises(NotReachable):
        live.begin(0.3)
    # No attempt may go on for longer than the rest of the limit.
    assert world.timeouts_s[0] <= 0.3
    assert world.timeouts_s == sorted(world.timeouts_s, reverse=True)
    assert len(set(world.timeouts_s)) == len(world.timeouts_s)
    threading.Timer(0.3, lambda: setattr(world, "is_away", False)).start()
    assert live.begin(60.0).updates[0].since == WHOLE

"""Robots that have logged off stay known, and the span to look back follows the history."""

from __future__ import annotations

from typing import Any

import numpy as np

from robocorba.console import monitor_state
from robocorba.console.history import History
from robocorba.console.monitor_state import MonitorState
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate, FloorView


class FakeState:
    """Reports what a test sets."""

    def __init__(self) -> None:
        self.clients: list[str] = []
        self.problem = ""
        self.forgotten: list[str] = []

    def start(self) -> None: ...
    def close(self) -> None: ...

    def forget(self, robot: str) -> None:
        self.forgotten.append(robot)

    def rows(self) -> dict[str, Any]:
        clients = [{"name": name, "at": {"floor": "L1", "x": 1.0, "y": 2.0, "heading": 0.0}} for name in self.clients]
        state = {"state": {"collisions": 0, "paused": False}, "clients": clients, "sensors": []}
        server = {"state": state, "age": 0.0, "problem": self.problem}
        return {"naming": "", "server": server, "robots": {}, "channels": {}}


def test_a_robot_that_logged_off_is_gone_but_known_until_it_is_forgotten() -> None:
    fake = FakeState()
    state = MonitorState(fake, History())
    fake.clients = ["R1", "R2"]
    state.update()
    assert state.rows()["gone"] == {}
    fake.clients = ["R2"]
    state.update()
    gone = state.rows()["gone"]
    assert list(gone) == ["R1"]
    assert gone["R1"]["client"]["at"]["x"] == 1.0
    assert gone["R1"]["age"] >= 0.0
    state.forget("R1")
    assert state.rows()["gone"] == {}
    assert fake.forgotten == ["R1"]


def test_a_robot_that_returns_is_not_gone() -> None:
    fake = FakeState()
    state = MonitorState(fake, History())
    for clients in (["R1"], [], ["R1"]):
        fake.clients = clients
        state.update()
    assert state.rows()["gone"] == {}


def test_the_number_of_known_robots_is_bounded(monkeypatch: Any) -> None:
    monkeypatch.setattr(monitor_state, "MAX_GONE", 3)
    fake = FakeState()
    state = MonitorState(fake, History())
    for number in range(9):
        fake.clients = [f"R{number}"]
        state.update()
    fake.clients = []
    assert list(state.rows()["gone"]) == ["R6", "R7", "R8"]


def test_the_span_to_look_back_begins_with_the_history() -> None:
    history = History()
    state = MonitorState(FakeState(), history)
    began, now = state.rows()["past"]
    assert began == now
    view = FloorView("L1")
    view.apply(FloorUpdate("L1", WHOLE, 1, 0.0, 1, [], [], np.empty(0, MOTION), {}))
    history.add(view, now - 10.0)
    assert state.rows()["past"][0] == now - 10.0


def test_happenings_are_numbered_in_the_rows() -> None:
    fake = FakeState()
    state = MonitorState(fake, History())
    state.update()
    fake.clients = ["R1"]
    state.update()
    assert state.rows()["happenings"] == 1
    assert state.happenings.after(0)[0].text == "R1 has logged on"

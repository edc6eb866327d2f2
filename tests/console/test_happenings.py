"""What has happened: differences between reports in words, contacts of robots, and robots that have left."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from robocorba.console import monitor_state
from robocorba.console.contacts import Contact, contacts_since
from robocorba.console.happenings import KEPT_S, MAX_CONTACTS, MAX_TEXT, Happenings
from robocorba.console.history import History
from robocorba.console.monitor_state import MonitorState
from robocorba.maps.model import Building
from robocorba.spatial.floor_update import MOTION, WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.testing.buildings import two_floors

LINK = {"peer": "b", "direction": "INCOMING", "condition": "UP"}
PROGRAM = {"name": "", "result": "NO_RESULT", "reason": ""}


AGENT = {"condition": "IDLE", "reason": "", "at": {"floor": "L1"}, "mission": "", "program": PROGRAM}
SIMULATION = {"collisions": 0, "paused": False}
#: Reports of a system.
ROWS: dict[str, Any] = {
    "naming": "",
    "server": {
        "state": {"state": SIMULATION, "clients": [{"name": "R1", "at": {"floor": "L1"}}], "sensors": []},
        **{"age": 0.1, "problem": ""},
    },
    "robots": {"R1": {"state": AGENT, "age": 0.1, "problem": "", "bound": True}},
    "channels": {"a": {"state": {"links": [LINK]}, "age": 0.1, "problem": ""}},
}


def noticed(*steps: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Kind, robot and text of what a sequence of reports shows."""
    happenings = Happenings()
    for at_s, step in enumerate(steps):
        happenings.note(step, float(at_s))
    return [(each.kind, each.robot, each.text) for each in happenings.after(0)]


def changed(before: dict[str, Any], *path: str, to: Any) -> dict[str, Any]:
    """A copy of reports with one value changed."""
    after = copy.deepcopy(before)
    entry = after
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = to
    return after


def of_robot(before: dict[str, Any], **state: Any) -> dict[str, Any]:
    """The same with another state of R1."""
    return changed(before, "robots", "R1", "state", to={**AGENT, **state})


def of_server(**members: Any) -> dict[str, Any]:
    """Reports with another state of the simulation."""
    return changed(ROWS, "server", "state", "state", to={**SIMULATION, **members})


OFF = changed(ROWS, "server", "state", "clients", to=[])
ENDED = changed(ROWS, "robots", "R1", to={**ROWS["robots"]["R1"], "age": 4.0, "bound": False})
ASKED = changed(ROWS, "robots", "R2", to={"state": None, "age": None, "problem": "", "bound": True})
UNKNOWN = changed(ROWS, "robots", "R1", to={"state": None, "age": None, "problem": "hangs", "bound": True})


DOWN = changed(ROWS, "channels", "a", "state", "links", to=[{**LINK, "condition": "DOWN"}])


CONNECTING = {**ROWS, "naming": "connecting"}
LOST = {**ROWS, "naming": "does not answer"}
#: What reports, one after the other, show: kind, robot and text.
CASES: dict[str, tuple[list[dict[str, Any]], list[tuple[str, str, str]]]] = {
    "the first report and an equal one": ([ROWS, ROWS], []),
    "collisions are counted": (
        [ROWS, of_server(collisions=1), of_server(collisions=3)],
        [("collision", "", "a collision"), ("collision", "", "2 collisions")],
    ),
    "a server that restarts": ([of_server(collisions=7), ROWS], []),
    "stop and release": (
        [ROWS, of_robot(ROWS, condition="STOPPED", reason="emergency stop"), ROWS],
        [("stop", "R1", "R1 is stopped: emergency stop"), ("stop", "R1", "R1 may move again")],
    ),
    "a program": (
        [
            ROWS,
            of_robot(ROWS, condition="RUNNING", program={**PROGRAM, "name": "fetch"}),
            of_robot(ROWS, program={"name": "fetch", "result": "FAILED", "reason": "door"}),
        ],
        [("program", "R1", "R1 runs fetch"), ("program", "R1", "R1 has ended fetch, failed: door")],
    ),
    "a mission": (
        [ROWS, of_robot(ROWS, mission="M1"), ROWS],
        [("mission", "R1", "R1 takes part in mission M1"), ("mission", "R1", "R1 leaves mission M1")],
    ),
    "a robot logs off and falls silent": (
        [ROWS, OFF, changed(OFF, "robots", "R1", "age", to=4.0)],
        [("robot", "R1", "R1 has logged off"), ("robot", "R1", "R1 does not answer")],
    ),
    "a robot ends, which takes its name from the naming service": ([ROWS, ENDED], [("robot", "R1", "R1 has ended")]),
    "a gateway": ([ROWS, DOWN], [("channel", "", "the gateway from b to a is down")]),
    "a new robot, once": (
        [ROWS, ASKED, changed(ROWS, "robots", "R2", to=ROWS["robots"]["R1"])],
        [("robot", "R2", "R2 has started")],
    ),
    "a new robot that hangs": (
        [ROWS, ASKED, changed(ASKED, "robots", "R2", "problem", to="does not answer")],
        [("robot", "R2", "R2 has started"), ("robot", "R2", "R2 does not answer")],
    ),
    "the first robot and channel of a running system": (
        [{**ROWS, "robots": {}, "channels": {}}, ROWS],
        [("robot", "R1", "R1 has started"), ("channel", "", "channel a has started")],
    ),
    "what ran before the console": ([{**CONNECTING, "robots": {}, "channels": {}}, CONNECTING, ROWS, ROWS], []),
    "a lost naming service": (
        [ROWS, LOST, of_robot(LOST, condition="STOPPED")],
        [("stop", "R1", "R1 is stopped")],
    ),
    "a robot without any answer": ([ROWS, UNKNOWN], [("robot", "R1", "R1 does not answer")]),
}


@pytest.mark.parametrize("case", CASES)
def test_what_reports_show(case: str) -> None:
    steps, news = CASES[case]
    assert noticed(*steps) == news


def test_a_lost_server_is_no_crowd_of_news_and_old_news_are_forgotten() -> None:
    lost = changed(ROWS, "server", "problem", to="does not answer")
    assert [kind for kind, _, _ in noticed(ROWS, lost, ROWS)] == ["server", "server"]
    happenings = Happenings()
    for at_s, step in ((0.0, ROWS), (1.0, of_server(paused=True)), (KEPT_S + 2.0, ROWS)):
        happenings.note(step, at_s)
    assert [(each.number, each.text) for each in happenings.after(0)] == [(2, "the simulation goes on")]
    assert happenings.after(2) == []
    assert happenings.last == 2
    before = {**ROWS, "robots": {"\u202ex": ROWS["robots"]["R1"]}}
    after = changed(before, "robots", "\u202ex", "state", "condition", to="STOPPED")
    assert noticed(before, after) == [("stop", "\u202ex", "\u2068\u202ex\u2069 is stopped")]
    ((_, _, text),) = noticed(ROWS, of_robot(ROWS, condition="STOPPED", reason="x" * 5000))
    assert len(text) == MAX_TEXT


FLOOR = "L1"
TABLE = ((-0.5, -0.25), (0.5, -0.25), (0.5, 0.25), (-0.5, 0.25))
R1, R2 = (Body(number, BodyKind.ROBOT, name, 0.3, (), 50.0) for number, name in ((1, "R1"), (2, "R2")))
TABLE_1 = Body(3, BodyKind.OBJECT, "table 1", 0.56, TABLE, 20.0)
#: Free places of the building, away from its walls.
AWAY, MIDDLE = (3.0, 2.0, 0.0), (5.0, 2.0, 0.0)


def history(*moments: dict[Body, tuple[float, float, float]]) -> History:
    """A floor once a second from time 0; a moment has the place x, y, heading of each body."""
    history, view = History(), FloorView(FLOOR)
    for at_s, places in enumerate(moments):
        motions = np.zeros(len(places), MOTION)
        for row, (body, place) in zip(motions, places.items(), strict=True):
            row["number"], (row["x"], row["y"], row["heading"]) = body.number, place
        view.apply(FloorUpdate(FLOOR, WHOLE, at_s + 1, float(at_s), 1, list(places), [], motions, {}))
        history.add(view, float(at_s))
    return history


def found(*moments: dict[Body, tuple[float, float, float]], building: Building | None = None) -> list[Contact]:
    return contacts_since(history(*moments), building or Building(""), 0.0, 10.0)


def test_robots_that_meet_somebody_are_named() -> None:
    apart = {R1: AWAY, R2: MIDDLE}
    together = {R1: AWAY, R2: (AWAY[0] + 0.62, AWAY[1], 0.0)}
    assert found(apart, together, apart, together) == [Contact(FLOOR, "R1", "R2")]
    assert found(together, {**together, R1: (AWAY[0], AWAY[1], 1.0)}) == []  # they touched before
    assert found(apart, {R1: AWAY, R2: (AWAY[0] + 0.64, AWAY[1], 0.0)}) == []  # a gap
    assert found({TABLE_1: MIDDLE}, {TABLE_1: AWAY}) == []  # no robots
    # Beside a table lies free floor as long as the table lies along.
    x, y, _ = AWAY
    assert found({R1: AWAY, TABLE_1: MIDDLE}, {R1: AWAY, TABLE_1: (x, y + 0.6, 0.0)}) == []
    turned = {R1: AWAY, TABLE_1: (x, y + 0.6, np.pi / 2)}
    assert found({R1: AWAY, TABLE_1: MIDDLE}, turned) == [Contact(FLOOR, "R1", "table 1")]
    building = two_floors()
    wall = next(iter(building.floors[FLOOR].geometrical.walls.values()))
    end = (*wall.a, 0.0)
    words = {contact.other for contact in found({R1: (50.0, 50.0, 0.0)}, {R1: end}, building=building)}
    assert "a wall" in words
    contacts = [Contact("L2", "R1", "a wall"), Contact("L1", "R2", "table 1")]
    assert collision(contacts) == ("R1", "L2", "2 collisions: R1 and a wall, R2 and table 1")
    assert collision([]) == ("", "", "2 collisions")
    _, _, text = collision([Contact("L1", f"R{number}", "a wall") for number in range(20)])
    assert text.count("a wall") == MAX_CONTACTS
    assert text.endswith(" and others")


def collision(contacts: list[Contact]) -> tuple[str, str, str]:
    """Robot, floor and text of two collisions between these."""
    happenings = Happenings(lambda at_s: contacts)
    for count in (0, 2):
        happenings.note(of_server(collisions=count), 1.0)
    (happening,) = happenings.after(0)
    return happening.robot, happening.floor, happening.text


class FakeState:
    """Reports the clients that a test sets."""

    def __init__(self) -> None:
        self.clients, self.forgotten = list[str](), list[str]()
        self.forget, self.start, self.close = self.forgotten.append, int, int

    def rows(self) -> dict[str, Any]:
        clients = [{"name": name, "at": {"floor": "L1", "x": 1.0, "y": 2.0, "heading": 0.0}} for name in self.clients]
        server = {"state": {"state": SIMULATION, "clients": clients, "sensors": []}, "age": 0.0, "problem": ""}
        return {"naming": "", "server": server, "robots": {}, "channels": {}}


def test_a_robot_that_logged_off_is_known_until_it_is_forgotten(monkeypatch: Any) -> None:
    fake = FakeState()
    state = MonitorState(fake, History())
    for clients, gone in ((["R1", "R2"], []), (["R2"], ["R1"]), ([], ["R1", "R2"]), (["R2"], ["R1"])):
        fake.clients = clients
        state.update()
        assert sorted(state.rows()["gone"]) == gone
    row = state.rows()["gone"]["R1"]
    assert row["client"]["at"]["x"] == 1.0
    assert row["age"] >= 0.0
    state.forget("R1")
    assert state.rows()["gone"] == {}
    assert fake.forgotten == ["R1"]
    monkeypatch.setattr(monitor_state, "MAX_GONE", 3)
    fake = FakeState()
    state = MonitorState(fake, History())
    for number in range(9):
        fake.clients = [f"R{number}"]
        state.update()
    fake.clients = []
    assert list(state.rows()["gone"]) == ["R6", "R7", "R8"]


def test_the_span_to_look_back_begins_with_the_history_and_happenings_are_numbered_in_the_rows() -> None:
    fake, history = FakeState(), History()
    state = MonitorState(fake, history)
    began, now = state.rows()["past"]
    assert began == now
    view = FloorView("L1")
    view.apply(FloorUpdate("L1", WHOLE, 1, 0.0, 1, [], [], np.empty(0, MOTION), {}))
    history.add(view, now - 10.0)
    assert state.rows()["past"][0] == now - 10.0
    state.update()
    fake.clients = ["R1"]
    state.update()
    assert state.rows()["happenings"] == 1
    assert state.happenings.after(0)[0].text == "R1 has logged on"

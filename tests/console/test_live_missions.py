"""The missions as browsers get them: all at first, then what has changed."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robocorba.console import live_missions
from robocorba.console.live_missions import LiveMissions, MissionFeed
from robocorba.errors.services import NotReachable
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState


def state(name: str, version: int, result: MissionResult = MissionResult.RUNNING) -> MissionState:
    content = MissionContent(kind="move_table", about="desk", leader="A", begun=1.0, result=result)
    return MissionState(name, version, content)


class Control:
    """Mission control. asked: the versions in the requests."""

    def __init__(self) -> None:
        self.states: dict[str, MissionState] = {}
        self.asked: list[int] = []
        self.is_away = False

    def missions_since(self, version: int) -> list[MissionState]:
        self.asked.append(version)
        if self.is_away:
            raise NotReachable("mission control does not answer")
        return [each for each in self.states.values() if each.version > version]

    def put(self, *states: MissionState) -> None:
        self.states.update((each.name, each) for each in states)


class Place:
    def __init__(self) -> None:
        self.control, self.wakes = Control(), 0
        self.missions = LiveMissions(self.control, self.wake)

    def wake(self) -> None:
        self.wakes += 1

    def feed(self) -> MissionFeed:
        feed = MissionFeed(self.missions)
        feed.want(True)
        return feed


def news(feed: MissionFeed) -> tuple[bool, list[str]] | None:
    """Whether a message is whole, and the names in it; None for no message."""
    message = feed.message()
    if not message:
        return None
    found: dict[str, Any] = json.loads(message)
    return found["whole"], [row["name"] for row in found["missions"]]


@pytest.fixture
def place() -> Place:
    return Place()


def test_nobody_is_asked_for_nobody(place: Place) -> None:
    place.missions.follow()
    assert place.control.asked == []
    feed = place.feed()
    place.missions.follow()
    feed.want(False)
    place.missions.follow()
    assert place.control.asked == [0]
    assert news(feed) is None


def test_a_viewer_gets_all_and_then_what_has_changed(place: Place) -> None:
    place.control.put(state("one", 5), state("two", 6))
    early, late = place.feed(), MissionFeed(place.missions)
    assert news(early) is None, "nothing is known yet"
    place.missions.follow()
    assert news(early) == (True, ["one", "two"])
    assert news(early) is None
    place.control.put(state("one", 7, MissionResult.DONE))
    place.missions.follow()
    assert news(early) == (False, ["one"])
    late.want(True)
    assert news(late) == (True, ["two", "one"])
    assert place.control.asked == [0, 6]
    assert place.wakes == 2


def test_a_building_without_missions_is_known_as_such(place: Place) -> None:
    feed = place.feed()
    place.missions.follow()
    assert news(feed) == (True, [])
    place.missions.follow()
    assert news(feed) is None


def test_removed_missions_disappear(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_missions, "ALL_INTERVAL_S", 0.0)
    place.control.put(state("one", 5), state("two", 6))
    feed = place.feed()
    place.missions.follow()
    news(feed)
    del place.control.states["one"]
    place.missions.follow()
    assert news(feed) == (True, ["two"])


def test_a_server_that_was_away_is_asked_for_everything(place: Place) -> None:
    place.control.put(state("one", 5))
    feed = place.feed()
    place.missions.follow()
    news(feed)
    place.control.is_away = True
    place.missions.follow()
    place.missions.follow()
    assert place.missions.problem == "mission control does not answer"
    assert place.wakes == 2, "once for the missions, once for the problem"
    place.control.is_away, place.control.states = False, {"one": state("one", 100), "new": state("new", 101)}
    place.missions.follow()
    assert place.missions.problem == ""
    assert news(feed) == (False, ["new"]), "the other one is as it was"
    assert place.control.asked[-1] == 0


def test_rows_have_what_a_page_shows(place: Place) -> None:
    place.control.put(state("<b>مهمة\u202e", 5))
    feed = place.feed()
    place.missions.follow()
    (row,) = json.loads(feed.message())["missions"]
    assert row == {
        **{"name": "<b>مهمة\u202e", "kind": "move_table", "about": "desk", "leader": "A", "term": 1, "members": []},
        **{"phases": [], "phases_in_all": 0, "begun": 1.0, "ended": 0.0, "result": "running", "reason": ""},
    }

"""Operations of the monitor page refuse impossible arguments with a sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from robocorba.console.arguments import InvalidArguments
from robocorba.console.films import Films, InvalidFilm
from robocorba.console.history import History
from robocorba.console.monitor_operations import MonitorOperations
from robocorba.console.monitor_state import MonitorState
from robocorba.console.operations import Operations
from robocorba.console.recordings import Recordings, UnknownRecording
from robocorba.errors.base import RoboCorbaError
from robocorba.maps.model import Building
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate, FloorView
from robocorba.testing.buildings import two_floors

NOBODY: Any = None
Make = Callable[[Building], MonitorOperations]


class NoState:
    """A system without anything."""

    def start(self) -> None: ...
    def close(self) -> None: ...
    def forget(self, robot: str) -> None: ...

    def rows(self) -> dict[str, Any]:
        server = {"state": None, "age": None, "problem": "gone"}
        return {"naming": "", "server": server, "robots": {}, "channels": {}}


@pytest.fixture
def make() -> Iterator[Make]:
    films = Films()
    history = History()
    view = FloorView("L1")
    view.apply(FloorUpdate("L1", WHOLE, 1, 0.0, 1, [], [], np.empty(0, MOTION), {}))
    history.add(view, 1000.0)

    def operations(building: Building) -> MonitorOperations:
        return MonitorOperations(MonitorState(NoState(), history), history, lambda: building, Recordings(), films)

    yield operations
    films.close()


@pytest.mark.parametrize(
    ("operation", "arguments", "error"),
    [
        ("start_film", {"floor": "L1", "begin": "now", "end": 2.0}, InvalidArguments),
        ("start_film", {"floor": 1, "begin": 1.0, "end": 2.0}, InvalidArguments),
        ("start_film", {"floor": "L1", "begin": 1.0, "end": float("nan")}, InvalidArguments),
        ("start_film", {"floor": "L1", "begin": 2.0, "end": 2.0}, InvalidFilm),
        ("start_film", {"floor": "cellar", "begin": 1.0, "end": 2.0}, InvalidFilm),
        ("start_film", {"floor": "L2", "begin": 1.0, "end": 2.0}, RoboCorbaError),
        ("start_film", {"floor": "L1", "begin": 1.0, "end": 2.0, "recording": "recording 9"}, UnknownRecording),
        ("film_state", {"film": "1"}, InvalidArguments),
        ("film_state", {"film": 1}, InvalidFilm),
        ("cancel_film", {"film": True}, InvalidArguments),
        ("happenings", {"after": "x"}, InvalidArguments),
        ("happenings", {"after": 10**400}, InvalidArguments),
        ("forget_robot", {"robot": None}, InvalidArguments),
    ],
)
def test_impossible_arguments(make: Make, operation: str, arguments: dict[str, Any], error: type[Exception]) -> None:
    operations = Operations(NOBODY)
    operations.add(make(two_floors()))
    with pytest.raises(error):
        operations.call(operation, arguments)


def test_no_film_before_the_map_is_known(make: Make) -> None:
    with pytest.raises(InvalidFilm, match="map is not known"):
        make(Building("")).start_film("L1", 1.0, 2.0)


def test_a_system_without_anything_has_no_recordings_and_no_happenings(make: Make) -> None:
    assert make(two_floors()).recordings() == []
    assert make(two_floors()).happenings() == []

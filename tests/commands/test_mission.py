"""What `robocorba mission` shows."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from robocorba.commands.mission import follow_mission
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState, PhaseRecord


class Control:
    """Mission control, which says one after the other."""

    def __init__(self, *contents: MissionContent) -> None:
        self._contents = iter(contents)

    def mission(self, name: str) -> MissionState:
        return MissionState(name, 1, next(self._contents))


@pytest.mark.parametrize("began", [100.0, 4e9])
def test_how_long_a_mission_takes_does_not_depend_on_the_clock_of_its_leader(began: float) -> None:
    asking = MissionContent(kind="move_table", about="desk", leader="A", begun=began)
    gathering = msgspec.structs.replace(asking, phases=(PhaseRecord("gathering", began + 1000.0),))
    done = gathering.ended_as(MissionResult.DONE, "", began + 2000.0)
    control: Any = Control(asking, gathering, done)
    first, second, last = (status.seconds for status in follow_mission(control, "m", lambda seconds: None))
    assert 0.0 <= first < 500.0
    assert 1000.0 <= second < 1500.0
    assert last == 2000.0

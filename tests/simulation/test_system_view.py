"""Where robots are across floors: heights in elevators, and the times of what is known of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from robocorba.map_editor.model import Building, Elevator, ElevatorDoor, Floor, FloorMap
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.simulation.system_view import RobotPlace, SystemView

HOUSE = Building(
    "house",
    {name: FloorMap(Floor(name=name, level=i, elevation=4.0 * i)) for i, name in enumerate(("L1", "L2"))},
    {"E1": Elevator(name="E1", at=(1.0, 2.0), size=(2.0, 2.0), doors=(ElevatorDoor("L1"), ElevatorDoor("L2")))},
)


def update(
    floor: str,
    version: int,
    time_s: float,
    cabin: ElevatorState | None = None,
    came: Sequence[str] = (),
    went: Sequence[int] = (),
    x: float = 1.0,
) -> FloorUpdate:
    """A floor's next update; robots that came are numbered by their names."""
    bodies = [Body(ord(name), BodyKind.ROBOT, name, 0.4, (), 127.0) for name in came]
    rows = np.array([(body.number, 0.0, 0.0, 0.0, x, 2.0, 0.0) for body in bodies], MOTION)
    elevators = {"E1": cabin} if cabin else {}
    return FloorUpdate(floor, version - 1, version, time_s, 1, bodies, list(went), rows, elevators)


def cabin(height: float, floor: str = "", riders: Sequence[str] = ("A",)) -> ElevatorState:
    return ElevatorState(height, floor, Doors.CLOSED, 0.0, tuple(riders), ())


def place(view: SystemView, name: str = "A") -> RobotPlace:
    (found,) = (place for place in view.robots() if place.name == name)
    return found


@pytest.mark.parametrize("is_old_floor_first", [True, False])
def test_a_rider_never_falls_back_to_its_old_floor(is_old_floor_first: bool) -> None:
    """Its cabin has arrived, but the update with which it comes to the new floor may be the next one."""
    view, heights = SystemView(HOUSE), []

    def see(*updates: FloorUpdate) -> None:
        view.apply(updates)
        heights.append(place(view).z)

    see(update("L1", 1, 1.0, cabin(0.0, "L1"), came="A"), update("L2", 1, 1.0, cabin(0.0, "L1")))
    for step, height in enumerate((1.0, 2.5, 3.9), 2):
        see(update("L1", step, float(step), cabin(height)), update("L2", step, float(step), cabin(height)))
    old = update("L1", 5, 5.0, cabin(4.0, "L2"), went=[ord("A")] if not is_old_floor_first else ())
    new = update("L2", 5, 5.0, cabin(4.0, "L2"), came="A")
    if is_old_floor_first:
        see(old)
        assert place(view).floor == "L1"  # nobody has said anything else yet
        see(new)
    else:
        see(new)
        see(old)
    see(update("L2", 6, 6.0, cabin(4.0, "L2", ())))  # it has alighted
    assert heights == sorted(heights)
    assert (place(view).floor, place(view).z) == ("L2", 4.0)


def test_a_rider_follows_its_cabin_when_the_elevator_gets_another_name() -> None:
    view = SystemView(HOUSE)
    view.apply([update("L1", 1, 1.0, cabin(2.0), came="A"), update("L2", 1, 1.0, cabin(2.0))])
    renamed = [update("L1", 2, 2.0, came="A")._replace(since=0), update("L2", 2, 2.0)._replace(since=0)]
    view.apply(each._replace(elevators={"lift": cabin(3.0)}) for each in renamed)
    assert place(view).z == 3.0
    view.apply([renamed[0]._replace(since=2, version=3, came=[], elevators={"lift": cabin(4.0, "L2", ())})])
    assert place(view).z == 0.0  # of its floor
    assert (place(view).time_s, view.time_s) == (2.0, 2.0)
    view.apply([update("L2", 3, 2.5)])
    assert (place(view).time_s, view.time_s) == (2.0, 2.5)  # of its floor, too

"""Who goes where around an object."""

from __future__ import annotations

import math

import pytest

from robocorba.errors.robots import MissionFailed
from robocorba.missions.helpers import assign_places
from robocorba.planning.request import Place

WEST, MIDDLE, EAST = (Place("L1", x, 1.3) for x in (2.4, 3.3, 6.0))


def straight(one: Place, other: Place) -> float | None:
    return math.dist(one[1:], other[1:])


@pytest.mark.parametrize("leader", ["A", "B"])
def test_who_is_there_moves_up_for_who_comes(leader: str) -> None:
    assert assign_places({"A": MIDDLE, "B": EAST}, [WEST, MIDDLE], leader, straight) == ["A", "B"]
    assert assign_places({"A": MIDDLE, "B": EAST}, [MIDDLE, WEST], leader, straight) == ["B", "A"]


def test_the_nearest_go_and_the_leader_does_however_far_it_is() -> None:
    robots = {"A": Place("L1", 900.0, 0.0), "B": MIDDLE, "C": EAST}
    assert set(assign_places(robots, [WEST, MIDDLE], "A", straight)) == {"A", "B"}
    assert set(assign_places(robots, [WEST, MIDDLE], "B", straight)) == {"B", "C"}


def test_who_can_not_get_there_goes_elsewhere() -> None:
    def way_m(start: Place, goal: Place) -> float | None:
        return None if (start, goal) == (EAST, MIDDLE) else straight(start, goal)

    assert assign_places({"A": MIDDLE, "B": EAST}, [WEST, MIDDLE], "A", way_m) == ["B", "A"]
    with pytest.raises(MissionFailed, match=r"no robot can reach L1 \(3\.30, 1\.30\) beside the object"):
        assign_places({"A": EAST, "B": EAST}, [MIDDLE, WEST], "A", way_m)


def test_too_few_are_told() -> None:
    with pytest.raises(MissionFailed, match="2 robots are needed; A are free"):
        assign_places({"A": EAST}, [WEST, MIDDLE], "A", straight)

"""Assignment of robots to the places around an object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from robocorba.errors.robots import MissionFailed
from robocorba.planning.request import Place

#: Cost of a place that a robot cannot reach [m²].
_UNREACHABLE = 1e12
#: Cost of a plan without the leader [m²].
_LEADER = 1e10


def assign_places(
    robots: Mapping[str, Place], places: Sequence[Place], leader: str, length_m: Callable[[Place, Place], float | None]
) -> list[str]:
    """The robot for each of the places, in their order, with the least sum of squared path lengths. The leader always
    gets a place. Squares avoid that a robot must pass another one at a nearer place: that one moves on instead.

    length_m: path length from one place to another, None if there is no path. Raises MissionFailed if there are too
    few robots, or if no robot can reach a place."""
    from scipy.optimize import linear_sum_assignment  # takes longer to load than all missions; few robots lead

    names = sorted(robots, key=lambda name: (name != leader, name))
    if len(names) < len(places):
        raise MissionFailed(f"{len(places)} robots are needed; {', '.join(names)} are free")
    lengths = [[length_m(robots[name], place) for place in places] for name in names]
    costs = np.array([[_UNREACHABLE if length is None else length**2 for length in row] for row in lengths])
    costs[0] -= _LEADER  # names[0] is the leader, which must take part
    rows, columns = linear_sum_assignment(costs)
    found = {int(column): int(row) for row, column in zip(rows, columns, strict=True)}
    for column, place in enumerate(places):
        row = found[column]
        if lengths[row][column] is None:
            raise MissionFailed(f"no robot can reach {place.floor} ({place.x:.2f}, {place.y:.2f}) beside the object")
    return [names[found[column]] for column in range(len(places))]

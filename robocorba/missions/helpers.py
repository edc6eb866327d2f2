"""Whom a leader asks: those robots that are nearest to where they would have to be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from robocorba.errors.robots import MissionFailed
from robocorba.planning.request import Place

#: For a robot that can't get to a place, and for leaving the leader out, m².
_NEVER, _LEADER = 1e12, 1e10


def assigned(
    robots: Mapping[str, Place], places: Sequence[Place], leader: str, way_m: Callable[[Place, Place], float | None]
) -> list[str]:
    """Who goes to each of the places, in their order, so that the squares of all ways together are least; the leader
    goes to one. By squares nobody has to get past another one who is there already: that one moves up.

    way_m: how far it is from one place to another, None where there is no way. Raises MissionFailed."""
    from scipy.optimize import linear_sum_assignment  # takes longer to load than all missions; few robots lead

    names = sorted(robots, key=lambda name: (name != leader, name))
    if len(names) < len(places):
        raise MissionFailed(f"{len(places)} robots are needed; {', '.join(names)} are free")
    ways = [[way_m(robots[name], place) for place in places] for name in names]
    costs = np.array([[_NEVER if way is None else way**2 for way in row] for row in ways])
    costs[0] -= _LEADER  # whoever leads takes part
    rows, columns = linear_sum_assignment(costs)
    found = {int(column): int(row) for row, column in zip(rows, columns, strict=True)}
    for column, place in enumerate(places):
        row = found[column]
        if ways[row][column] is None:
            raise MissionFailed(f"nobody can get to {place.floor} ({place.x:.2f}, {place.y:.2f}) beside the object")
    return [names[found[column]] for column in range(len(places))]

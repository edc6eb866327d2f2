"""How long a robot waits at most until an elevator's doors open for it, whatever others do.

The cabin serves the oldest call, then the next one. On its way it stops for others only between the floors of the ride
that it serves, and doors stay open for a limited time. So each earlier call delays later ones by one trip at most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

from robocorba.map_editor.model import Elevator
from robocorba.planning.elevators import travel_time
from robocorba.simulation.elevator import BOARDING_LIMIT_S, OPEN_LIMIT_S, Cabin, RidePhase, RideSession


def longest_wait_s(cabin: Cabin, robot: str) -> float:
    """Upper bound of the simulated time until the doors open for a robot's ride [s]; 0 once they have, and without a
    ride. Thread-safe."""
    sessions = sorted(list(cabin.sessions.values()), key=lambda session: session.called_at)  # noqa: C414  (atomic copy)
    own = next((session for session in sessions if session.robot == robot), None)
    if own is None or own.phase is not RidePhase.WAITING:
        return 0.0
    at_cabin = [session for session in sessions if session.phase is not RidePhase.WAITING]
    ahead = _turns([each for each in sessions[: sessions.index(own)] if each.phase is RidePhase.WAITING], own)

    def empty_s(here: str, there: str) -> float:
        """The empty cabin travels to a call, past all others."""
        return travel_time(cabin.elevator, cabin.heights[there] - cabin.heights[here])

    # The cabin may have just left its floor, or be closing its doors there.
    seconds, floor = OPEN_LIMIT_S + BOARDING_LIMIT_S + cabin.elevator.door_time, cabin.floor
    for session in at_cabin:  # the others usually lie within the ride of the first one
        seconds += _ride_s(cabin.elevator, cabin.heights, session, floor)
        floor = session.destination
    for session in ahead:
        seconds += empty_s(floor, session.origin)
        seconds += _ride_s(cabin.elevator, cabin.heights, session, session.origin)
        floor = session.destination
    return seconds + empty_s(floor, own.origin) + cabin.elevator.door_time


def _turns(ahead: Sequence[RideSession], own: RideSession) -> list[RideSession]:
    """The earlier calls, one of each party; without those of the robot's own party."""
    found: dict[str, RideSession] = {}
    for session in ahead:
        if not session.party or session.party != own.party:
            found.setdefault(session.party or f"robot {session.robot}", session)
    return list(found.values())


def _ride_s(elevator: Elevator, heights: Mapping[str, float], session: RideSession, origin: str) -> float:
    """Upper bound of the time from the arrival at a floor, with closed doors, until they are closed again at the
    destination [s]. heights: of the served floors [m]."""
    door_s = elevator.door_time
    low, high = sorted((heights[origin], heights[session.destination]))
    stops = sorted({height for height in heights.values() if low <= height <= high})
    travel_s = sum(travel_time(elevator, there - here) for here, there in pairwise(stops))
    # Lone robots may begin to board until OPEN_LIMIT_S.
    board_s = max(session.limit_s, OPEN_LIMIT_S + BOARDING_LIMIT_S)
    between_s = max(0, len(stops) - 2) * (2 * door_s + OPEN_LIMIT_S + BOARDING_LIMIT_S)
    return door_s + board_s + door_s + travel_s + between_s + door_s + session.limit_s + door_s

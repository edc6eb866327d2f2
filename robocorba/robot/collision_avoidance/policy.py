"""How long a robot waits for others before it steps aside or takes another path."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GivingWayPolicy:
    """Times and limits of giving way. All robots should have the same: the times decide which of two robots that block
    each other moves first."""

    #: A robot that has been stationary for this time [s] is parked.
    parked_s: float = 2.0
    #: Time after which Blocked is raised [s], for a robot blocked by a parked robot or a wall.
    blocked_by_parked_s: float = 0.5
    #: The same for a robot blocked by one whose name is earlier in the alphabet, which has priority [s].
    blocked_by_earlier_s: float = 1.0
    #: The same for a robot blocked by one whose name is later, which should step aside first [s].
    blocked_by_later_s: float = 4.0
    #: A drive fails when it is blocked more often than this.
    max_blockages: int = 8
    #: A drive fails when it has to take another path around what the robot sees more often than this.
    max_detours: int = 60
    #: Or when it does not get on for this time because of that [s].
    max_stuck_s: float = 20.0
    #: Time for which a blocked robot searches for a path around the other one [s]; then it takes the path of the map.
    max_search_s: float = 10.0
    #: A robot that yields for a shorter time shows that it works, not that it waits [s].
    wait_shown_s: float = 0.5
    #: Maximum numbers of robots and of objects in one path request.
    max_robots: int = 20
    max_objects: int = 30


DEFAULT_POLICY = GivingWayPolicy()

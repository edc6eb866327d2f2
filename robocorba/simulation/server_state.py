"""The state of the simulation server, as clients read it."""

from __future__ import annotations

from typing import NamedTuple


class ServerState(NamedTuple):
    """State of the server. limit, robots: allowed and logged-on robots. time: simulated [s]. pace, achieved: requested
    (0: as fast as possible) and achieved simulated seconds per second. event_rate: published events per second."""

    limit: int
    robots: int
    time: float
    pace: float
    achieved: float
    is_paused: bool
    map_version: int
    collisions: int
    event_rate: float

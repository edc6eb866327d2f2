"""Operations of the simulation server's administrator: pause, pace, evict, place."""

from __future__ import annotations

from robocorba.corba.orb import Orb


class SimulationOperations:
    """Operations of the simulation server's administrator: pause, pace, evict, place."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

"""Operations of the missions page: start, abort and report missions."""

from __future__ import annotations

from robocorba.corba.orb import Orb


class MissionOperations:
    """Operations of the missions page: start, abort and report missions."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

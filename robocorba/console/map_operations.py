"""Operations of the map page: edit the building, plan paths, import and export."""

from __future__ import annotations

from robocorba.corba.orb import Orb


class MapOperations:
    """Operations of the map page: edit the building, plan paths, import and export."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

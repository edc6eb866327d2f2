"""Operations of the program page: check, run and edit programs."""

from __future__ import annotations

from robocorba.corba.orb import Orb


class ProgramOperations:
    """Operations of the program page: check, run and edit programs."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

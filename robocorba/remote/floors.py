"""Floors of the Omni database, followed from another process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from omniORB import CORBA

from robocorba.errors import NotReachable
from robocorba.orb import Orb, describe
from robocorba.remote.simulation import changes
from robocorba.simulation.floor_update import FloorUpdate, FloorView
from robocorba.stubs import RoboCorba

#: Longest answer of the database.
CALL_LIMIT_S = 2.0


class RemoteFloor:
    """A copy of `floor` as a `database` (a RoboCorba::OmniDatabase) has it. One thread at a time may use it."""

    def __init__(self, database: Any, floor: str) -> None:
        self._database = database
        self.view = FloorView(floor)

    def follow(self) -> FloorUpdate:
        """Bring `view` up to date: by what changed, the first time by the whole floor.

        Raises UnknownFloor, NotReachable."""
        update = changes(self._database, self.view.floor, self.view.version)
        self.view.apply(update)
        return update


class RemoteFloors:
    """Some floors of a running system, by default all that there are. Where the database was away, it is found again.

    One thread at a time may use it."""

    def __init__(self, orb: Orb, chosen: Sequence[str] = ()) -> None:
        self._orb, self._chosen = orb, chosen
        self._database: Any = None
        self._floors: dict[str, RemoteFloor] = {}

    @property
    def views(self) -> dict[str, FloorView]:
        """The copies, by name."""
        return {name: floor.view for name, floor in self._floors.items()}

    def follow(self, find_s: float) -> list[FloorUpdate]:
        """Bring all views up to date. Raises UnknownFloor, and NotReachable where it is not found within `find_s`.

        After a loss they begin anew, by the whole floors."""
        try:
            if self._database is None:
                self._database = self._orb.resolve("OmniDatabase", RoboCorba.OmniDatabase, find_s, CALL_LIMIT_S)
            names = self._chosen or self._database.floors()
            self._floors = {name: self._floors.get(name) or RemoteFloor(self._database, name) for name in names}
            return [floor.follow() for floor in self._floors.values()]
        except NotReachable:
            self._forget()
            raise
        except CORBA.SystemException as wrong:
            self._forget()
            raise NotReachable(f"the Omni database does not answer ({describe(wrong)})") from None

    def _forget(self) -> None:
        self._database = None
        self._floors = {}

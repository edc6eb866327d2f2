"""Copies of the Omni database's floors in another process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import RemoteObject
from robocorba.corba.remote.simulation import changes
from robocorba.errors.services import NotReachable
from robocorba.spatial.floor_update import FloorUpdate, FloorView
from robocorba.stubs import RoboCorba

#: Timeout of a call to the database [s].
CALL_LIMIT_S = 2.0


class RemoteFloor:
    """Local copy of a floor of `database`, a RoboCorba::OmniDatabase. Not thread-safe."""

    def __init__(self, database: Any, floor: str) -> None:
        self._database = database
        self.view = FloorView(floor)

    def follow(self) -> FloorUpdate:
        """Update `view`: the first time by the whole floor, later by changes. Returns the update.

        Raises UnknownFloor, NotReachable."""
        update = changes(self._database, self.view.floor, self.view.version)
        self.view.apply(update)
        return update


class RemoteDatabase:
    """The Omni database of a running system, resolved by the first call and after each failure. Thread-safe.

    find_s: timeout for resolving it [s]."""

    def __init__(self, orb: Orb, find_s: float) -> None:
        what = "the Omni database"
        self._database = RemoteObject(orb, "OmniDatabase", RoboCorba.OmniDatabase, what, find_s, CALL_LIMIT_S)

    @property
    def find_s(self) -> float:
        return self._database.resolve_s

    @find_s.setter
    def find_s(self, timeout_s: float) -> None:
        self._database.resolve_s = timeout_s

    def floors(self) -> list[str]:
        """Names of all floors. Raises NotReachable."""
        return list(self._database.call(lambda database: database.floors()))

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """Changes of a floor since a version. Raises UnknownFloor, NotReachable."""
        return self._database.call(lambda database: changes(database, floor, since))


class RemoteFloors:
    """Local copies of floors of a running system, by default all; reconnects after a failure. Not thread-safe."""

    def __init__(self, orb: Orb, chosen: Sequence[str] = ()) -> None:
        self._database, self._chosen = RemoteDatabase(orb, 0.0), chosen
        #: Copies by name.
        self.views: dict[str, FloorView] = {}

    def follow(self, find_s: float) -> list[FloorUpdate]:
        """Update all views. After a failure the next call loads whole floors again.

        Raises UnknownFloor, and NotReachable if the database is not found within `find_s`."""
        self._database.find_s = find_s
        try:
            names = self._chosen or self._database.floors()
            self.views = {name: self.views.get(name) or FloorView(name) for name in names}
            return [self._catch_up(view) for view in self.views.values()]
        except NotReachable:
            self.views = {}
            raise

    def _catch_up(self, view: FloorView) -> FloorUpdate:
        update = self._database.changes(view.floor, view.version)
        view.apply(update)
        return update

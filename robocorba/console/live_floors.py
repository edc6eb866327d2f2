"""The floors of the running system as they are now, for all viewers of the console."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable

from robocorba.console.following import Following
from robocorba.console.frames import update_frame, whole_update
from robocorba.console.history import History
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.floor_update import WHOLE, FloorView
from robocorba.orb.orb import Orb
from robocorba.robot.live_scans import SensedRobot, robots_on
from robocorba.simulation.corba.remote_database import RemoteDatabase

#: Interval between updates of floors that nobody watches [s].
UNWATCHED_S = 0.5
#: Timeout for resolving the Omni database in each round [s].
RESOLVE_TIMEOUT_S = 0.5


class LiveFloor:
    """The newest content of a floor, and the frames that bring a viewer to it. Thread-safe."""

    def __init__(self, name: str) -> None:
        self._lock = threading.Lock()
        self._view = FloorView(name)
        #: Frame of the last update, and the version that it continues.
        self._frame, self._since = b"", WHOLE
        self._whole: tuple[int, bytes] = WHOLE, b""
        #: Time of the next request on the monotonic clock [s].
        self.next_s = 0.0

    @property
    def version(self) -> int:
        """Version of the content; WHOLE before there is any."""
        return self._view.version

    @property
    def time(self) -> float:
        """Simulated time of the content [s]."""
        return self._view.time

    @property
    def robots(self) -> list[SensedRobot]:
        """Where the robots on it are."""
        with self._lock:
            return robots_on(self._view)

    def follow(self, database: RemoteDatabase, history: History) -> bool:
        """Update the content; whether it has changed. Raises UnknownFloor, NotReachable."""
        update = database.changes(self._view.floor, self._view.version)
        with self._lock:
            is_new = update.version != self._view.version
            since = self._view.version if update.since else WHOLE
            self._view.apply(update)
            history.add(self._view, time.monotonic())
            if is_new:
                self._frame, self._since = update_frame(update), since
        return is_new

    def frame_since(self, version: int) -> tuple[int, bytes]:
        """The present version, and the frame that leads a viewer from `version` there; empty if it is there."""
        with self._lock:
            view = self._view
            if version == view.version:
                return version, b""
            if version == self._since != WHOLE:
                return view.version, self._frame
            if self._whole[0] != view.version:
                self._whole = view.version, update_frame(whole_update(view))
            return self._whole


class LiveFloors(Following):
    """All floors of a running system. Thread-safe."""

    def __init__(self, orb: Orb, history: History, changed: Callable[[], None]) -> None:
        # About 20 times a second for floors that somebody watches.
        super().__init__("console floors", 0.045, changed, "connecting")
        self._database = RemoteDatabase(orb, RESOLVE_TIMEOUT_S)
        self._history = history
        self._lock = threading.Lock()
        self._floors: dict[str, LiveFloor] = {}
        self._watched: dict[object, frozenset[str]] = {}
        self._names_at_s = 0.0

    @property
    def names(self) -> list[str]:
        """Names of the floors, the lowest first."""
        with self._lock:
            return list(self._floors)

    def floor(self, name: str) -> LiveFloor:
        """Raises UnknownFloor."""
        with self._lock:
            if name not in self._floors:
                raise UnknownFloor("floor", name, list(self._floors))
            return self._floors[name]

    def robots(self, names: Iterable[str]) -> list[SensedRobot]:
        """The robots on some floors, as far as these are known."""
        with self._lock:
            floors = [self._floors[name] for name in names if name in self._floors]
        return [robot for floor in floors for robot in floor.robots]

    def watch(self, viewer: object, floors: Iterable[str]) -> None:
        """What a viewer watches from now on; nothing: it has left."""
        with self._lock:
            self._watched[viewer] = frozenset(floors)
            if not self._watched[viewer]:
                del self._watched[viewer]

    def _read_news(self) -> bool:
        now_s = time.monotonic()
        try:
            if now_s >= self._names_at_s:
                self._read_names()
                self._names_at_s = now_s + 2.0
            with self._lock:
                watched = frozenset().union(*self._watched.values())
                due = [floor for name, floor in self._floors.items() if name in watched or now_s >= floor.next_s]
            for floor in due:
                floor.next_s = now_s + UNWATCHED_S
                if floor.follow(self._database, self._history):
                    self._changed()  # the others may take a while
        except UnknownFloor:
            self._names_at_s = 0.0  # it was removed from the map
        except NotReachable:
            raise
        except RoboCorbaError:  # a server that was replaced meanwhile
            with self._lock:
                self._floors = {name: LiveFloor(name) for name in self._floors}
            raise
        return False

    def _read_names(self) -> None:
        names = self._database.floors()
        with self._lock:
            if names == list(self._floors):
                return
            self._floors = {name: self._floors.get(name) or LiveFloor(name) for name in names}
        self._changed()

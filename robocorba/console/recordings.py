"""Recordings that users of the console have opened to look at."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from robocorba.console.arguments import NotPossible
from robocorba.console.floor_plan import floor_plan
from robocorba.console.history import History
from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.model import Building
from robocorba.simulation.recording import Recording
from robocorba.system.decoding import Work

#: Maximum number of recordings kept in memory; the oldest one gives way to a new one.
MAX_OPEN = 3
#: Timeout for the opening of a recording [s]: several minutes for one of MAX_RECORDING on a slow machine.
OPENING_LIMIT_S = 600.0


class OpenRecording:
    """A recording in memory. Raises InvalidRecording, and WorkEnded for work that ends before it has been read."""

    def __init__(self, key: str, name: str, path: Path, work: Work) -> None:
        recording = Recording(path, work.check)
        self.key, self.name = key, name
        self.building: Building = recording.building
        self.floors = [floor for floor in recording.building.floors if floor in recording.floors]
        self.history = History.of_recording(recording)

    def plan(self, floor: str) -> dict[str, Any]:
        """The map of a floor as it was recorded, for the browser. Raises UnknownFloor."""
        if floor not in self.building.floors:
            raise UnknownFloor("floor", floor, self.floors)
        return floor_plan(self.building, floor)

    def row(self) -> dict[str, Any]:
        """`key`, `name`, `floors`, `past`: POSIX times of the first and the last moment [s]."""
        return {"key": self.key, "name": self.name, "floors": self.floors, "past": list(self.history.span())}


class Recordings:
    """The open recordings by key. Thread-safe."""

    def __init__(self) -> None:
        self._lock, self._opening = threading.Lock(), threading.Lock()
        self._open: dict[str, OpenRecording] = {}
        self._count = 0

    def open(self, path: Path, name: str, work: Work | None = None) -> OpenRecording:
        """Read a recording, under this name; one at a time, since each takes a core and much memory meanwhile.

        work: by default of OPENING_LIMIT_S from now on. Raises InvalidRecording, WorkEnded, and NotPossible while
        another one is read."""
        if not self._opening.acquire(blocking=False):
            raise NotPossible("another recording is being opened; try again when it is open")
        try:
            with self._lock:
                self._count += 1
                key = f"recording {self._count}"
            opened = OpenRecording(key, name[:80], path, work or Work(OPENING_LIMIT_S))
            with self._lock:
                self._open[key] = opened
                while len(self._open) > MAX_OPEN:
                    del self._open[next(iter(self._open))]
            return opened
        finally:
            self._opening.release()

    def get(self, key: str) -> OpenRecording:
        """Raises NotPossible."""
        with self._lock:
            if key not in self._open:
                raise NotPossible("this recording is not open any more; open its file again")
            return self._open[key]

    def rows(self) -> list[dict[str, Any]]:
        with self._lock:
            return [opened.row() for opened in self._open.values()]

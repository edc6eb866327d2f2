"""The past on disk: recordings of the last half hour in the state folder, which outlive the console's process."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from robocorba.console.happenings import Happening, Happenings
from robocorba.console.history import KEPT_S, History, Moment
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.floor_update import WHOLE, FloorView
from robocorba.simulation.recording import Recorder, Recording
from robocorba.system import sqlite_files
from robocorba.system.decoding import decode_json
from robocorba.system.repeating import Repeating

_log = logging.getLogger(__name__)


class PastFiles(Repeating):
    """Writes what is new in `history` and `happenings` each second, after it has put before them what an earlier
    process wrote. One process at a time uses `folder`; others keep the past in memory only. Thread-safe.

    building: returns the map, without floors until it is known. max_bytes: of all files; one has an eighth of it, and
    five minutes. problem: why nothing is written, empty if something is. size: of all files [bytes]."""

    def __init__(
        self,
        folder: Path,
        history: History,
        happenings: Happenings,
        building: Callable[[], Building],
        max_bytes: int = 256 * 2**20,
    ) -> None:
        super().__init__("console past", self.keep, 1.0)  # a killed console loses no more than a second
        self._folder, self._building, self._max_bytes = folder, building, max_bytes
        self._history, self._happenings = history, happenings
        self.problem, self.size = "", 0
        self._lock: int | None = None
        self._recorder: Recorder | None = None
        self._retry_s = self._began_s = 0.0
        #: Time of the last moment, and of anything, in the files, by the clock of the history [s]; the last event.
        self._written_s, self._lasts_s, self._noted = float("-inf"), 0.0, 0
        #: The last moment of each floor, and its version in the file that is written.
        self._last: dict[str, Moment] = {}
        self._versions: dict[str, int] = {}
        happenings.is_held = True

    def keep(self) -> None:
        """Write what is new, and remove what is old."""
        now_s = time.monotonic()
        if now_s < self._retry_s:
            return
        try:
            self._claim()
            self._write(now_s)
            self._remove_old()
            self.problem = ""
        except (RoboCorbaError, OSError) as error:
            if not self.problem:
                _log.warning("the past is in memory only: %s", error)
            self.problem, self._retry_s = str(error), now_s + 60.0
            self._end_file(error)
        finally:
            self._happenings.is_held = False

    def close(self) -> None:
        super().close()
        self._end_file()
        if self._lock is not None:
            os.close(self._lock)

    def _claim(self) -> None:
        """Lock the folder and read what is in it, unless another process has written in it since this one began."""
        if self._lock is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._lock = sqlite_files.lock(self._folder / "past")
            if not self.problem:
                self._read()

    def _read(self) -> None:
        epoch, now_s = self._history.epoch(), time.monotonic()
        older, noted = History(epoch=self._history.epoch), list[Happening]()
        last_s = begin_s = now_s - KEPT_S
        for file in self._files():
            with contextlib.suppress(RoboCorbaError, msgspec.MsgspecError):  # such as one that was killed at its begin
                recording, floors = Recording(file, cut=True), dict[str, FloorView]()
                began_s = recording.began - epoch
                if begin_s < last_s < began_s - 0.01 < now_s:  # times are rounded
                    older.interrupt(last_s, began_s)
                for after_s, update in recording.updates():
                    at_s = began_s + after_s
                    if update.floor not in floors:
                        floors[update.floor] = FloorView(update.floor)
                    floors[update.floor].apply(update)
                    if last_s - 0.01 <= at_s <= now_s:  # otherwise it is too old, or the clock was set
                        older.add(floors[update.floor], at_s)
                        last_s = max(last_s, at_s)
                for at, data in recording.happenings():
                    noted.append(decode_json(data, Happening)._replace(at=at - epoch))
        if last_s > begin_s:
            own = self._history.after(float("-inf"))
            older.interrupt(last_s, own[0][1].at if own else now_s)
            self._history.precede(older)
            self._written_s = last_s
        self._happenings.restore([each for each in noted if begin_s <= each.at <= now_s])
        self._noted = self._happenings.last

    def _write(self, now_s: float) -> None:
        moments, happenings = self._history.after(self._written_s), self._happenings.after(self._noted)
        if self._recorder and (now_s > self._began_s + 300.0 or self._recorder.size > self._max_bytes / 8):
            self._end_file()
        if not self._recorder:
            building = self._building()
            if not building.floors or not (moments or self._last):
                return  # nobody has seen a map and a floor so far
            number = max((int(file.stem) for file in self._files()), default=0) + 1
            self._recorder = Recorder(self._folder / f"{number:06}.mcap", building).__enter__()
            self._began_s = now_s
            for floor, moment in self._last.items():
                self._add(floor, moment, self._lasts_s)
        for floor, moment in moments:
            self._add(floor, moment, moment.at)
            self._last[floor], self._written_s = moment, moment.at
        if not moments:  # so that the file lasts as long as the console lives
            floor, moment = next(iter(self._last.items()))
            self._add(floor, moment, now_s)
        epoch = self._history.epoch()
        for each in happenings:
            self._recorder.write_happening(msgspec.json.encode(each), each.at + epoch)
            self._noted = each.number
        self._recorder.flush()

    def _add(self, floor: str, moment: Moment, at_s: float) -> None:
        """Write a floor: what has moved, or all of it where bodies or elevators are others."""
        assert self._recorder
        since, last = self._versions.get(floor, WHOLE), self._last.get(floor)
        update = moment.update(floor, since + 1)
        if since and last and last.bodies is moment.bodies and last.elevators is moment.elevators:
            moved = update.motions[moment.rows != last.rows]
            update = update._replace(since=since, came=[], motions=moved, elevators={})
        self._recorder.write(update, at_s + self._history.epoch())
        self._versions[floor], self._lasts_s = since + 1, at_s

    def _remove_old(self) -> None:
        size = 0
        for file in reversed(self._files()):
            found = file.stat()
            size += found.st_size
            if size > self._max_bytes or found.st_mtime < time.time() - KEPT_S:
                file.unlink()
            else:
                self.size = size

    def _end_file(self, error: Exception | None = None) -> None:
        if self._recorder:
            with contextlib.suppress(RoboCorbaError):
                self._recorder.__exit__(type(error) if error else None, error, None)
        self._recorder = None
        self._versions.clear()

    def _files(self) -> list[Path]:
        """The recordings in the folder, the oldest first."""
        return sorted(self._folder.glob("[0-9]" * 6 + ".mcap"))

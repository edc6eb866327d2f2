"""Operations of the monitor page: what has happened, films and recordings."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from robocorba.console.arguments import NotPossible
from robocorba.console.films import Films
from robocorba.console.history import History
from robocorba.console.monitor_state import MonitorState
from robocorba.console.past_files import PastFiles
from robocorba.console.recordings import Recordings
from robocorba.map_editor.model import Building


class MonitorOperations:
    """What has happened, films and recordings.

    building: returns the map of the running system."""

    def __init__(
        self,
        state: MonitorState,
        history: History,
        building: Callable[[], Building],
        recordings: Recordings,
        films: Films,
        past: PastFiles | None = None,
    ) -> None:
        self._state, self._history, self._building = state, history, building
        self._recordings, self._films, self._past = recordings, films, past

    def forget_robot(self, robot: str) -> None:
        """Take a robot that has left from the table."""
        self._state.forget(robot)

    def happenings(self, after: int = 0) -> list[dict[str, Any]]:
        """What has happened, with a higher number than `after`, the oldest first: `number`, `at` (POSIX time [s]),
        `kind`, `robot`, `floor` and `text`."""
        epoch = self._history.epoch()
        return [{**each._asdict(), "at": each.at + epoch} for each in self._state.happenings.after(after)]

    def past_on_disk(self) -> dict[str, Any]:
        """`mib`: size of the past on disk [MiB]; `problem`: why it is kept in memory only, empty if it is not."""
        return {"mib": self._past.size / 2**20, "problem": self._past.problem} if self._past else {}

    def recordings(self) -> list[dict[str, Any]]:
        """Open recordings: `key`, `name`, `floors` and `past`, POSIX times of their first and last moment [s]."""
        return self._recordings.rows()

    def start_film(self, floor: str, begin: float, end: float, speed: float = 1.0, recording: str = "") -> int:
        """Make a film of a floor between two POSIX times [s], of an open recording or of the last half hour; its
        number."""
        opened = self._recordings.get(recording) if recording else None
        history, building = (opened.history, opened.building) if opened else (self._history, self._building())
        if floor not in building.floors:
            raise NotPossible("the map is not known yet: try again when its server answers")
        end = min(end, history.span()[1] if opened else time.time())
        if not begin < end:
            raise NotPossible("the film's end is not after its begin")
        return self._films.start(building, floor, history.between(floor, begin, end), end, speed)

    def film_state(self, film: int) -> dict[str, Any]:
        """`phase` of a film: making, ready (then GET /film/NUMBER has it) or failed; `seconds`; `problem`."""
        return self._films.state(film)

    def cancel_film(self, film: int) -> None:
        """End the making of a film."""
        self._films.cancel(film)

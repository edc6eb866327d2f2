"""Films of what happened on a floor: a span of the history is recorded to a file, which `robocorba replay` films."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from robocorba.console.arguments import NotPossible
from robocorba.console.defects import DEFECT
from robocorba.console.history import Moment
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building
from robocorba.simulation.recording import Recorder
from robocorba.system.background import Background
from robocorba.system.supervision.launch import bound_command, module_command

_log = logging.getLogger(__name__)

#: Pictures per second of a film, and the most that one may have.
FPS, MAX_PICTURES = 10, 6000
#: Bounds of the speed of a film, relative to what happened.
MIN_SPEED, MAX_SPEED = 0.1, 100.0
#: Timeout for the making of a film [s].
LIMIT_S = 900.0


class Films:
    """Makes one film at a time, in a process of its own; `close` ends it. Thread-safe."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="robocorba-films-")
        self._lock = threading.Lock()
        self._films: dict[int, _Film] = {}
        self._count = 0

    def start(self, building: Building, floor: str, moments: Sequence[Moment], end_s: float, speed: float) -> int:
        """Begin a film of these moments of a floor, up to POSIX time `end_s` [s]; its number.

        Raises NotPossible for an impossible speed or span, and while another one is being made."""
        if not MIN_SPEED <= speed <= MAX_SPEED:
            raise NotPossible(f"speed {speed:g} is not {MIN_SPEED:g} to {MAX_SPEED:g}")
        span_s = end_s - moments[0].at
        if span_s <= 0.0:
            raise NotPossible("the film's end is not after its first moment")
        pictures = span_s / speed * FPS
        if pictures > MAX_PICTURES:
            least = span_s * FPS / MAX_PICTURES
            raise NotPossible(f"{span_s:.0f} s are too long for a film at speed {speed:g}: choose {least:.0f} or more")
        with self._lock:
            if any(film.is_under_way for film in self._films.values()):
                raise NotPossible("another film is being made: wait for it, or cancel it")
            self._count += 1
            file = Path(self._folder.name) / str(self._count)
            options = {"--floor": floor, "--speed": str(speed)}
            film = _Film(file, lambda path: record(path, building, floor, moments, end_s), options)
            self._films[self._count] = film
            for number in list(self._films)[:-3]:  # the last ones are kept for download
                self._films.pop(number).remove()
            film.start()
            return self._count

    def state(self, number: int) -> dict[str, Any]:
        """`phase`: making, ready or failed; `seconds` since its begin; `problem`. Raises NotPossible."""
        film = self._film(number)
        return {"phase": film.phase, "seconds": film.seconds, "problem": film.problem}

    def cancel(self, number: int) -> None:
        """End the making of a film. Raises NotPossible."""
        self._film(number).cancel()

    def file(self, number: int) -> Path:
        """The MP4 file of a film that is ready. Raises NotPossible."""
        film = self._film(number)
        if film.phase != "ready":
            raise NotPossible("the film is not ready")
        return film.video

    def close(self) -> None:
        with self._lock:
            for film in self._films.values():
                film.cancel()
        self._folder.cleanup()

    def _film(self, number: int) -> _Film:
        with self._lock:
            if number not in self._films:
                raise NotPossible("this film is not kept any more: make it again")
            return self._films[number]


class _Film:
    """A film and the process that makes it. file: without suffix. write: writes the recording that `replay` films, with
    these options."""

    def __init__(self, file: Path, write: Callable[[Path], None], options: Mapping[str, str]) -> None:
        self.recording, self.video = file.with_suffix(".mcap"), file.with_suffix(".mp4")
        self._write, self._options = write, options
        self.phase, self.problem = "making", ""
        self._began_s, self._ended_s = time.monotonic(), 0.0
        self._is_cancelled = threading.Event()
        # `_make` shows the problem.
        self._thread = Background("console film", self._make, lambda reason: None)

    @property
    def is_under_way(self) -> bool:
        return self.phase == "making"

    @property
    def seconds(self) -> float:
        return (self._ended_s or time.monotonic()) - self._began_s

    def start(self) -> None:
        self._thread.start()

    def cancel(self) -> None:
        self._is_cancelled.set()
        self._thread.join(5.0)

    def remove(self) -> None:
        for file in (self.recording, self.video):
            file.unlink(missing_ok=True)

    def _make(self) -> None:
        problem = DEFECT
        options = {"--video": str(self.video), "--fps": str(FPS), "--width": "1280", **self._options}
        try:
            self._write(self.recording)
            problem = self._run(["replay", str(self.recording), *itertools.chain.from_iterable(options.items())])
        except (RoboCorbaError, OSError) as error:
            problem = str(error)
        finally:
            self.recording.unlink(missing_ok=True)
            self._ended_s = time.monotonic()
            self.problem = problem
            self.phase = "failed" if problem else "ready"

    def _run(self, arguments: Sequence[str]) -> str:
        """Run a command; why it failed, or an empty text."""
        command = bound_command(*module_command("robocorba", *arguments))
        with (
            tempfile.TemporaryFile() as output,
            subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output) as process,
        ):
            with contextlib.suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, process.pid, 10)  # a low one, so that live views go on
            while process.poll() is None:
                if self._is_cancelled.wait(0.1) or self.seconds > LIMIT_S:
                    process.kill()
                    return "cancelled" if self._is_cancelled.is_set() else f"not ready within {LIMIT_S:.0f} s"
            if process.returncode == 0:
                return ""
            output.seek(0)
            lines = output.read().decode(errors="replace").strip().splitlines()
            return lines[-1][:300] if lines else f"ended with exit code {process.returncode}"


def record(path: Path, building: Building, floor: str, moments: Sequence[Moment], end_s: float) -> None:
    """Write moments of a floor as a recording, whose last one lasts until POSIX time `end_s` [s].

    Raises InvalidRecording."""
    with Recorder(path, building, overwrite=True) as recorder:
        for version, moment in enumerate(moments, start=1):
            recorder.write(moment.update(floor, version), moment.at)
        last = moments[-1]
        if end_s > last.at:
            recorder.write(last.update(floor, len(moments) + 1), end_s)

"""What happened on the floors during the last half hour, or in a recording: to look back and scrub."""

from __future__ import annotations

import bisect
import itertools
import threading
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from robocorba.console.frames import ROW, Rows, update_frame, with_fields
from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, Body, FloorUpdate, FloorView, memory_of
from robocorba.simulation.recording import Recording

#: Age beyond which moments are forgotten [s].
KEPT_S = 1800.0
#: Shortest interval between the moments of a floor [s].
INTERVAL_S = 0.2
#: Memory of a moment beside its rows, bodies and elevators [bytes], as tracemalloc measured it: numbers, a tuple, the
#: head of an array.
MOMENT_BYTES = 300


class Moment(NamedTuple):
    """A floor at one time. at: POSIX time [s]. time: simulated [s]. rows: of frames.ROW, one for each body."""

    at: float
    time: float
    map_version: int
    bodies: tuple[Body, ...]
    elevators: Mapping[str, ElevatorState]
    rows: Rows

    def update(self, floor: str, version: int = 1) -> FloorUpdate:
        """The whole floor at this time, as a version of it."""
        bodies, motions, elevators = list(self.bodies), with_fields(MOTION, self.rows), dict(self.elevators)
        return FloorUpdate(floor, WHOLE, version, self.time, self.map_version, bodies, [], motions, elevators)


class History:
    """Moments of floors in the order of their times. Thread-safe.

    max_bytes: of memory of all moments; beyond, the oldest moments of the fullest floor are forgotten.

    epoch: when the clock by which moments are added was 0, by the system's clock now [s since 1970]. So what has
    happened stays in its order, and as long ago as it is, when the system's clock is set."""

    def __init__(
        self, kept_s: float = KEPT_S, max_bytes: int = 256 * 1024 * 1024, epoch: Callable[[], float] = lambda: 0.0
    ) -> None:
        self._kept_s, self._max_bytes, self.epoch = kept_s, max_bytes, epoch
        self._lock = threading.Lock()
        self._moments: dict[str, list[Moment]] = {}
        #: Begin and end of times of which nothing is known, by the clock of `add` [s].
        self._gaps: list[tuple[float, float]] = []
        self._bytes = 0

    @classmethod
    def of_recording(cls, recording: Recording) -> History:
        """The whole recording. Raises InvalidRecording, and what the recording's `check` raises."""
        history = cls(kept_s=float("inf"))
        for at_s, views in recording.sampled(INTERVAL_S, only_changed=True):
            for view in views.values():
                history.add(view, recording.began + at_s)
        return history

    @property
    def floors(self) -> list[str]:
        with self._lock:
            return list(self._moments)

    def add(self, view: FloorView, at_s: float) -> None:
        """Remember a floor as it is at `at_s` after the epoch [s], unless it is unchanged, or INTERVAL_S have not
        passed."""
        with self._lock:
            moments = self._moments.setdefault(view.floor, [])
            last = moments[-1] if moments else None
            if last and 0.0 <= at_s - last.at < INTERVAL_S * 0.99:
                return
            bodies: tuple[Body, ...] = tuple(view.bodies.values())
            elevators: Mapping[str, ElevatorState] = dict(view.elevators)
            rows = with_fields(ROW, view.motions)
            if last:
                is_same = bodies == last.bodies, elevators == last.elevators, np.array_equal(rows, last.rows)
                if all(is_same):
                    return
                bodies, elevators = (
                    (last.bodies if is_same[0] else bodies),
                    (last.elevators if is_same[1] else elevators),
                )
            moment = Moment(at_s, view.time, view.map_version, bodies, elevators, rows)
            moments.append(moment)
            self._bytes += _memory(moment, last)
            self._forget(at_s)

    def interrupt(self, begin_s: float, end_s: float) -> None:
        """Nothing is known between two times by the clock of `add` [s]: floors are empty then."""
        with self._lock:
            self._gaps.append((begin_s, end_s))
            for moments in filter(None, self._moments.values()):
                empty = Moment(begin_s, moments[-1].time, moments[-1].map_version, (), {}, moments[-1].rows[:0])
                moments.append(empty)
                self._bytes += _memory(empty, None)

    def precede(self, older: History) -> None:
        """Put all that another one has, whose clock is the same, before this one."""
        with self._lock:
            self._gaps = older._gaps + self._gaps
            for floor, moments in older._moments.items():
                self._moments[floor] = moments + self._moments.get(floor, [])
            self._bytes += older._bytes
            self._forget(max(moments[-1].at for moments in self._moments.values() if moments))

    def rename(self, names: Mapping[str, str]) -> None:
        """Floors have other names now, by those that they had; their past has these, too."""
        with self._lock:
            former, self._moments = self._moments, {}
            for floor, moments in former.items():
                self._moments.setdefault(names.get(floor, floor), []).extend(moments)
            for moments in self._moments.values():  # some were added by the new name already
                moments.sort(key=lambda moment: moment.at)

    def gaps(self) -> list[tuple[float, float]]:
        """POSIX times between which nothing is known [s]."""
        epoch = self.epoch()
        return [(begin_s + epoch, end_s + epoch) for begin_s, end_s in self._gaps]

    def after(self, at_s: float) -> list[tuple[str, Moment]]:
        """Moments after a time by the clock of `add` [s], each with its floor, in their order."""
        with self._lock:
            found = [
                (floor, moment)
                for floor, moments in self._moments.items()
                for moment in moments[bisect.bisect_right(moments, at_s, key=lambda moment: moment.at) :]
            ]
        return sorted(found, key=lambda each: each[1].at)

    def span(self) -> tuple[float, float]:
        """POSIX times of the first and the last moment [s]; (0, 0) if there is none."""
        with self._lock:
            kept = [moments for moments in self._moments.values() if moments]
            if not kept:
                return 0.0, 0.0
            first, last = min(moments[0].at for moments in kept), max(moments[-1].at for moments in kept)
        return first + self.epoch(), last + self.epoch()

    def at(self, floor: str, at_s: float) -> Moment:
        """The last moment of a floor at POSIX time `at_s` [s], or the first after it. Raises UnknownFloor."""
        epoch = self.epoch()
        with self._lock:
            moments = self._moments.get(floor)
            if not moments:
                raise UnknownFloor("floor", floor, [name for name, kept in self._moments.items() if kept])
            moment = moments[max(0, bisect.bisect_right(moments, at_s - epoch, key=lambda moment: moment.at) - 1)]
        return moment._replace(at=moment.at + epoch)

    def between(self, floor: str, begin_s: float, end_s: float) -> list[Moment]:
        """Moments of a floor in a span of POSIX times [s], with the state at `begin_s` as the first one.

        Raises UnknownFloor."""
        first, epoch = self.at(floor, begin_s), self.epoch()
        first = first._replace(at=max(first.at, begin_s))
        with self._lock:
            moments = list(self._moments[floor])
        return [first] + [
            moment._replace(at=moment.at + epoch) for moment in moments if first.at < moment.at + epoch <= end_s
        ]

    def frame(self, floor: str, at_s: float) -> bytes:
        """The frame of a floor at POSIX time `at_s` [s]. Raises UnknownFloor."""
        return update_frame(self.at(floor, at_s).update(floor))

    def _forget(self, now_s: float) -> None:
        self._gaps = [gap for gap in self._gaps if gap[1] > now_s - self._kept_s]
        for moments in self._moments.values():
            old = bisect.bisect_left(moments, now_s - self._kept_s, key=lambda moment: moment.at)
            self._drop(moments, old)
        while self._bytes > self._max_bytes:
            longest = max(self._moments.values(), key=len)
            self._drop(longest, max(1, len(longest) // 10))

    def _drop(self, moments: list[Moment], count: int) -> None:
        for moment, following in itertools.zip_longest(moments[:count], moments[1 : count + 1]):
            self._bytes -= _memory(moment, following)
        del moments[:count]


def _memory(moment: Moment, neighbour: Moment | None) -> int:
    """Memory of a moment without what it shares with its neighbour [bytes]."""
    bodies = () if neighbour and moment.bodies is neighbour.bodies else moment.bodies
    elevators = {} if neighbour and moment.elevators is neighbour.elevators else moment.elevators
    return MOMENT_BYTES + moment.rows.nbytes + memory_of(bodies, elevators)

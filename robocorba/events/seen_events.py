"""Which events a channel has seen, by which it recognises duplicates.

A channel gets events of one origin over several paths, and a new path may be quicker than the queue of an earlier one.
So what was seen is remembered exactly: for each life of each origin, as intervals of counts. Where events come in order
and all of them are wanted that is a single interval. The intervals are in a memory-mapped file, so that they survive a
kill of the process.
"""

from __future__ import annotations

import logging
import mmap
import os
import struct
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from robocorba.errors.services import ServiceError
from robocorba.events.event_numbers import COUNT_BITS, count_of, life_of
from robocorba.system.damaged_files import set_aside

#: Maximum number of lives of all origins together; beyond that the least recently used one is forgotten.
MAX_LIVES = 512
#: Maximum number of intervals of a life. Beyond that the oldest gap is closed: nobody can tell any more whether the
#: events in it were seen.
MAX_INTERVALS = 2048

_MAGIC = b"RoboCorba seen 2"
#: Origin, life, horizon, time of the last use.
_HEAD = struct.Struct("<64sIIQ")
#: First count and number of counts, 0 for an unused entry.
_INTERVAL = struct.Struct("<II")

_log = logging.getLogger(__name__)


@dataclass(slots=True, eq=False)
class _Life:
    """What was seen of one life. firsts, ends: its intervals in order, without the ends. places: their entries in the
    file. horizon: counts below it are known no more."""

    place: int
    origin: str
    number: int
    horizon: int = 0
    used: int = 0
    firsts: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    places: list[int] = field(default_factory=list)
    free: list[int] = field(default_factory=lambda: list(range(MAX_INTERVALS - 1, -1, -1)))


class SeenEvents:
    """Guarded by the channel's lock. Raises ServiceError if the file cannot be used."""

    def __init__(self, file: Path) -> None:
        size = _life_at(MAX_LIVES)
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
            try:
                magic = os.pread(descriptor, len(_MAGIC), 0)
                if magic and magic != _MAGIC:
                    self._discard(file, descriptor)
                os.posix_fallocate(descriptor, 0, size)  # a hole would end the process by SIGBUS on a full disk
                self._map = mmap.mmap(descriptor, size)
            finally:
                os.close(descriptor)
        except (OSError, ValueError) as error:
            raise ServiceError(f"cannot use {file}: {error}") from None
        self._map[: len(_MAGIC)] = _MAGIC
        self._lives: dict[tuple[str, int], _Life] = {}
        #: Counts the changes of the life in use.
        self._clock = 1
        damaged = [place for place in range(MAX_LIVES) if not self._read(place)]
        if damaged:
            self._forget(damaged, file)

    @staticmethod
    def _discard(file: Path, descriptor: int) -> None:
        """Empty a file of release 0.1.0, which held the last number of each origin: no peer uses such numbers again. Or
        a damaged one."""
        if os.fstat(descriptor).st_size != 256 * 216:
            set_aside(file, "its beginning", "events that arrive again are taken for new", copy=True)
        os.ftruncate(descriptor, 0)

    def _read(self, place: int) -> bool:
        """Read an entry. False if it is damaged."""
        start = _life_at(place)
        name, number, horizon, used = _HEAD.unpack_from(self._map, start)
        if not number and not horizon and not used and not name.strip(b"\0"):
            return True
        try:
            key = (name.rstrip(b"\0").decode(), number)
        except UnicodeDecodeError:
            return False
        if not key[0] or key in self._lives:
            return False
        life = _Life(place, *key, horizon, used)
        body = self._map[start + _HEAD.size : _life_at(place + 1)]
        entries = enumerate(_INTERVAL.iter_unpack(body))
        for first, end, entry in sorted((first, first + count, entry) for entry, (first, count) in entries if count):
            if life.ends and first <= life.ends[-1]:  # killed while two became one
                life.ends[-1] = max(end, life.ends[-1])
                self._write(life, -1)
                self._write_entry(life, entry, 0, 0)
            else:
                life.firsts.append(first)
                life.ends.append(end)
                life.places.append(entry)
        life.free = sorted(set(range(MAX_INTERVALS)) - set(life.places), reverse=True)
        self._lives[key] = life
        self._clock = max(self._clock, used)
        return True

    def _forget(self, places: list[int], file: Path) -> None:
        try:
            events = f"events of up to {len(places)} channels that arrive again are taken for new"
            set_aside(file, f"{len(places)} of its entries", events, copy=True)
        except OSError as error:
            _log.warning("%s has damaged entries, which are dropped (%s)", file, error)
        for place in places:
            self._clear(place)

    def __enter__(self) -> SeenEvents:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._map.close()

    def has_seen(self, origin: str, number: int) -> bool:
        """Whether an event was seen, or may have been."""
        life = self._lives.get((origin, life_of(number)))
        if life is None:
            return False
        count = count_of(number)
        at = bisect_right(life.firsts, count) - 1
        return count < life.horizon or (at >= 0 and count < life.ends[at])

    def add(self, origin: str, first: int, last: int) -> tuple[list[tuple[int, int]], int]:
        """Record that the events `first` to `last` were seen.

        Returns the parts of them that are new, each by its first and last number; and the number of events so old that
        the channel cannot tell whether it has seen them, which must not be delivered. The others are duplicates."""
        if life_of(first) != life_of(last):
            border = life_of(last) << COUNT_BITS
            (before, late), (after, later) = self.add(origin, first, border - 1), self.add(origin, border, last)
            return before + after, late + later
        key = (origin, life_of(first))
        life = self._lives.get(key) or self._new_life(key)
        if life.used != self._clock:
            self._clock = life.used = self._clock + 1
            self._write_head(life)
        count, end = count_of(first), count_of(last) + 1
        ends = life.ends
        if ends and count >= ends[-1]:  # as nearly always
            if count == ends[-1]:
                ends[-1] = end
                self._write(life, -1)
            else:
                self._insert_apart(life, len(ends), count, end)
            return [(first, last)], 0
        base = first - count
        late = max(0, min(end, life.horizon) - count)
        parts = list(_gaps(life, max(count, life.horizon), end))
        for start, stop in parts:
            self._insert(life, start, stop)
        return [(base + start, base + stop - 1) for start, stop in parts], late

    def _insert(self, life: _Life, first: int, end: int) -> None:
        """Add an interval that overlaps none."""
        firsts, ends = life.firsts, life.ends
        at = bisect_right(firsts, first)
        joins_before = at > 0 and ends[at - 1] == first
        joins_after = at < len(firsts) and firsts[at] == end
        if joins_before:
            ends[at - 1] = ends[at] if joins_after else end
            self._write(life, at - 1)
            if joins_after:
                self._remove(life, at)
        elif joins_after:
            firsts[at] = first
            self._write(life, at)
        else:
            self._insert_apart(life, at, first, end)

    def _insert_apart(self, life: _Life, at: int, first: int, end: int) -> None:
        """Add an interval that touches none, with index `at`."""
        if not life.free:
            self._close_gap(life)
            at -= 1
        if first >= life.horizon:
            life.firsts.insert(at, first)
            life.ends.insert(at, end)
            life.places.insert(at, life.free.pop())
            self._write(life, at)

    def _close_gap(self, life: _Life) -> None:
        """Forget the oldest gap."""
        life.horizon = life.ends[0] = life.ends[1]
        self._write_head(life)
        self._write(life, 0)
        self._remove(life, 1)

    def _remove(self, life: _Life, at: int) -> None:
        """Remove an interval that the one before has taken up."""
        del life.firsts[at], life.ends[at]
        place = life.places.pop(at)
        self._write_entry(life, place, 0, 0)
        life.free.append(place)

    def _new_life(self, key: tuple[str, int]) -> _Life:
        if len(self._lives) < MAX_LIVES:
            place = min(set(range(MAX_LIVES)) - {life.place for life in self._lives.values()})
        else:
            oldest = min(self._lives, key=lambda key: self._lives[key].used)
            _log.warning("events of %s that arrive again are taken for new: there are too many origins", oldest[0])
            place = self._lives.pop(oldest).place
        self._clear(place)
        life = self._lives[key] = _Life(place, *key)
        self._write_head(life)
        return life

    # ---- the file ----

    def _write_head(self, life: _Life) -> None:
        # Not by pack_into, which clears all bytes first: a process may be killed in between.
        start = _life_at(life.place)
        self._map[start : start + _HEAD.size] = _HEAD.pack(life.origin.encode(), life.number, life.horizon, life.used)

    def _write(self, life: _Life, at: int) -> None:
        """Write the interval with index `at`."""
        first, end = life.firsts[at], life.ends[at]
        self._write_entry(life, life.places[at], first, end - first)

    def _write_entry(self, life: _Life, place: int, first: int, count: int) -> None:
        at = _life_at(life.place) + _HEAD.size + place * _INTERVAL.size
        self._map[at : at + _INTERVAL.size] = _INTERVAL.pack(first, count)

    def _clear(self, place: int) -> None:
        start, end = _life_at(place), _life_at(place + 1)
        self._map[start:end] = bytes(end - start)


def _life_at(place: int) -> int:
    return len(_MAGIC) + place * (_HEAD.size + MAX_INTERVALS * _INTERVAL.size)


def _gaps(life: _Life, first: int, end: int) -> Iterator[tuple[int, int]]:
    """The parts of `first` to before `end` that no interval covers."""
    at = max(0, bisect_right(life.firsts, first) - 1)
    while first < end and at < len(life.firsts):
        if first < life.firsts[at]:
            yield first, min(end, life.firsts[at])
        first = max(first, life.ends[at])
        at += 1
    if first < end:
        yield first, end

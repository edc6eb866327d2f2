"""The number of the last event seen from each channel, by which a channel recognises duplicates.

Event numbers of an origin only rise, and every path through the federation keeps their order. So an event is new
exactly if its number is higher than the last one seen from its origin. The numbers are in a memory-mapped file, so
that they survive a kill of the process.
"""

from __future__ import annotations

import logging
import mmap
import os
import struct
import time
from pathlib import Path
from types import TracebackType

from robocorba.damaged_files import set_aside
from robocorba.errors.services import ServiceError
from robocorba.events.event_numbers import is_damaged

#: Maximum number of origins; beyond that the least recently used one is dropped.
MAX_ORIGINS = 256
_NAME = 200
_ENTRY = struct.Struct(f"<QQ{_NAME}s")
_NUMBER = struct.Struct("<QQ")

_log = logging.getLogger(__name__)


class Watermarks:
    """Guarded by the channel's lock. Raises ServiceError if the file cannot be used."""

    def __init__(self, file: Path) -> None:
        size = MAX_ORIGINS * _ENTRY.size
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
            try:
                os.posix_fallocate(descriptor, 0, size)  # a hole would end the process by SIGBUS on a full disk
                self._map = mmap.mmap(descriptor, size)
            finally:
                os.close(descriptor)
        except (OSError, ValueError) as error:
            raise ServiceError(f"cannot use {file}: {error}") from None
        self._last: dict[str, int] = {}
        self._slots: dict[str, int] = {}
        self._used: dict[str, int] = {}
        self._clock = 0
        damaged = [slot for slot in range(MAX_ORIGINS) if not self._read(slot)]
        if damaged:
            self._forget(damaged, file)

    def _read(self, slot: int) -> bool:
        """Read an entry. False if it is damaged."""
        number, used, name = _ENTRY.unpack_from(self._map, slot * _ENTRY.size)
        if not number and not used and not name.strip(b"\0"):
            return True
        try:
            origin = name.rstrip(b"\0").decode()
        except UnicodeDecodeError:
            return False
        if not origin or origin in self._slots or is_damaged(number, time.time()):
            return False
        self._last[origin], self._slots[origin], self._used[origin] = number, slot, used
        self._clock = max(self._clock, used)
        return True

    def _forget(self, slots: list[int], file: Path) -> None:
        try:
            events = f"events of up to {len(slots)} channels that arrive again are taken for new"
            set_aside(file, f"{len(slots)} of its entries", events, copy=True)
        except OSError as error:
            _log.warning("%s has damaged entries, which are dropped (%s)", file, error)
        for slot in slots:
            _ENTRY.pack_into(self._map, slot * _ENTRY.size, 0, 0, b"")

    def __enter__(self) -> Watermarks:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._map.close()

    def last(self, origin: str) -> int:
        """The highest number seen from a channel, 0 for none."""
        return self._last.get(origin, 0)

    def raise_to(self, origin: str, number: int) -> None:
        """Record that the events of a channel up to `number` were seen."""
        slot = self._slots.get(origin)
        if slot is None:
            slot = self._new_slot(origin)
        self._clock += 1
        self._last[origin], self._used[origin] = number, self._clock
        _NUMBER.pack_into(self._map, slot * _ENTRY.size, number, self._clock)

    def _new_slot(self, origin: str) -> int:
        if len(self._slots) < MAX_ORIGINS:
            slot = min(set(range(MAX_ORIGINS)) - set(self._slots.values()))
        else:
            oldest = min(self._used, key=self._used.__getitem__)
            slot = self._slots.pop(oldest)
            del self._last[oldest], self._used[oldest]
        _ENTRY.pack_into(self._map, slot * _ENTRY.size, 0, 0, origin.encode()[:_NAME])
        self._slots[origin] = slot
        return slot

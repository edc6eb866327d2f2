"""Writes the state of the simulation to the store in a thread of its own, so that steps do not wait for the disk."""

from __future__ import annotations

import logging
import threading

from robocorba.background import Background, end_process
from robocorba.errors.services import ServiceError
from robocorba.simulation.store import SimulationStore
from robocorba.simulation.world_record import WorldRecord

#: Timeout of a call that waits until its change is on disk [s].
WRITE_LIMIT_S = 5.0
_log = logging.getLogger(__name__)


class StateWriter:
    """Writes to `store`. The simulation thread calls `submit` and `forget`, which do not block."""

    def __init__(self, store: SimulationStore) -> None:
        self._store = store
        self._changed = threading.Condition()
        self._world: WorldRecord | None = None
        self._forgotten: list[str] = []
        self._number = self._written = 0
        self._problem: ServiceError | None = None
        self._is_closing = False
        self._thread = Background("state-writer", self._run, end_process)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Write pending state, and end the thread."""
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.wait_for_end()
        else:
            self._write()

    def submit(self, world: WorldRecord) -> int:
        """Queue a record for writing, in place of an older one that is pending; return a number for `wait`."""
        with self._changed:
            self._world = world
            self._number += 1
            self._changed.notify_all()
            return self._number

    def forget(self, key: str) -> None:
        """Queue the removal of a client's record."""
        with self._changed:
            self._forgotten.append(key)
            self._changed.notify_all()

    def wait(self, number: int) -> None:
        """Wait until the record of this number or a newer one is written. Raises ServiceError if that fails."""
        if not self._thread.is_alive():
            self._write()
        with self._changed:
            self._changed.wait_for(lambda: self._written >= number or self._problem, WRITE_LIMIT_S)
            if self._written < number:
                raise self._problem or ServiceError(f"writing the state took longer than {WRITE_LIMIT_S:g} s")

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._world or self._forgotten or self._is_closing)
                if self._is_closing and not self._world and not self._forgotten:
                    return
            self._write()

    def _write(self) -> None:
        with self._changed:
            world, self._world = self._world, None
            forgotten, self._forgotten = self._forgotten, []
            number = self._number
        problem = None
        try:
            for key in forgotten:
                self._store.forget_client(key)
            if world:
                self._store.save_world(world)
        except ServiceError as error:
            problem = error
            if self._problem is None:
                _log.error("the state of the simulation is not written: %s", error)
        with self._changed:
            self._problem = problem
            if problem is None:
                self._written = number
            self._changed.notify_all()

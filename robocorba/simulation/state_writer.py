"""Writes the state of the simulation to the store in a thread of its own, so that steps do not wait for the disk."""

from __future__ import annotations

import logging
import threading

from robocorba.errors.services import ServiceError
from robocorba.simulation.store import SimulationStore
from robocorba.simulation.world_record import WorldRecord
from robocorba.system.background import Background, end_process

#: Timeout of a call that waits until its change is on disk [s].
WRITE_LIMIT_S = 5.0
#: Pause after a failed attempt to write, unless there is more to write sooner [s].
RETRY_S = 1.0
_log = logging.getLogger(__name__)


class StateWriter:
    """Writes to `store`. The simulation thread calls `submit` and `forget`, which do not block.

    What can't be written waits for the next attempt, together with what is submitted meanwhile."""

    def __init__(self, store: SimulationStore) -> None:
        self._store = store
        self._changed = threading.Condition()
        self._world: WorldRecord | None = None
        self._forgotten: list[str] = []
        #: Numbers of the last change that was submitted, whose writing was tried, and that is written.
        self._number = self._tried = self._written = 0
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
            return self._submitted()

    def forget(self, key: str) -> int:
        """Queue the removal of a client's record; return a number for `wait`."""
        with self._changed:
            self._forgotten.append(key)
            return self._submitted()

    def wait(self, number: int) -> None:
        """Wait until the change of this number is written. Raises ServiceError if that fails; it is tried again."""
        if not self._thread.is_alive():
            self._write()
        with self._changed:
            self._changed.wait_for(lambda: self._tried >= number, WRITE_LIMIT_S)
            if self._written < number:
                raise self._problem or ServiceError(f"writing the state took longer than {WRITE_LIMIT_S:g} s")

    def _submitted(self) -> int:
        self._number += 1
        self._changed.notify_all()
        return self._number

    def _run(self) -> None:
        while True:
            with self._changed:
                pause_s = RETRY_S if self._problem else None
                self._changed.wait_for(lambda: self._number > self._tried or self._is_closing, pause_s)
                if self._is_closing and self._number == self._tried:
                    return
            self._write()

    def _write(self) -> None:
        with self._changed:
            world, self._world = self._world, None
            forgotten, self._forgotten = self._forgotten, []
            number = self._number
        problem = None
        try:
            while forgotten:
                self._store.forget_client(forgotten[0])
                del forgotten[0]
            if world:
                self._store.save_world(world)
        except ServiceError as error:
            problem = error
            if self._problem is None:
                _log.error("the state of the simulation is not written: %s", error)
        with self._changed:
            self._problem, self._tried = problem, number
            if problem is None:
                self._written = number
            else:
                self._world = self._world or world
                self._forgotten = forgotten + self._forgotten
            self._changed.notify_all()

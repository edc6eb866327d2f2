"""All moving bodies of a pymunk space, read and written at once: a thirtieth of what it costs one by one.

`pymunk.batch` reads and writes them too, but what it makes anew for a call costs more than the call itself.
"""

from __future__ import annotations

import numpy as np
import pymunk
from pymunk._chipmunk import ffi, lib  # type: ignore[import-not-found]
from pymunk.batch import BodyFields, Buffer, get_space_bodies

from robocorba.spatial.grids import Floats

_STATE = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
_MOTION = BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
_read_one = ffi.addressof(lib, "pmSpaceBodyGetIteratorFuncBatched")
_write_one = ffi.addressof(lib, "pmSpaceBodySetIteratorFuncBatched")


class Bodies:
    """A row for each, in the order in which pymunk keeps them.

    Whenever a body has come or gone, `sort` comes before everything else: the rows are where Chipmunk reads and writes
    by itself."""

    #: Rows (n, 6) of x, y, heading, velocity in x and y, turn.
    state: Floats
    #: Rows (n, 3) of velocity in x and y, turn, to be written.
    velocities: Floats

    def __init__(self, space: pymunk.Space) -> None:
        self._space = space
        self._first, self._second = ffi.new("cpBody *[1]"), ffi.new("cpBody *[1]")

    def sort(self) -> list[int]:
        """Make rows for the bodies that there are now, of zeros; their ids."""
        found = Buffer()
        get_space_bodies(self._space, BodyFields.BODY_ID, found)
        ids: list[int] = np.frombuffer(found.int_buf(), np.uintp).tolist()
        # A row more, since pymunk would look for a larger place before the last one is full.
        state, self.velocities = np.zeros((len(ids) + 1, 6)), np.zeros((len(ids), 3))
        self._reading, self._writing = _Batch(_STATE, state), _Batch(_MOTION, self.velocities)
        self.state = state[:-1]
        return ids

    def touching(self, arbiter: pymunk.Arbiter) -> list[int]:
        """Ids of the two bodies that an arbiter is about, without making objects of them and their shapes."""
        lib.cpArbiterGetBodies(arbiter._arbiter, self._first, self._second)
        return [int(ffi.cast("uintptr_t", lib.cpBodyGetUserData(one[0]))) for one in (self._first, self._second)]

    def read(self) -> None:
        """Let `state` be what the space has."""
        self._reading.each(self._space, _read_one)

    def write(self) -> None:
        """Let the bodies have `velocities`."""
        self._writing.each(self._space, _write_one)


class _Batch:
    """What Chipmunk's functions for a body work on: fields of it, from or to the next of the rows."""

    def __init__(self, fields: BodyFields, rows: Floats) -> None:
        self._buffer = Buffer()
        self._buffer.set_float_buf(rows)
        self._floats = self._buffer._float_arr
        self._data = ffi.new("pmBatchedData *")
        self._data.fields = fields.value
        self._data.floatArray, self._data.intArray = self._floats, self._buffer._int_arr

    def each(self, space: pymunk.Space, function: ffi.CData) -> None:
        self._floats.num = 0
        lib.cpSpaceEachBody(space._space, function, self._data)

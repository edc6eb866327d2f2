"""Batched access to all bodies of a pymunk space, its static body included, 30 times faster than one by one."""

from __future__ import annotations

import numpy as np
import pymunk
from pymunk.batch import ArbiterFields, BodyFields, Buffer, get_space_arbiters, get_space_bodies, set_space_bodies

from robocorba.map_editor.spatial.arrays import Floats


class Bodies:
    """One row for each body, the static one included, in pymunk's order.

    Call `rebuild` after adding or removing a body, before anything else: Chipmunk accesses the rows directly."""

    #: Rows (n, 6) of x, y [m], heading [rad], velocity along x and y [m/s], turn [rad/s].
    state: Floats
    #: Rows (n, 3) of velocity along x and y [m/s], turn [rad/s], for `write_velocities`.
    velocities: Floats
    #: Rows (n, 3) of force along x and y [N], torque [Nm], for `write_forces`.
    forces: Floats

    def __init__(self, space: pymunk.Space) -> None:
        self._space = space
        # One of each for good: pymunk never frees the arrays of a Buffer.
        self._ids, self._states, self._velocities, self._forces = Buffer(), Buffer(), Buffer(), Buffer()
        self._velocity_fields = BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
        self._state_fields = BodyFields.POSITION | BodyFields.ANGLE | self._velocity_fields
        self._force_fields = BodyFields.FORCE | BodyFields.TORQUE

    def rebuild(self) -> list[int]:
        """Allocate zeroed rows for the current bodies; return the ids of the bodies, row by row."""
        self._ids.clear()
        get_space_bodies(self._space, BodyFields.BODY_ID, self._ids)
        ids: list[int] = np.frombuffer(self._ids.int_buf(), np.uintp).tolist()
        # One spare row, since pymunk reallocates before the last row is full.
        state = np.zeros((len(ids) + 1, 6))
        self.velocities, self.forces = np.zeros((len(ids), 3)), np.zeros((len(ids), 3))
        self._states.set_float_buf(state)
        self._velocities.set_float_buf(self.velocities)
        self._forces.set_float_buf(self.forces)
        self.state = state[:-1]
        return ids

    def has_contacts(self) -> bool:
        """Whether bodies touch, or have touched so lately that Chipmunk remembers it."""
        self._ids.clear()
        get_space_arbiters(self._space, ArbiterFields.BODY_A_ID, self._ids)
        return len(self._ids.int_buf()) > 0

    def read(self) -> None:
        """Copy the state of all bodies to `state`."""
        self._states.clear()
        get_space_bodies(self._space, self._state_fields, self._states)

    def write_velocities(self) -> None:
        """Set the velocities of all bodies from `velocities`."""
        set_space_bodies(self._space, self._velocity_fields, self._velocities)

    def write_forces(self) -> None:
        """Apply `forces` to all bodies during the next step."""
        set_space_bodies(self._space, self._force_fields, self._forces)

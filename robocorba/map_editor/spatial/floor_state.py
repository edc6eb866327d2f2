"""State of all bodies on a floor after a simulation step, and the motion of each robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from itertools import repeat

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import Pose, RobotMotion
from robocorba.system.kernels import kernel
from robocorba.system.lazy_property import lazy_property

#: Builds a Pose from a tuple of its fields at half the cost of calling the class.
_pose_of = partial(tuple.__new__, Pose)


class FloorState:
    """Immutable snapshot of a floor after a step.

    names: of the bodies, row by row; empty for the static body. row_of: row of each name. rows: (n, 6) of x, y [m],
    heading [rad], velocity along x and y [m/s], turn [rad/s]. held: body that each robot's body holds, by name."""

    def __init__(
        self, floor: str, time: float, names: list[str], row_of: dict[str, int], rows: Floats, held: Mapping[str, str]
    ) -> None:
        self.floor, self.time = floor, time
        self.names, self.row_of, self.rows, self.held = names, row_of, rows, held

    @lazy_property
    def states(self) -> list[RobotMotion]:
        """Motion of each body, row by row, headings within [-pi, pi]. Computed for all bodies at the first access."""
        x, y, heading, *velocity = in_own_frames(self.rows).tolist()
        poses = map(_pose_of, zip(repeat(self.floor), x, y, heading))
        return list(map(RobotMotion, repeat(self.time), poses, zip(*velocity, strict=True)))


@kernel
def in_own_frames(rows: Floats) -> Floats:
    """Columns (6, n) from rows (n, 6): x, y, heading within [-pi, pi], velocity ahead and to the left, turn."""
    columns = np.empty((6, len(rows)))
    for i in range(len(rows)):
        x, y, heading, vx, vy, turn = rows[i]
        c, s = math.cos(heading), math.sin(heading)
        columns[0, i], columns[1, i] = x, y
        columns[2, i] = heading - 2 * math.pi * np.round(heading / (2 * math.pi))
        columns[3, i], columns[4, i], columns[5, i] = c * vx + s * vy, c * vy - s * vx, turn
    return columns

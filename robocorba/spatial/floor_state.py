"""What there is to see of a floor after a step, and of each robot on it."""

from __future__ import annotations

import math
from functools import cached_property, partial
from itertools import repeat

import msgspec
import numpy as np

from robocorba.kernels import kernel
from robocorba.spatial.grids import Floats
from robocorba.spatial.pose import Pose


class RobotMotion(msgspec.Struct, frozen=True, gc=False):
    """A robot as it is: velocities ahead, to the left (m/s) and turn (rad/s); `time` is the simulation's, s."""

    time: float
    pose: Pose
    velocity: tuple[float, float, float]


#: Makes a pose of a tuple of its fields, at half of what a call of the class costs.
_pose_of = partial(tuple.__new__, Pose)


class FloorState:
    """A floor after a step: the time, names in the order of the rows, empty for what stands, the row of each name, and
    rows (n, 6) of x, y, heading, velocity in x and y, turn. Nothing of it changes any more."""

    def __init__(self, floor: str, time: float, names: list[str], row_of: dict[str, int], rows: Floats) -> None:
        self.floor, self.time = floor, time
        self.names, self.row_of, self.rows = names, row_of, rows

    @cached_property
    def states(self) -> list[RobotMotion]:
        """By row; headings are within half a turn to both sides. Made for all when somebody asks."""
        x, y, heading, *velocity = in_own_frames(self.rows).tolist()
        poses = map(_pose_of, zip(repeat(self.floor), x, y, heading))
        return list(map(RobotMotion, repeat(self.time), poses, zip(*velocity, strict=True)))


@kernel
def in_own_frames(rows: Floats) -> Floats:
    """From rows (n, 6) as in FloorState: columns (6, n) of x, y, heading within half a turn, velocity ahead and to the
    left, turn."""
    columns = np.empty((6, len(rows)))
    for i in range(len(rows)):
        x, y, heading, vx, vy, turn = rows[i]
        c, s = math.cos(heading), math.sin(heading)
        columns[0, i], columns[1, i] = x, y
        columns[2, i] = heading - 2 * math.pi * np.round(heading / (2 * math.pi))
        columns[3, i], columns[4, i], columns[5, i] = c * vx + s * vy, c * vy - s * vx, turn
    return columns

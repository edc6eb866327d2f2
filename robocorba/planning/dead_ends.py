"""Parts of a floor that a shortest path enters only if it begins or ends in them.

A triangle with a single open edge is a dead end, and so is a triangle that becomes one when dead ends are removed.
The rest is the core. A shortest path between two places in the core does not enter a dead end, except that a robot
of radius r may reach r into it where an obstacle in front of its opening pushes the robot aside. Therefore the
vertices up to 2 r from the opening count as well. In mazes nearly all triangles are dead ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.planning.segments import segments_distance2
from robocorba.planning.triangulation import Flags, Mesh, locate, on_lattice
from robocorba.system.kernels import inner_kernel, kernel

#: Exit triangle of a triangle of the core.
IN_CORE = -1


class DeadEnds(NamedTuple):
    """exit_triangle (t,): the next triangle towards the exit of a dead end, IN_CORE in the core; near_core (n,): the
    vertices at which paths through the core may turn; stamp (n,): the last search in which paths may turn at a vertex
    in addition."""

    exit_triangle: Longs
    near_core: Flags
    stamp: Longs


@kernel
def exit_triangles(mesh: Mesh) -> Longs:
    """The next triangle towards the exit of each dead end; IN_CORE for triangles of the core."""
    count = mesh.corner.shape[0]
    found = np.full(count, IN_CORE, np.int64)
    openings = np.zeros(count, np.int64)
    stack = np.empty(count, np.int64)
    height = 0
    for t in range(count):
        for k in range(3):
            if mesh.across[t, k] >= 0 and not mesh.wall[t, k]:
                openings[t] += 1
        if openings[t] == 1:
            stack[height] = t
            height += 1
    while height:
        height -= 1
        t = stack[height]
        if openings[t] != 1:  # the last triangle of a part without a core
            continue
        for k in range(3):
            n = mesh.across[t, k]
            if n >= 0 and not mesh.wall[t, k] and openings[n] > 0 and found[n] != t:
                found[t] = n
                openings[t] = 0
                openings[n] -= 1
                if openings[n] == 1:
                    stack[height] = n
                    height += 1
                break
    return found


@kernel
def near_core(mesh: Mesh, xy: Floats, exit_triangle: Longs, reach: float) -> Flags:
    """The vertices (n,) of the core, and those of dead ends within `reach` [m] of their opening."""
    stamp = np.zeros(mesh.at.shape[0], np.int64)
    stack = np.empty(mesh.corner.shape[0], np.int64)
    for t in range(mesh.corner.shape[0]):
        if exit_triangle[t] == IN_CORE:
            _stamp_triangle(mesh, xy, exit_triangle, t, reach, stamp, np.int64(1), stack)
    return stamp == 1


@inner_kernel
def stamp_exit_route(mesh: Mesh, xy: Floats, ends: DeadEnds, x: float, y: float, reach: float, epoch: int) -> None:
    """Stamp the vertices of the triangles from a place [m] to the exit of its dead end, and those within `reach` [m]
    beside them."""
    column, row = on_lattice(mesh, x, y)
    t = locate(mesh, column, row, mesh.triangle_of[0])
    if ends.exit_triangle[t] == IN_CORE:
        return
    stack = np.empty(256, np.int64)
    while t != IN_CORE:
        _stamp_triangle(mesh, xy, ends.exit_triangle, t, reach, ends.stamp, epoch, stack)
        t = ends.exit_triangle[t]


@kernel
def _stamp_triangle(
    mesh: Mesh, xy: Floats, exit_triangle: Longs, triangle: int, reach: float, stamp: Longs, epoch: int, stack: Longs
) -> None:
    """Stamp the vertices of a triangle and, in dead ends that open to it, those within `reach` [m] of the opening."""
    for k in range(3):
        a, b = mesh.corner[triangle, k], mesh.corner[triangle, (k + 1) % 3]
        stamp[a] = epoch
        n = mesh.across[triangle, k]
        if n < 0 or mesh.wall[triangle, k] or exit_triangle[n] != triangle:
            continue
        stack[0], height = n, 1
        while height:
            height -= 1
            t = stack[height]
            for j in range(3):
                p, q = mesh.corner[t, j], mesh.corner[t, (j + 1) % 3]
                apart2 = segments_distance2(
                    xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[p, 0], xy[p, 1], xy[q, 0], xy[q, 1]
                )
                if apart2 >= reach * reach:
                    continue
                for v in (p, q):
                    stamp[v] = epoch
                beyond = mesh.across[t, j]
                if beyond >= 0 and not mesh.wall[t, j] and exit_triangle[beyond] == t and height < stack.shape[0]:
                    stack[height] = beyond
                    height += 1

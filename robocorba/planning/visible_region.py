"""Which vertices of a triangulation are visible from a point, by triangular expansion.

Rays are as wide as SLACK_STEPS of the lattice, so that rounding never hides a vertex: the result includes all
visible vertices, and its users verify each line against the exact geometry.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.planning.triangulation import Mesh, corner_of, edge_to, first_of_star, locate, next_in_star, on_lattice
from robocorba.system.kernels import inner_kernel, kernel

#: Distance beside a ray within which a vertex counts as seen [steps of the lattice].
SLACK_STEPS = 4.0


class Scratch(NamedTuple):
    """Work arrays of an expansion: a stack of edges to cross, each with the left and right rays that bound the view;
    the vertices seen; the number of the last expansion that saw each vertex; the number of this expansion."""

    edges: Longs
    rays: Floats
    seen: Longs
    stamp: Longs
    counter: Longs


def make_scratch(mesh: Mesh) -> Scratch:
    """Work arrays for a mesh."""
    triangles, vertices = mesh.corner.shape[0], mesh.at.shape[0]
    return Scratch(
        np.empty((triangles + 8, 2), np.int64),
        np.empty((triangles + 8, 4)),
        np.empty(vertices, np.int64),
        np.zeros(vertices, np.int64),
        np.zeros(1, np.int64),
    )


@kernel
def seen_from(mesh: Mesh, xy: Floats, vertex: int, x: float, y: float, scratch: Scratch) -> tuple[int, int]:
    """Fill scratch.seen with the vertices visible from a vertex or, if that is -1, from the point (x, y) [m].
    Returns the number of these vertices and of the triangles visited. xy (n, 2) are the vertices [m]."""
    scratch.counter[0] += 1
    epoch = scratch.counter[0]
    edges, rays, seen, stamp = scratch.edges, scratch.rays, scratch.seen, scratch.stamp
    slack = SLACK_STEPS * mesh.frame[2]
    count = height = 0
    if vertex < 0:
        column, row = on_lattice(mesh, x, y)
        here = locate(mesh, column, row, mesh.triangle_of[0])
        for k in range(3):
            v = mesh.corner[here, k]
            if math.hypot(xy[v, 0] - x, xy[v, 1] - y) <= slack:
                vertex = v
    if vertex >= 0:
        x, y = xy[vertex, 0], xy[vertex, 1]
        stamp[vertex] = epoch
        first = here = first_of_star(mesh, vertex)
        while True:
            k = (corner_of(mesh, here, vertex) + 1) % 3
            count = _add_seen(mesh.corner[here, k], stamp, epoch, seen, count)
            count = _add_seen(mesh.corner[here, (k + 1) % 3], stamp, epoch, seen, count)
            height = _push_edge(mesh, xy, here, k, x, y, edges, rays, height)
            here = next_in_star(mesh, vertex, here)
            if here < 0 or here == first:
                break
    else:
        for k in range(3):
            count = _add_seen(mesh.corner[here, k], stamp, epoch, seen, count)
            height = _push_edge(mesh, xy, here, k, x, y, edges, rays, height)
    visited = 0
    while height:
        height -= 1
        visited += 1
        triangle, k = edges[height]
        lx, ly, rx, ry = rays[height]
        there = mesh.across[triangle, k]
        j = edge_to(mesh, there, triangle)
        apex = mesh.corner[there, (j + 2) % 3]
        ax, ay = xy[apex, 0] - x, xy[apex, 1] - y
        beside_right = rx * ay - ry * ax  # how far the apex is to the left of the right ray [m]
        beside_left = ax * ly - ay * lx  # and to the right of the left ray [m]
        if beside_right >= -slack and beside_left >= -slack:
            count = _add_seen(apex, stamp, epoch, seen, count)
        far = math.hypot(ax, ay)
        if far > 0.0:
            ax, ay = ax / far, ay / far
        # Edges are crossed from their front only; otherwise a ray that touches a vertex would turn around it.
        right_edge, left_edge = (j + 1) % 3, (j + 2) % 3
        left, right = mesh.corner[there, j], mesh.corner[there, right_edge]
        faces_right = (xy[right, 0] - x) * ay - (xy[right, 1] - y) * ax > 0.0
        faces_left = ax * (xy[left, 1] - y) - ay * (xy[left, 0] - x) > 0.0
        if beside_right >= -slack and faces_right and not _is_closed(mesh, there, right_edge):
            edges[height, 0], edges[height, 1] = there, right_edge
            rays[height, 0], rays[height, 1] = (ax, ay) if beside_left >= 0.0 else (lx, ly)
            rays[height, 2], rays[height, 3] = rx, ry
            height += 1
        if beside_left >= -slack and faces_left and not _is_closed(mesh, there, left_edge):
            edges[height, 0], edges[height, 1] = there, left_edge
            rays[height, 0], rays[height, 1] = lx, ly
            rays[height, 2], rays[height, 3] = (ax, ay) if beside_right >= 0.0 else (rx, ry)
            height += 1
        if height + 2 > edges.shape[0]:
            break
    return count, visited


@kernel
def _is_closed(mesh: Mesh, triangle: int, k: int) -> bool:
    """Whether an edge blocks sight: a wall lies on it, or it is the border of the mesh."""
    return mesh.across[triangle, k] < 0 or mesh.wall[triangle, k]


@inner_kernel
def _add_seen(vertex: int, stamp: Longs, epoch: int, seen: Longs, count: int) -> int:
    """Add a vertex to those seen, once; returns their number."""
    if stamp[vertex] == epoch:
        return count
    stamp[vertex] = epoch
    seen[count] = vertex
    return count + 1


@inner_kernel
def _push_edge(
    mesh: Mesh, xy: Floats, triangle: int, k: int, x: float, y: float, edges: Longs, rays: Floats, height: int
) -> int:
    """Push an edge of the first triangle on the stack, unless a wall lies on it; returns the stack's height."""
    if _is_closed(mesh, triangle, k):
        return height
    right, left = mesh.corner[triangle, k], mesh.corner[triangle, (k + 1) % 3]
    lx, ly = xy[left, 0] - x, xy[left, 1] - y
    rx, ry = xy[right, 0] - x, xy[right, 1] - y
    far_left, far_right = math.hypot(lx, ly), math.hypot(rx, ry)
    if far_left == 0.0 or far_right == 0.0:
        return height
    edges[height, 0], edges[height, 1] = triangle, k
    rays[height, 0], rays[height, 1] = lx / far_left, ly / far_left
    rays[height, 2], rays[height, 3] = rx / far_right, ry / far_right
    return height + 1

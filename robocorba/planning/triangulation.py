"""A constrained triangulation of a floor: which vertices of walls may be visible from a point.

Vertices lie on a lattice of 2^30 steps across the frame, so that every orientation test is exact in 64-bit integers.
Walls become edges that block sight. A wall that cannot be inserted (it crosses another one at a point that is no
vertex) is left out: a search then considers more vertices than necessary, and every line is verified against the exact
geometry.

Sources: incremental Delaunay triangulation with Lawson's flips; constraints by flips (Sloan 1993); visibility by
triangular expansion (Bungiu et al. 2014).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.system.kernels import inner_kernel, kernel

#: Number of steps of the lattice across the frame: products of two differences fit into 64 bits.
LATTICE = 1 << 30
#: Maximum distance from a wall of a vertex that lies on it [steps of the lattice].
ON_WALL_STEPS = 2.0
#: Number of corners of the frame, the first vertices of every mesh.
FRAME_CORNERS = 4
#: Share of the frame that is left empty around its content.
MARGIN = 0.05

Flags = NDArray[np.bool_]


class Mesh(NamedTuple):
    """Triangle t has the vertices corner[t] counter-clockwise; across[t, k] is the triangle beyond the edge from
    corner[t, k] to corner[t, k + 1] (-1 beyond the frame) and wall[t, k] whether a wall lies on that edge.

    at (n, 2) are the vertices on the lattice, triangle_of[v] is a triangle of vertex v, size the numbers of triangles
    and of vertices in use, frame the lower left corner and the step [m]."""

    corner: Longs
    across: Longs
    wall: Flags
    at: Longs
    triangle_of: Longs
    size: Longs
    frame: Floats


def empty_mesh(bounds: tuple[float, float, float, float], vertices: int) -> Mesh:
    """A mesh of two triangles over `bounds` (min x, min y, max x, max y in m) with room for this number of vertices."""
    x0, y0, x1, y1 = bounds
    width = max(x1 - x0, y1 - y0, 1.0)
    low_x, low_y = x0 - MARGIN * width, y0 - MARGIN * width
    step = (1 + 2 * MARGIN) * width / LATTICE
    room = vertices + FRAME_CORNERS
    mesh = Mesh(
        np.full((2 * room, 3), -1, np.int64),
        np.full((2 * room, 3), -1, np.int64),
        np.zeros((2 * room, 3), np.bool_),
        np.empty((room, 2), np.int64),
        np.zeros(room, np.int64),
        np.array([2, FRAME_CORNERS], np.int64),
        np.array([low_x, low_y, step]),
    )
    mesh.at[:FRAME_CORNERS] = [(0, 0), (LATTICE, 0), (LATTICE, LATTICE), (0, LATTICE)]
    mesh.corner[:2] = [(0, 1, 2), (0, 2, 3)]
    mesh.across[:2] = [(-1, -1, 1), (0, -1, -1)]
    mesh.triangle_of[:FRAME_CORNERS] = [0, 0, 0, 1]
    return mesh


def trimmed(mesh: Mesh) -> Mesh:
    """A copy without unused room."""
    triangles, vertices = mesh.size.tolist()
    return Mesh(
        mesh.corner[:triangles].copy(),
        mesh.across[:triangles].copy(),
        mesh.wall[:triangles].copy(),
        mesh.at[:vertices].copy(),
        mesh.triangle_of[:vertices].copy(),
        mesh.size,
        mesh.frame,
    )


@kernel
def doubled(rows: NDArray) -> NDArray:
    """A copy with room for twice as many rows."""
    copy = np.empty((2 * rows.shape[0], rows.shape[1]), rows.dtype)
    for i in range(rows.shape[0]):  # an assignment of the whole takes a second more to compile
        for k in range(rows.shape[1]):
            copy[i, k] = rows[i, k]
    return copy


@inner_kernel
def on_lattice(mesh: Mesh, x: float, y: float) -> tuple[int, int]:
    """The nearest point of the lattice within the frame."""
    column = math.floor((x - mesh.frame[0]) / mesh.frame[2] + 0.5)
    row = math.floor((y - mesh.frame[1]) / mesh.frame[2] + 0.5)
    return min(max(column, 0), LATTICE), min(max(row, 0), LATTICE)


@kernel
def _side(at: Longs, a: int, b: int, x: int, y: int) -> int:
    """Positive where (x, y) lies to the left of the line from vertex a to vertex b, 0 on it; exact."""
    return (at[b, 0] - at[a, 0]) * (y - at[a, 1]) - (at[b, 1] - at[a, 1]) * (x - at[a, 0])


@kernel
def side(at: Longs, a: int, b: int, c: int) -> int:
    """Positive where vertex c lies to the left of the line from vertex a to vertex b, 0 on it; exact."""
    return _side(at, a, b, at[c, 0], at[c, 1])


@kernel
def locate(mesh: Mesh, x: int, y: int, hint: int) -> int:
    """The triangle that contains a point of the lattice, found by walking from triangle `hint`."""
    here, turn = hint, 0
    for _ in range(4 * mesh.size[0] + 16):
        moved = False
        for i in range(3):
            k = (i + turn) % 3
            if _side(mesh.at, mesh.corner[here, k], mesh.corner[here, (k + 1) % 3], x, y) < 0:
                there = mesh.across[here, k]
                if there < 0:
                    return here
                here, moved, turn = there, True, turn + 1
                break
        if not moved:
            return here
    return here


@inner_kernel
def corner_of(mesh: Mesh, triangle: int, vertex: int) -> int:
    """The number of a vertex among the corners of a triangle."""
    for k in range(3):
        if mesh.corner[triangle, k] == vertex:
            return k
    return -1


@inner_kernel
def edge_to(mesh: Mesh, triangle: int, neighbour: int) -> int:
    """The number of the edge that a triangle shares with a neighbour."""
    for k in range(3):
        if mesh.across[triangle, k] == neighbour:
            return k
    return -1


@inner_kernel
def _set_triangle(
    mesh: Mesh, t: int, a: int, b: int, c: int, ab: int, bc: int, ca: int, wall_ab: bool, wall_bc: bool, wall_ca: bool
) -> None:
    """Set vertices, neighbours and walls of triangle t."""
    mesh.corner[t, 0], mesh.corner[t, 1], mesh.corner[t, 2] = a, b, c
    mesh.across[t, 0], mesh.across[t, 1], mesh.across[t, 2] = ab, bc, ca
    mesh.wall[t, 0], mesh.wall[t, 1], mesh.wall[t, 2] = wall_ab, wall_bc, wall_ca
    mesh.triangle_of[a] = mesh.triangle_of[b] = mesh.triangle_of[c] = t


@inner_kernel
def _relink(mesh: Mesh, triangle: int, old: int, new: int) -> None:
    """Replace a neighbour of a triangle, unless the triangle is -1, beyond the frame."""
    if triangle >= 0:
        mesh.across[triangle, edge_to(mesh, triangle, old)] = new


@inner_kernel
def _flip(mesh: Mesh, t: int, k: int) -> int:
    """Replace edge k of triangle t by the other diagonal: a-d-c in t, d-b-c beyond. Returns the triangle beyond."""
    n = mesh.across[t, k]
    j = edge_to(mesh, n, t)
    k1, k2, j1, j2 = (k + 1) % 3, (k + 2) % 3, (j + 1) % 3, (j + 2) % 3
    a, b, c, d = mesh.corner[t, k], mesh.corner[t, k1], mesh.corner[t, k2], mesh.corner[n, j2]
    bc, ca, ad, db = mesh.across[t, k1], mesh.across[t, k2], mesh.across[n, j1], mesh.across[n, j2]
    wall_bc, wall_ca, wall_ad, wall_db = mesh.wall[t, k1], mesh.wall[t, k2], mesh.wall[n, j1], mesh.wall[n, j2]
    _set_triangle(mesh, t, a, d, c, ad, n, ca, wall_ad, False, wall_ca)
    _set_triangle(mesh, n, d, b, c, db, bc, t, wall_db, wall_bc, False)
    _relink(mesh, ad, n, t)
    _relink(mesh, bc, t, n)
    return n


@inner_kernel
def _in_circle(at: Longs, a: int, b: int, c: int, d: int) -> bool:
    """Whether d lies inside the circle through a, b and c by more than rounding."""
    ax, ay = float(at[a, 0] - at[d, 0]), float(at[a, 1] - at[d, 1])
    bx, by = float(at[b, 0] - at[d, 0]), float(at[b, 1] - at[d, 1])
    cx, cy = float(at[c, 0] - at[d, 0]), float(at[c, 1] - at[d, 1])
    a2, b2, c2 = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    found = ax * (by * c2 - b2 * cy) - ay * (bx * c2 - b2 * cx) + a2 * (bx * cy - by * cx)
    return found > 1e-9 * (a2 + b2 + c2) * max(a2, b2, c2)


@kernel
def _restore(mesh: Mesh, stack: Longs, height: int) -> None:
    """Flip edges until the triangulation is Delaunay. The new vertex is corner 2 of the triangles on the stack;
    their edge 0 is opposite to it."""
    while height:
        height -= 1
        t = stack[height]
        n = mesh.across[t, 0]
        if n < 0 or mesh.wall[t, 0]:
            continue
        a, b, p = mesh.corner[t, 0], mesh.corner[t, 1], mesh.corner[t, 2]
        d = mesh.corner[n, (edge_to(mesh, n, t) + 2) % 3]
        if (
            _in_circle(mesh.at, a, b, p, d)
            and side(mesh.at, d, p, a) > 0
            and side(mesh.at, d, p, b) < 0
            and height + 2 <= stack.shape[0]
        ):
            stack[height], stack[height + 1] = t, _flip(mesh, t, 0)
            height += 2


@inner_kernel
def insert_vertex(mesh: Mesh, x: int, y: int, hint: int, stack: Longs) -> int:
    """The vertex at a point of the lattice, a new one if there is none; the mesh must have room."""
    t = locate(mesh, x, y, hint)
    on_edge = -1
    for k in range(3):
        v = mesh.corner[t, k]
        if mesh.at[v, 0] == x and mesh.at[v, 1] == y:
            return v
        if _side(mesh.at, v, mesh.corner[t, (k + 1) % 3], x, y) == 0:
            on_edge = k
    p, new = mesh.size[1], mesh.size[0]
    mesh.at[p, 0], mesh.at[p, 1] = x, y
    mesh.size[1] += 1
    mesh.size[0] += 2
    if on_edge < 0:
        a, b, c = mesh.corner[t, 0], mesh.corner[t, 1], mesh.corner[t, 2]
        ab, bc, ca = mesh.across[t, 0], mesh.across[t, 1], mesh.across[t, 2]
        wall_ab, wall_bc, wall_ca = mesh.wall[t, 0], mesh.wall[t, 1], mesh.wall[t, 2]
        t1, t2 = new, new + 1
        _set_triangle(mesh, t, a, b, p, ab, t1, t2, wall_ab, False, False)
        _set_triangle(mesh, t1, b, c, p, bc, t2, t, wall_bc, False, False)
        _set_triangle(mesh, t2, c, a, p, ca, t, t1, wall_ca, False, False)
        _relink(mesh, bc, t, t1)
        _relink(mesh, ca, t, t2)
        stack[0], stack[1], stack[2] = t, t1, t2
        _restore(mesh, stack, 3)
        return p
    k, n = on_edge, mesh.across[t, on_edge]
    j = edge_to(mesh, n, t)
    k1, k2, j1, j2 = (k + 1) % 3, (k + 2) % 3, (j + 1) % 3, (j + 2) % 3
    a, b, c, d = mesh.corner[t, k], mesh.corner[t, k1], mesh.corner[t, k2], mesh.corner[n, j2]
    bc, ca, ad, db = mesh.across[t, k1], mesh.across[t, k2], mesh.across[n, j1], mesh.across[n, j2]
    wall_bc, wall_ca, wall_ad, wall_db = mesh.wall[t, k1], mesh.wall[t, k2], mesh.wall[n, j1], mesh.wall[n, j2]
    wall_ab = mesh.wall[t, k]
    t1, t2 = new, new + 1  # t: c-a-p, t1: b-c-p, n: a-d-p, t2: d-b-p
    _set_triangle(mesh, t, c, a, p, ca, n, t1, wall_ca, wall_ab, False)
    _set_triangle(mesh, t1, b, c, p, bc, t, t2, wall_bc, False, wall_ab)
    _set_triangle(mesh, n, a, d, p, ad, t2, t, wall_ad, False, wall_ab)
    _set_triangle(mesh, t2, d, b, p, db, t1, n, wall_db, wall_ab, False)
    _relink(mesh, bc, t, t1)
    _relink(mesh, db, n, t2)
    stack[0], stack[1], stack[2], stack[3] = t, t1, n, t2
    _restore(mesh, stack, 4)
    return p


@inner_kernel
def first_of_star(mesh: Mesh, vertex: int) -> int:
    """The first triangle around a vertex: the last one clockwise at the frame, else any."""
    first = here = mesh.triangle_of[vertex]
    while True:
        before = mesh.across[here, corner_of(mesh, here, vertex)]
        if before < 0 or before == first:
            return here
        here = before


@inner_kernel
def next_in_star(mesh: Mesh, vertex: int, triangle: int) -> int:
    """The next triangle counter-clockwise around a vertex, -1 at the frame."""
    return mesh.across[triangle, (corner_of(mesh, triangle, vertex) + 2) % 3]


@inner_kernel
def _find_edge(mesh: Mesh, a: int, b: int) -> tuple[int, int]:
    """The triangle and the number of the edge from a to b; (-1, -1) if there is none."""
    first = here = first_of_star(mesh, a)
    while True:
        k = corner_of(mesh, here, a)
        if mesh.corner[here, (k + 1) % 3] == b:
            return here, k
        here = next_in_star(mesh, a, here)
        if here < 0 or here == first:
            return -1, -1


@inner_kernel
def _along(at: Longs, a: int, b: int, p: int) -> float:
    """Position of vertex p on the line from vertex a to b, as a share of its length: negative if p is not between
    them on the line, 1 for b."""
    if p == b:
        return 1.0
    dx, dy = float(at[b, 0] - at[a, 0]), float(at[b, 1] - at[a, 1])
    length2 = dx * dx + dy * dy
    along = (dx * float(at[p, 0] - at[a, 0]) + dy * float(at[p, 1] - at[a, 1])) / length2
    if 0.0 < along < 1.0 and abs(float(side(at, a, b, p))) <= ON_WALL_STEPS * math.sqrt(length2):
        return along
    return -1.0


@inner_kernel
def _next_on(mesh: Mesh, a: int, b: int) -> tuple[int, int, int]:
    """From vertex a towards vertex b: the nearest neighbour of a on the line, else the triangle and the edge that
    the line crosses first; (vertex or -1, triangle, edge)."""
    triangle, edge = -1, -1
    nearest, least = -1, 2.0
    first = here = first_of_star(mesh, a)
    while True:
        k = corner_of(mesh, here, a)
        right, left = mesh.corner[here, (k + 1) % 3], mesh.corner[here, (k + 2) % 3]
        for p in (right, left):
            along = _along(mesh.at, a, b, p)
            if 0.0 < along < least:
                nearest, least = p, along
        if side(mesh.at, a, b, right) < 0 and side(mesh.at, a, b, left) > 0 and side(mesh.at, right, left, a) > 0:
            triangle, edge = here, (k + 1) % 3
        here = next_in_star(mesh, a, here)
        if here < 0 or here == first:
            return nearest, triangle, edge


@inner_kernel
def insert_wall(mesh: Mesh, a: int, b: int) -> None:
    """Make the line from vertex a to vertex b a wall, as far as no other wall crosses it."""
    for _ in range(mesh.size[1]):
        if a == b:
            return
        on, triangle, edge = _next_on(mesh, a, b)
        if on < 0:
            on = _flip_crossed_edges(mesh, a, b, triangle, edge)
            if on < 0:
                return
        for start, end in ((a, on), (on, a)):
            triangle, edge = _find_edge(mesh, start, end)
            if triangle >= 0:
                mesh.wall[triangle, edge] = True
        a = on


@inner_kernel
def _flip_crossed_edges(mesh: Mesh, a: int, b: int, triangle: int, edge: int) -> int:
    """Flip the edges that the line from a to b crosses up to the next vertex on it. Returns that vertex; -1 if one
    of the edges is a wall."""
    if triangle < 0:
        return -1
    crossed = np.empty((64, 2), np.int64)
    count, target = 0, -1
    while target < 0:
        if mesh.wall[triangle, edge] or mesh.across[triangle, edge] < 0 or count > mesh.size[0]:
            return -1
        if count == crossed.shape[0]:
            crossed = doubled(crossed)
        crossed[count, 0], crossed[count, 1] = mesh.corner[triangle, edge], mesh.corner[triangle, (edge + 1) % 3]
        count += 1
        there = mesh.across[triangle, edge]
        j = edge_to(mesh, there, triangle)
        apex = mesh.corner[there, (j + 2) % 3]
        if _along(mesh.at, a, b, apex) > 0.0:
            target = apex
        triangle, edge = there, (j + 1) % 3 if side(mesh.at, a, b, apex) > 0 else (j + 2) % 3
    waiting, first, tries = count, 0, 0
    room = crossed.shape[0]
    while waiting:
        tries += 1
        if tries > 64 * count + 1024:
            return -1
        p, q = crossed[first % room]
        first, waiting = first + 1, waiting - 1
        t, k = _find_edge(mesh, p, q)
        if t < 0:
            continue
        n = mesh.across[t, k]
        c, d = mesh.corner[t, (k + 2) % 3], mesh.corner[n, (edge_to(mesh, n, t) + 2) % 3]
        last = (first + waiting) % room
        if side(mesh.at, d, c, p) <= 0 or side(mesh.at, d, c, q) >= 0:  # not convex: later
            crossed[last, 0], crossed[last, 1] = p, q
            waiting += 1
            continue
        _flip(mesh, t, k)
        if c != a and c != target and d != a and d != target:
            side_c, side_d = side(mesh.at, a, target, c), side(mesh.at, a, target, d)
            if (side_c > 0) != (side_d > 0):
                crossed[last, 0], crossed[last, 1] = c, d
                waiting += 1
    return target


@kernel
def insert_walls(mesh: Mesh, segments: Floats, order: Longs, ends: Longs) -> None:
    """Insert segments (n, 4) [m] as walls, their ends in the given order (2n,); ends (2n,) receives their vertices."""
    stack, hint = np.empty(4096, np.int64), np.int64(0)
    for end in order:
        x, y = on_lattice(mesh, segments[end // 2, 2 * (end % 2)], segments[end // 2, 2 * (end % 2) + 1])
        ends[end] = insert_vertex(mesh, x, y, hint, stack)
        hint = mesh.triangle_of[ends[end]]
    for i in range(segments.shape[0]):
        insert_wall(mesh, ends[2 * i], ends[2 * i + 1])


@kernel
def insert_points(mesh: Mesh, points: Floats) -> None:
    """Insert points (n, 2) [m] as vertices."""
    stack, hint = np.empty(4096, np.int64), np.int64(0)
    for i in range(points.shape[0]):
        x, y = on_lattice(mesh, points[i, 0], points[i, 1])
        hint = mesh.triangle_of[insert_vertex(mesh, x, y, hint, stack)]


@kernel
def crossings(grid: Grid) -> Floats:
    """Points (n, 2) at which segments of a grid cross each other, away from their ends."""
    segments, start, items, _frame = grid
    found = np.empty((16, 2))
    count = 0
    for cell in range(start.shape[0] - 1):
        for i in range(start[cell], start[cell + 1]):
            ax, ay, bx, by = segments[items[i]]
            for j in range(i + 1, start[cell + 1]):
                cx, cy, dx, dy = segments[items[j]]
                if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
                    continue
                if max(cy, dy) < min(ay, by) or min(cy, dy) > max(ay, by):
                    continue
                along = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
                if along == 0.0:
                    continue
                t = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / along
                u = ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / along
                if not (1e-9 < t < 1 - 1e-9 and 1e-9 < u < 1 - 1e-9):
                    continue
                if count == found.shape[0]:
                    found = doubled(found)
                found[count, 0], found[count, 1] = ax + t * (bx - ax), ay + t * (by - ay)
                count += 1
    return found[:count]

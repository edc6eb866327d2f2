"""The triangulation of a floor's walls stays whole, and what can be seen is never missed."""

from __future__ import annotations

import math

import numpy as np
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import LineString

from robocorba.planning.floor_mesh import FloorMesh
from robocorba.planning.triangulation import FRAME_CORNERS, Mesh, side
from robocorba.planning.visible_region import make_scratch, seen_from
from robocorba.spatial.grids import build_grid

#: On a coarse grid walls meet, cross, overlap and lie on one line as often as they can.
coarse = st.integers(0, 6).map(float)
fine = st.floats(0, 6).map(lambda value: round(value, 4))  # the least length of a wall is 1 mm
ends = st.tuples(coarse, coarse, coarse, coarse) | st.tuples(fine, fine, fine, fine)
walls = st.lists(ends.filter(lambda wall: math.dist(wall[:2], wall[2:]) > 1e-3), min_size=1, max_size=14)


def is_whole(mesh: Mesh) -> bool:
    """Every triangle is counter-clockwise, neighbours know each other and agree on walls, and together they fill the
    frame without a gap."""
    corners = mesh.corner
    if any(side(mesh.at, *corner) <= 0 for corner in corners.tolist()):
        return False
    for t, beyond in enumerate(mesh.across.tolist()):
        for k, n in enumerate(beyond):
            if n < 0:
                continue
            back = mesh.across[n].tolist().index(t)
            same = (corners[n, back], corners[n, (back + 1) % 3]) == (corners[t, (k + 1) % 3], corners[t, k])
            if not same or mesh.wall[n, back] != mesh.wall[t, k]:
                return False
    area = shapely.area(shapely.polygons(mesh.at[corners].astype(float))).sum()
    return bool(np.isclose(area, float(np.ptp(mesh.at[:, 0])) * float(np.ptp(mesh.at[:, 1]))))


@settings(deadline=None, max_examples=150)
@given(walls)
def test_walls_become_edges(found: list[tuple[float, ...]]) -> None:
    mesh = FloorMesh(build_grid(np.array(found)), True)
    assert is_whole(mesh.mesh)
    edges = [
        LineString([mesh.xy[corner[k]], mesh.xy[corner[(k + 1) % 3]]])
        for corner, wall in zip(mesh.mesh.corner, mesh.mesh.wall, strict=True)
        for k in range(3)
        if wall[k]
    ]
    drawn = shapely.union_all([LineString([wall[:2], wall[2:]]) for wall in found])
    assert shapely.union_all(edges).hausdorff_distance(drawn) < 1e-6


@settings(deadline=None, max_examples=150)
@given(walls, st.tuples(fine, fine))
def test_what_is_visible_is_seen(found: list[tuple[float, ...]], eye: tuple[float, float]) -> None:
    mesh = FloorMesh(build_grid(np.array(found)), True, [eye])
    scratch = make_scratch(mesh.mesh)
    lines = [LineString([wall[:2], wall[2:]]) for wall in found]
    blocked = shapely.union_all(lines)
    shapely.prepare(blocked)
    assume(blocked.distance(shapely.Point(eye)) > 1e-4)  # a robot never looks from within a wall
    from_point = {-1: eye, **{v: tuple(mesh.xy[v].tolist()) for v in range(FRAME_CORNERS, len(mesh.xy))}}
    for vertex, at in list(from_point.items())[:6]:
        count, _ = seen_from(mesh.mesh, mesh.xy, vertex, *at, scratch)
        seen = set(scratch.seen[:count].tolist())
        assert len(seen) == count
        for other in range(FRAME_CORNERS, len(mesh.xy)):
            there = mesh.xy[other]
            ray = LineString([at, there])
            if other == vertex or ray.length < 1e-3:
                continue
            ends_here = shapely.points([at, there])  # walls that meet at an end of the ray do not hide the other end
            between = [line for line in lines if (shapely.distance(line, ends_here) > 1e-9).all()]
            if not between or shapely.distance(ray, between).min() > 1e-5:
                assert other in seen, (vertex, at, there)


def test_no_walls_at_all() -> None:
    mesh = FloorMesh(build_grid(np.empty((0, 4))), False, [(3.0, 4.0)])
    assert is_whole(mesh.mesh)
    assert mesh.covers([(3.0, 4.0)])

"""Distances between line segments."""

from __future__ import annotations

from robocorba.system.kernels import inner_kernel, kernel


@inner_kernel
def point_segment_distance2(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance between the point (x, y) and the segment ab [m^2]."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    t = 0.0
    if length2 > 0.0:
        t = min(max(((x - ax) * dx + (y - ay) * dy) / length2, 0.0), 1.0)
    ex, ey = x - ax - t * dx, y - ay - t * dy
    return ex * ex + ey * ey


@kernel
def _side(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Positive where c lies to the left of the line ab."""
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@kernel
def segments_distance2(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> float:
    """Squared distance between the segments ab and cd [m^2]."""
    if (_side(ax, ay, bx, by, cx, cy) > 0.0) != (_side(ax, ay, bx, by, dx, dy) > 0.0) and (
        _side(cx, cy, dx, dy, ax, ay) > 0.0
    ) != (_side(cx, cy, dx, dy, bx, by) > 0.0):
        return 0.0
    return min(
        min(point_segment_distance2(ax, ay, cx, cy, dx, dy), point_segment_distance2(bx, by, cx, cy, dx, dy)),
        min(point_segment_distance2(cx, cy, ax, ay, bx, by), point_segment_distance2(dx, dy, ax, ay, bx, by)),
    )

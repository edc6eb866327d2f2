"""Where a point of a floor is in the picture of draw_floor."""

from __future__ import annotations

from robocorba.map_editor.model import Building
from robocorba.map_editor.sheet import Frame
from robocorba.map_editor.spatial.pose import XY


def to_pixel(building: Building, floor: str, point: XY, width_px: int) -> tuple[int, int]:
    """Pixel column and row, from the top left, of a point [m]."""
    frame = Frame(building, floor, width_px, titled=True)
    return int((point[0] - frame.x0) * frame.scale), int((frame.y1 - point[1]) * frame.scale)

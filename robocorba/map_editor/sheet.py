"""Drawing surface for pictures of floors: the visible rectangle, shapes in metres and pixels, labels without overlap.

It uses matplotlib without pyplot, so that several threads may draw simultaneously.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from PIL import Image

from robocorba.map_editor import geometry
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import XY

INK, GROUND = "#1f2430", "#ffffff"
#: Sizes of a picture [pixels]: longest side, height of the title and of the legend.
MAX_PIXELS, HEAD_PX, FOOT_PX = 8000, 36, 34
#: Resolution of pictures [pixels per inch].
DPI = 100
#: Longer names are truncated [characters].
MAX_LABEL_LENGTH = 28
#: Characters of the font; a box replaces all others.
_LETTERS = frozenset(get_font(findfont("DejaVu Sans")).get_charmap())

#: Left, lower, right and upper limit [pixels].
PixelBox: TypeAlias = tuple[float, float, float, float]


class Frame:
    """The rectangle that a picture shows: `x0`, `y0`, `x1`, `y1` in m, `width` and `height` in pixels,
    and `scale` in pixels per metre."""

    def __init__(self, building: Building, floor: str, width_px: int, titled: bool) -> None:
        x0, y0, x1, y1 = geometry.bounds(building, floor, margin_m=0.0)
        margin = 0.02 * max(x1 - x0, y1 - y0) + 0.2
        head, foot = (HEAD_PX if titled else 0), FOOT_PX
        wide, high = x1 - x0 + 2 * margin, y1 - y0 + 2 * margin
        self.scale = min(width_px / wide, (MAX_PIXELS - head - foot) / high)
        self.width, self.height = width_px, max(160, head + foot + math.ceil(high * self.scale))
        self.x0 = (x0 + x1) / 2 - width_px / self.scale / 2  # centres a narrow floor
        self.y0 = y0 - margin - foot / self.scale
        self.x1, self.y1 = self.x0 + self.width / self.scale, self.y0 + self.height / self.scale

    def pixel(self, point: XY) -> XY:
        """Pixel coordinates of a point [m], from the lower left corner."""
        return (point[0] - self.x0) * self.scale, (point[1] - self.y0) * self.scale


class Sheet:
    """A picture of a frame to draw on.

    Positions are in m on the floor, widths and sizes in pixels. A higher `zorder` covers a lower one."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        figure = Figure(figsize=(frame.width / DPI, frame.height / DPI), dpi=DPI, facecolor=GROUND)
        self._canvas = FigureCanvasAgg(figure)
        self.axes: Axes = figure.add_axes((0, 0, 1, 1), frameon=False)
        self.axes.set(xlim=(frame.x0, frame.x1), ylim=(frame.y0, frame.y1), xticks=[], yticks=[])
        self._taken: list[PixelBox] = []
        self._letter_size = min(11.0, max(6.5, 0.26 * frame.scale))

    def image(self) -> Image.Image:
        """The finished picture. Nothing can be drawn afterwards."""
        self._canvas.draw()
        finished = Image.fromarray(np.asarray(self._canvas.buffer_rgba())[..., :3].copy(), "RGB")
        # A figure and its canvas refer to each other: the pixels, 66 MB if 4,000 wide, would wait for a full garbage
        # collection, and those of many pictures with them. Labels refer to the renderer, too.
        self.axes.figure.clear()
        del self._canvas.renderer
        return finished

    def px(self, metres: float, least: float, most: float) -> float:
        """The width of `metres` in pixels, limited to `least` and `most`."""
        return min(most, max(least, metres * self.frame.scale))

    def lines(self, lines: Sequence[Any], colour: str, width_px: float, zorder: float, **style: Any) -> None:
        """Draw polylines, each a sequence of points."""
        self.axes.add_collection(
            LineCollection(
                [np.asarray(line) for line in lines],
                colors=colour,
                linewidths=width_px * 72 / DPI,
                zorder=zorder,
                capstyle="round" if "linestyle" not in style else "butt",
                **style,
            )
        )

    def fill(self, corners: Any, colour: str, edge: str, width_px: float, zorder: float) -> None:
        """Draw a filled polygon with an edge of another colour."""
        patch = PolygonPatch(np.asarray(corners), facecolor=colour, edgecolor=edge, linewidth=width_px * 72 / DPI)
        patch.set_zorder(zorder)
        self.axes.add_patch(patch)

    def arrow(self, a: XY, b: XY, colour: str, size_px: float, zorder: float) -> None:
        """Draw an arrow head in the middle of a line."""
        length = math.dist(a, b)
        if length == 0:
            return
        step = 0.6 * size_px / self.frame.scale
        ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
        mx, my = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
        tip = (mx + step * ux, my + step * uy)
        sides = [(mx - step * ux + s * step * uy * 0.8, my - step * uy - s * step * ux * 0.8) for s in (1, -1)]
        self.fill([tip, *sides], colour, edge=GROUND, width_px=0.5, zorder=zorder + 0.5)

    def text(self, text: str, x: float, y: float, size: float, ha: str = "center", **style: Any) -> Text:
        """Write text at a point, above all layers. `size` in typographic points."""
        style = {"color": INK, "family": "DejaVu Sans"} | style
        halo = [withStroke(linewidth=2.2, foreground=GROUND)]
        style |= {"va": "center_baseline", "path_effects": halo, "zorder": 13, "parse_math": False}
        text = "".join(letter if ord(letter) in _LETTERS else "□" for letter in text)
        return self.axes.text(x, y, text, fontsize=size, ha=ha, **style)

    def keep_clear(self, point: XY) -> None:
        """Keep later labels off this point, by 3 pixels."""
        x, y = self.frame.pixel(point)
        self._taken.append((x - 3.0, y - 3.0, x + 3.0, y + 3.0))

    def label(
        self,
        text: str,
        at: XY,
        *,
        apart: float,
        colour: str = INK,
        bold: bool = False,
        scale: float = 1.0,
        must: bool = False,
        within: Sequence[float] | None = None,
    ) -> None:
        """Write a label `apart` pixels from a point, on the first free side. Without a free side it is omitted, unless
        it `must` be written. `within` is a box [m] that it has to fit into."""
        if not text:
            return
        shown = text if len(text) <= MAX_LABEL_LENGTH else f"{text[: MAX_LABEL_LENGTH - 2]}…"
        label = self.text(shown, *at, self._letter_size * scale, color=colour, weight="bold" if bold else "normal")
        box = label.get_window_extent(self._canvas.get_renderer())
        if within is not None and box.width > (within[2] - within[0]) * self.frame.scale - 4:
            label.remove()
            return
        x, y = self.frame.pixel(at)
        sides = _sides(apart, box.width, box.height, fixed=within is not None)
        boxes = [_around(x + dx, y + dy, box.width, box.height) for dx, dy in sides]
        free = (i for i, candidate in enumerate(boxes) if self._is_free(candidate))
        chosen = next(free, 0 if must else None)
        if chosen is None:
            label.remove()
            return
        dx, dy = sides[chosen]
        label.set_position((at[0] + dx / self.frame.scale, at[1] + dy / self.frame.scale))
        self._taken.append(boxes[chosen])

    def _is_free(self, box: PixelBox) -> bool:
        inside = box[0] >= 0 and box[2] <= self.frame.width
        return inside and not any(_overlap(box, other) for other in self._taken)


def _sides(apart: float, width: float, height: float, fixed: bool) -> list[XY]:
    """Offsets of a label's centre from its point [pixels], best first."""
    if apart == 0:
        return [(0.0, 0.0)] if fixed else [(0.0, 0.0), *((0.0, k * height) for k in (1.2, -1.2, 2.4, -2.4))]
    dx, dy = apart + width / 2, apart + height / 2
    return [(dx, dy), (dx, -dy), (-dx, dy), (-dx, -dy), (0.0, dy), (0.0, -dy), (dx, 0.0), (-dx, 0.0)]


def _around(x: float, y: float, width: float, height: float) -> PixelBox:
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def _overlap(one: PixelBox, other: PixelBox) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]

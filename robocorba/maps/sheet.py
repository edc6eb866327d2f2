"""A picture in the making: the part of the plane it shows, strokes in metres and pixels, and names that keep apart.

matplotlib's objects are used without pyplot, so that several threads may draw at once.
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

from robocorba.maps import geometry
from robocorba.maps.model import Building
from robocorba.spatial.pose import XY

INK, GROUND = "#1f2430", "#ffffff"
#: Longest side of a picture, least height, room for title and scale, pixels.
MAX_PIXELS, MIN_HEIGHT_PX, HEAD_PX, FOOT_PX = 8000, 160, 36, 34
DPI = 100
#: Longer names are cut.
MAX_LETTERS = 28
#: What the font can write; anything else is drawn as an empty box.
_LETTERS = frozenset(get_font(findfont("DejaVu Sans")).get_charmap())

#: Left, low, right and high, pixels.
Place: TypeAlias = tuple[float, float, float, float]


class Frame:
    """The part of the plane that a picture shows: `x0`, `y0`, `x1`, `y1` in m, `width` and `height` in pixels,
    and `scale` in pixels a metre."""

    def __init__(self, building: Building, floor: str, width_px: int, titled: bool) -> None:
        x0, y0, x1, y1 = geometry.bounds(building, floor, margin_m=0.0)
        margin = 0.02 * max(x1 - x0, y1 - y0) + 0.2
        head, foot = (HEAD_PX if titled else 0), FOOT_PX
        wide, high = x1 - x0 + 2 * margin, y1 - y0 + 2 * margin
        self.scale = min(width_px / wide, (MAX_PIXELS - head - foot) / high)
        self.width, self.height = width_px, max(MIN_HEIGHT_PX, head + foot + math.ceil(high * self.scale))
        self.x0 = (x0 + x1) / 2 - width_px / self.scale / 2  # a slim floor stands in the middle
        self.y0 = y0 - margin - foot / self.scale
        self.x1, self.y1 = self.x0 + self.width / self.scale, self.y0 + self.height / self.scale

    def pixel(self, point: XY) -> XY:
        """Pixels to the right of the left side, and above the lower one."""
        return (point[0] - self.x0) * self.scale, (point[1] - self.y0) * self.scale


class Sheet:
    """An empty picture of a frame, and what can be drawn on it.

    Places are in m on the floor, widths and sizes in pixels; a higher `zorder` covers a lower one."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        figure = Figure(figsize=(frame.width / DPI, frame.height / DPI), dpi=DPI, facecolor=GROUND)
        self._canvas = FigureCanvasAgg(figure)
        self.axes: Axes = figure.add_axes((0, 0, 1, 1), frameon=False)
        self.axes.set(xlim=(frame.x0, frame.x1), ylim=(frame.y0, frame.y1), xticks=[], yticks=[])
        self._taken: list[Place] = []
        self._letter_size = min(11.0, max(6.5, 0.26 * frame.scale))

    def image(self) -> Image.Image:
        """The picture as it is now."""
        self._canvas.draw()
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())[..., :3].copy(), "RGB")

    def px(self, metres: float, least: float, most: float) -> float:
        """A width that grows with the scale, in pixels."""
        return min(most, max(least, metres * self.frame.scale))

    def lines(self, lines: Sequence[Any], colour: str, width_px: float, zorder: float, **style: Any) -> None:
        """Polylines, each a sequence of points."""
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
        """A polygon with an edge of another colour."""
        patch = PolygonPatch(np.asarray(corners), facecolor=colour, edgecolor=edge, linewidth=width_px * 72 / DPI)
        patch.set_zorder(zorder)
        self.axes.add_patch(patch)

    def arrow(self, a: XY, b: XY, colour: str, size_px: float, zorder: float) -> None:
        """An arrow head in the middle of a line."""
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
        """Words around a place, over everything else; `size` in points."""
        style = {"color": INK, "family": "DejaVu Sans"} | style
        halo = [withStroke(linewidth=2.2, foreground=GROUND)]
        style |= {"va": "center_baseline", "path_effects": halo, "zorder": 13, "parse_math": False}
        text = "".join(letter if ord(letter) in _LETTERS else "□" for letter in text)
        return self.axes.text(x, y, text, fontsize=size, ha=ha, **style)

    def keep_clear(self, point: XY, reach_px: float = 3.0) -> None:
        """No name is written over this point from now on."""
        x, y = self.frame.pixel(point)
        self._taken.append((x - reach_px, y - reach_px, x + reach_px, y + reach_px))

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
        """Write a name `apart` pixels from a point, on the first side where nothing is written yet; else, unless it
        `must` be there, nowhere. `within` is a box (m) that it has to fit into."""
        if not text:
            return
        shown = text if len(text) <= MAX_LETTERS else f"{text[: MAX_LETTERS - 2]}…"
        label = self.text(shown, *at, self._letter_size * scale, color=colour, weight="bold" if bold else "normal")
        box = label.get_window_extent(self._canvas.get_renderer())
        if within is not None and box.width > (within[2] - within[0]) * self.frame.scale - 4:
            label.remove()
            return
        x, y = self.frame.pixel(at)
        sides = _sides(apart, box.width, box.height, fixed=within is not None)
        places = [_around(x + dx, y + dy, box.width, box.height) for dx, dy in sides]
        free = (i for i, place in enumerate(places) if self._is_free(place))
        chosen = next(free, 0 if must else None)
        if chosen is None:
            label.remove()
            return
        dx, dy = sides[chosen]
        label.set_position((at[0] + dx / self.frame.scale, at[1] + dy / self.frame.scale))
        self._taken.append(places[chosen])

    def _is_free(self, place: Place) -> bool:
        inside = place[0] >= 0 and place[2] <= self.frame.width
        return inside and not any(_overlap(place, other) for other in self._taken)


def _sides(apart: float, width: float, height: float, fixed: bool) -> list[XY]:
    """How far, in pixels, the middle of a name may be from its point, best first."""
    if apart == 0:
        return [(0.0, 0.0)] if fixed else [(0.0, 0.0), *((0.0, k * height) for k in (1.2, -1.2, 2.4, -2.4))]
    dx, dy = apart + width / 2, apart + height / 2
    return [(dx, dy), (dx, -dy), (-dx, dy), (-dx, -dy), (0.0, dy), (0.0, -dy), (dx, 0.0), (-dx, 0.0)]


def _around(x: float, y: float, width: float, height: float) -> Place:
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def _overlap(one: Place, other: Place) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]

"""The 2D simulator: renders a floor with its moving bodies as a PNG file.

matplotlib draws the static layer of a floor once. A picture is a copy of that layer with the moving parts drawn on top,
in palette colours, which encode several times as fast as true colours. The palette has each static colour twice: plain
and lit by a laser.
"""

from __future__ import annotations

import io
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import msgspec
import numpy as np
from matplotlib.font_manager import FontProperties, findfont
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidPicture
from robocorba.map_editor import drawing
from robocorba.map_editor.drawing import CABIN, CLOSED_SHAFT, DOOR, MOVABLE
from robocorba.map_editor.geometry import landing_line, shaft_polygon
from robocorba.map_editor.model import Building, Elevator, FloorMap
from robocorba.map_editor.movable import movables
from robocorba.map_editor.sheet import GROUND, HEAD_PX, INK, MAX_LABEL_LENGTH, Frame, Sheet
from robocorba.map_editor.spatial.elevator_state import ElevatorState
from robocorba.map_editor.spatial.floor_update import Body, BodyKind, FloorView
from robocorba.map_editor.spatial.pose import XY
from robocorba.simulation.robot_scans import LastScan

#: Minimum and maximum width of a picture [px].
MIN_WIDTH_PX, MAX_WIDTH_PX = 200, 4096
#: Time after its last picture for which a layer is kept [s].
UNUSED_LAYER_S = 60.0
#: Colours.
ROBOT, VELOCITY, LASER, UNMAPPED = "#7b2cbf", "#0b5d51", "#f03e3e", "#c4007a"
#: Share of the laser's colour in lit areas.
LIGHT = 0.2
#: Coordinates beyond this are not drawn [m].
_FAR_M = 1e9
#: Pixel coordinates are clipped to this, for Pillow [px].
_FAR_PX = 20_000.0
#: Width of the halo around letters [px].
_HALO_PX = 2
#: Shades between the colours of letters and ground.
_SHADES = 16
#: Colours of the moving parts.
_MOVING = (ROBOT, VELOCITY, LASER, UNMAPPED, MOVABLE, CABIN, CLOSED_SHAFT, DOOR)
#: Number of colours of the static layer. The palette has these, their lit versions, moving colours, and shades.
_STATIC = (256 - len(_MOVING) - _SHADES) // 2
#: Palette index of each moving colour.
_INDEX = {colour: 2 * _STATIC + i for i, colour in enumerate(_MOVING)} | {INK: 256 - _SHADES, GROUND: 255}
#: Colour and label; ~ marks a thin line.
_LEGEND = (
    (ROBOT, "robot"),
    (VELOCITY, "~velocity"),
    (LASER, "~laser"),
    (UNMAPPED, "in no map"),
    (MOVABLE, "movable object"),
    (drawing.FIXED, "object"),
    (DOOR, "~door"),
    (drawing.LOCKED, "~locked"),
    (CABIN, "cabin here"),
    (CLOSED_SHAFT, "elsewhere"),
)


class _Shaft(NamedTuple):
    """Shaft of an elevator that serves the floor [px]: its ground and the floor's doors."""

    name: str
    ground: list[XY]
    doors: list[list[XY]]


class _Layer(NamedTuple):
    """Static layer of a floor. elevation: of the floor [m]. pixels: indices into `palette`."""

    frame: Frame
    elevation: float
    pixels: Image.Image
    palette: bytes
    shafts: list[_Shaft]


class FloorPainter:
    """Draws the floors of `building`. Thread-safe. max_cached_px: maximum size of all cached layers [px], one byte
    each. clock: returns the time [s]."""

    def __init__(
        self, building: Building, max_cached_px: int = 64_000_000, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._building, self._max_cached_px, self._clock = building, max_cached_px, clock
        #: Layers by floor and width, and when their last pictures were drawn [s]; least recently used first.
        self._layers: OrderedDict[tuple[str, int], tuple[_Layer, float]] = OrderedDict()
        self._lock = threading.Lock()
        #: Held while a layer is drawn, so that no layer is drawn twice.
        self._drawing = threading.Lock()

    def png(self, view: FloorView, scans: Sequence[LastScan], width_px: int, caption: str = "") -> bytes:
        """Render a floor with these scans on it as a PNG file in the pixel coordinates of draw_floor; `view` must not
        change meanwhile.

        Skips bodies without a finite pose. The first picture of a floor and width takes as long as draw_floor. Raises
        UnknownFloor, and InvalidPicture for a width outside MIN_WIDTH_PX to MAX_WIDTH_PX."""
        if view.floor not in self._building.floors:
            raise UnknownFloor("picture", view.floor, list(self._building.floors))
        if not MIN_WIDTH_PX <= width_px <= MAX_WIDTH_PX:
            raise InvalidPicture("width", f"{width_px} is not {MIN_WIDTH_PX} to {MAX_WIDTH_PX} pixels")
        picture = _Picture(self._layer((view.floor, width_px)))
        picture.add_cabins(view.floor, view.elevators)
        picture.add_scans(scans)
        picture.add_bodies(view)
        picture.add_caption(caption)
        return picture.png()

    def forget_unused(self) -> None:
        """Drop the layers that no picture has needed for UNUSED_LAYER_S."""
        before = self._clock() - UNUSED_LAYER_S
        with self._lock:
            while self._layers and next(iter(self._layers.values()))[1] < before:
                self._layers.popitem(last=False)

    def _layer(self, key: tuple[str, int]) -> _Layer:
        layer = self._cached(key)
        if layer is None:
            with self._drawing:
                layer = self._cached(key) or self._cache(key, _layer(self._building, *key))
        return layer

    def _cached(self, key: tuple[str, int]) -> _Layer | None:
        with self._lock:
            if key not in self._layers:
                return None
            layer, _ = self._layers.pop(key)
            self._layers[key] = layer, self._clock()
            return layer

    def _cache(self, key: tuple[str, int], layer: _Layer) -> _Layer:
        with self._lock:
            self._layers[key] = layer, self._clock()
            while sum(math.prod(kept.pixels.size) for kept, _ in self._layers.values()) > self._max_cached_px:
                self._layers.popitem(last=False)
        return layer


class _Picture:
    """A copy of a layer with moving parts on top. Pixel (0, 0) is the top left."""

    def __init__(self, layer: _Layer) -> None:
        self._layer, self._frame = layer, layer.frame
        self._pixels = layer.pixels.copy()
        self._pen = ImageDraw.Draw(self._pixels)
        self._letter_px = round(_px(layer.frame, 0.36, 9, 15))

    def png(self) -> bytes:
        """Encode the picture; nothing can be drawn afterwards."""
        self._pixels.putpalette(self._layer.palette)
        buffer = io.BytesIO()
        self._pixels.save(buffer, "PNG", compress_level=1)
        return buffer.getvalue()

    def add_cabins(self, floor: str, states: Mapping[str, ElevatorState]) -> None:
        """Open doors of cabins at this floor, and mark shafts whose cabin is elsewhere.

        The layer shows every cabin at this floor with closed doors."""
        for shaft in self._layer.shafts:
            state, label = states.get(shaft.name), shaft.name
            if state is not None and state.floor == floor:
                for door in shaft.doors:
                    self._open(door, state.opening)
            else:
                self._pen.polygon(shaft.ground, _INDEX[CLOSED_SHAFT])
                if state is not None:
                    label += f" {'▲' if state.height > self._layer.elevation else '▼'} {state.floor}"
            self._write(label, *_middle(shaft.ground))

    def _open(self, door: list[XY], share: float) -> None:
        """Draw both leaves of a door open by a share of 0 to 1."""
        if not share > 0.0:
            return
        (ax, ay), (bx, by) = door
        left = max(0.0, 1.0 - share) / 2
        dx, dy = left * (bx - ax), left * (by - ay)
        self._pen.line(door, _INDEX[GROUND], round(_px(self._frame, 0.2, 4, 8)))
        for leaf in ((ax, ay, ax + dx, ay + dy), (bx, by, bx - dx, by - dy)):
            self._pen.line(leaf, _INDEX[DOOR], round(_px(self._frame, 0.09, 2, 4)))

    def add_scans(self, scans: Sequence[LastScan]) -> None:
        """Light the area of each scan, outline it, twice as wide if an actual robot's sensor made it, and mark the ends
        of rays that hit what no map has."""
        outlines = [(outline, scan) for scan in scans if len(outline := self._outline(scan)) > 2]
        light = Image.new("L", self._pixels.size)
        pen = ImageDraw.Draw(light)
        for outline, _ in outlines:
            pen.polygon(outline, 255)
        box = light.getbbox()
        if box is not None:
            lit = self._pixels.crop(box).point(lambda index: index + _STATIC if index < _STATIC else index)
            self._pixels.paste(lit, box, light.crop(box))
        for outline, scan in outlines:
            self._pen.polygon(outline, outline=_INDEX[LASER], width=1 if scan.is_virtual else 2)
            ends = outline[-len(scan.distances[_drawn_rays(scan)]) :]
            for (column, row), is_unmapped in zip(ends, scan.unmapped[_drawn_rays(scan)], strict=False):
                if is_unmapped:
                    self._pen.rectangle((column - 2, row - 2, column + 2, row + 2), _INDEX[UNMAPPED])

    def _outline(self, scan: LastScan) -> list[XY]:
        """Polygon of the sensor, unless rays are all around it, and of their ends [px]; empty for a sensor without a
        finite pose."""
        if not all(abs(value) < _FAR_M for value in (*scan.at[1:], scan.first_rad, scan.step_rad)):
            return []
        rays = np.arange(len(scan.distances))[_drawn_rays(scan)]
        angles = scan.at.heading + scan.first_rad + scan.step_rad * rays
        distances = np.nan_to_num(scan.distances[rays]).clip(0.0, _FAR_PX / self._frame.scale)
        x, y = distances * np.cos(angles), distances * np.sin(angles)
        is_round = len(scan.distances) * scan.step_rad > 2 * math.pi - scan.step_rad / 2
        begin = [] if is_round else [0.0]
        return _polygon(self._frame, scan.at.x + np.append(begin, x), scan.at.y + np.append(begin, y))

    def add_bodies(self, view: FloorView) -> None:
        """Draw objects, robots above them, and names above both."""
        visible = [
            (body, *motion[1:])
            for body, motion in zip(view.bodies.values(), view.motions.tolist(), strict=True)
            if all(abs(value) < _FAR_M for value in motion[4:])
        ]
        names = []
        for body, vx, vy, _, x, y, heading in sorted(visible, key=lambda row: row[0].kind is BodyKind.ROBOT):
            if body.kind is BodyKind.OBJECT:
                self._add_object(body, x, y, heading)
                continue
            (column, row), radius = _pixel(self._frame, x, y), _radius(self._frame, body)
            if -radius < column < self._frame.width + radius and -radius < row < self._frame.height + radius:
                self._add_robot(column, row, radius, heading, vx, vy)
                names.append((body.name, column, row + radius + 0.7 * self._letter_px))
        for name, column, row in names:
            self._write(name, column, row)

    def _add_object(self, body: Body, x: float, y: float, heading: float) -> None:
        """Draw an object, with its name if that fits on it."""
        if len(body.outline) < 3:
            return
        (ahead, aside), cos, sin = np.transpose(body.outline), math.cos(heading), math.sin(heading)
        corners = _polygon(self._frame, x + cos * ahead - sin * aside, y + sin * ahead + cos * aside)
        self._pen.polygon(corners, _INDEX[MOVABLE], _INDEX[INK])
        column, row = _middle(corners)
        if 0 <= column < self._frame.width and 0 <= row < self._frame.height:
            self._write(body.name, column, row, room_px=2 * (column - min(corners)[0]))

    def _add_robot(self, column: float, row: float, radius: float, heading: float, vx: float, vy: float) -> None:
        """Draw a robot. radius: [px]. vx, vy: velocity along the floor's axes [m/s]."""
        speed, course = math.hypot(vx, vy), math.atan2(vy, vx)
        if speed < math.inf:
            # The arrow shows the distance covered in a second.
            tip = _ahead(column, row, course, min(radius + speed * self._frame.scale, _FAR_PX))
            self._pen.line((column, row, *tip), _INDEX[VELOCITY], 2)
            self._pen.polygon(_wedge(*tip, course, min(4.0, radius / 2)), _INDEX[VELOCITY])
        for reach, colour in ((radius + 1, GROUND), (radius, ROBOT)):
            self._pen.ellipse((column - reach, row - reach, column + reach, row + reach), _INDEX[colour])
        front = _ahead(column, row, heading, 0.85 * radius)
        self._pen.polygon(_wedge(*front, heading, 0.3 * radius), _INDEX[GROUND])

    def add_caption(self, caption: str) -> None:
        """Draw a caption above the floor."""
        letters, halo = _render_text(caption[:200], round(min(18.0, max(10.0, self._frame.width / 50))), bold=True)
        self._pixels.paste(letters, (12, (HEAD_PX - letters.height) // 2), halo)

    def _write(self, name: str, column: float, row: float, room_px: float = math.inf) -> None:
        """Draw a name centred at a pixel, shifted to lie within the picture; skip a name wider than `room_px`."""
        shown = name if len(name) <= MAX_LABEL_LENGTH else f"{name[: MAX_LABEL_LENGTH - 2]}…"
        letters, halo = _render_name(shown, self._letter_px)
        if letters.width < room_px:
            left = min(max(0, round(column - letters.width / 2)), self._frame.width - letters.width)
            top = min(max(0, round(row - letters.height / 2)), self._frame.height - letters.height)
            self._pixels.paste(letters, (left, top), halo)


def _drawn_rays(scan: LastScan) -> slice:
    """At most 720 rays: of a larger scan every second one is drawn, or every third, and so on."""
    return slice(None, None, 1 + len(scan.distances) // 720)


def _layer(building: Building, floor: str, width_px: int) -> _Layer:
    """Draw the static layer of a floor, and quantize its colours."""
    frame = Frame(building, floor, width_px, titled=True)
    served = [elevator for elevator in building.elevators.values() if floor in elevator.floors()]
    drawn = _draw_static(frame, building, floor).quantize(_STATIC, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    return _Layer(
        frame,
        building.floors[floor].floor.elevation,
        Image.frombytes("L", drawn.size, drawn.tobytes()),
        _palette(drawn.getpalette() or []),
        [_shaft(frame, elevator, floor) for elevator in served],
    )


def _draw_static(frame: Frame, building: Building, floor: str) -> Image.Image:
    """Draw a floor without roads and movable objects; shafts that serve it are labelled later, with their cabins."""
    entry = building.floors[floor]
    movable = {item.name for item, where in movables(building).values() if where == floor}
    objects = {name: item for name, item in entry.geometrical.objects.items() if name not in movable}
    plan = msgspec.structs.replace(entry.geometrical, objects=objects)
    static_map = FloorMap(entry.floor, plan)
    building = msgspec.structs.replace(building, floors={**building.floors, floor: static_map})

    sheet = Sheet(frame)
    drawing.draw_geometrical_map(sheet, building, floor)
    drawing.draw_title_and_legend(sheet, "", _LEGEND)
    unserved = [elevator for elevator in building.elevators_through(floor) if floor not in elevator.floors()]
    drawing.write_labels(sheet, static_map, unserved, ())
    return sheet.image()


def _palette(static: Sequence[int]) -> bytes:
    """RGB palette built from the static colours."""
    colours = np.zeros((256, 3))
    colours[: len(static) // 3] = np.reshape(static, (-1, 3))
    colours[_STATIC : 2 * _STATIC] = colours[:_STATIC] * (1 - LIGHT) + LIGHT * np.array(ImageColor.getrgb(LASER))
    for colour, index in _INDEX.items():
        colours[index] = ImageColor.getrgb(colour)
    colours[-_SHADES:] = np.linspace(colours[-_SHADES], colours[-1], _SHADES)
    return np.rint(colours).astype(np.uint8).tobytes()


def _shaft(frame: Frame, elevator: Elevator, floor: str) -> _Shaft:
    shaft = shaft_polygon(elevator)
    within = shaft.buffer(-_px(frame, 0.1, 1.5, 4) / 2 / frame.scale, join_style="mitre")
    lines = [landing_line(elevator, door) for door in elevator.doors if door.floor == floor]
    ground = shaft if within.is_empty else within
    return _Shaft(
        elevator.name,
        [_pixel(frame, *corner) for corner in ground.exterior.coords],
        [[_pixel(frame, *end) for end in line.coords] for line in lines],
    )


def _px(frame: Frame, metres: float, minimum: float, maximum: float) -> float:
    """A length that scales with the drawing, within limits [px]; as Sheet.px."""
    return min(maximum, max(minimum, metres * frame.scale))


def _pixel(frame: Frame, x: float, y: float) -> XY:
    """Pixel coordinates of a point of the floor [m]."""
    return (x - frame.x0) * frame.scale, (frame.y1 - y) * frame.scale


def _polygon(frame: Frame, x: NDArray[np.float64], y: NDArray[np.float64]) -> list[XY]:
    """Pixel coordinates of corners, clipped to _FAR_PX."""
    columns, rows = (x - frame.x0) * frame.scale, (frame.y1 - y) * frame.scale
    return list(zip(columns.clip(-_FAR_PX, _FAR_PX).tolist(), rows.clip(-_FAR_PX, _FAR_PX).tolist(), strict=True))


def _radius(frame: Frame, body: Body) -> float:
    """Drawn radius of a robot [px], at least 3, for visibility."""
    return min(max(3.0, body.radius_m * frame.scale), _FAR_PX)


def _middle(corners: Sequence[XY]) -> XY:
    """Centre of the bounding box of corners."""
    columns, rows = zip(*corners, strict=True)
    return (min(columns) + max(columns)) / 2, (min(rows) + max(rows)) / 2


def _ahead(column: float, row: float, course: float, length: float) -> XY:
    """The pixel at a distance [px] from another, in the direction `course` [rad] on the floor."""
    return column + length * math.cos(course), row - length * math.sin(course)


def _wedge(column: float, row: float, course: float, size: float) -> list[XY]:
    """Triangle with its tip at a pixel, twice `size` long and wide."""
    dx, dy = size * math.cos(course), -size * math.sin(course)
    return [(column, row), (column - 2 * dx + dy, row - 2 * dy - dx), (column - 2 * dx - dy, row - 2 * dy + dx)]


@lru_cache(maxsize=1024)
def _render_name(text: str, letter_px: int) -> tuple[Image.Image, Image.Image]:
    """As _render_text; captions differ in each picture and are not cached."""
    return _render_text(text, letter_px, bold=False)


def _render_text(text: str, letter_px: int, bold: bool) -> tuple[Image.Image, Image.Image]:
    """Render a line of text: palette indices of its shades, and the mask of the text with its halo."""
    text = "".join(letter if letter.isprintable() else "□" for letter in text)
    font = _font(letter_px, bold)
    size = math.ceil(font.getlength(text)) + 2 * _HALO_PX, sum(font.getmetrics()) + 2 * _HALO_PX
    letters, halo = Image.new("L", size), Image.new("L", size)
    ImageDraw.Draw(letters).text((_HALO_PX, _HALO_PX), text, 255, font)
    ImageDraw.Draw(halo).text((_HALO_PX, _HALO_PX), text, 255, font, stroke_width=_HALO_PX)
    shades = letters.point(lambda coverage: 255 - round(coverage / 255 * (_SHADES - 1)))
    return shades, halo.point(lambda coverage: 255 if coverage >= 128 else 0)


@lru_cache(maxsize=32)
def _font(letter_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    file = findfont(FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal"))
    return ImageFont.truetype(file, letter_px, layout_engine=ImageFont.Layout.BASIC)

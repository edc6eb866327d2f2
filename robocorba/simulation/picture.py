"""The 2D simulator: a floor with all that moves on it, as a PNG file.

What stands is drawn once by matplotlib and kept. A picture is a copy of that, and the rest is drawn over it in colours
of a palette, which are several times as fast to encode as true colours. The palette has every colour of what stands
twice, the second time in the light of a laser.
"""

from __future__ import annotations

import io
import math
import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import msgspec
import numpy as np
from matplotlib.font_manager import FontProperties, findfont
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidPicture
from robocorba.maps import drawing
from robocorba.maps.drawing import CABIN, CLOSED_SHAFT, DOOR, MOVABLE
from robocorba.maps.geometry import landing_line, shaft_polygon
from robocorba.maps.model import Building, Elevator, FloorMap
from robocorba.maps.movable import movables
from robocorba.maps.sheet import GROUND, HEAD_PX, INK, MAX_LETTERS, Frame, Sheet
from robocorba.spatial.elevator_state import ElevatorState
from robocorba.spatial.floor_update import Body, BodyKind, FloorView
from robocorba.spatial.pose import XY

LEAST_WIDTH_PX, MOST_WIDTH_PX = 200, 4096
#: Of all layers that a painter keeps, a byte each.
MOST_KEPT_PX = 64_000_000
MAX_CAPTION = 200
ROBOT, VELOCITY, LASER = "#7b2cbf", "#0b5d51", "#f03e3e"
#: How much of its colour a laser gives to what it lights.
LIGHT = 0.2
#: Of a fan with this many rays or more, every second, third ... is drawn.
MOST_RAYS = 720
#: A robot's arrow is as long as its way in so many s.
ARROW_S = 1.0
#: Robots are no smaller, so that they can be seen.
LEAST_RADIUS_PX = 3.0
#: What is farther than this is not drawn, m; what is farther from the picture is drawn nearer, px.
_FAR_M, _FAR_PX = 1e9, 20_000.0
_HALO_PX = 2
#: Of letters, from their colour to that of the ground.
_SHADES = 16
_MOVING = (ROBOT, VELOCITY, LASER, MOVABLE, CABIN, CLOSED_SHAFT, DOOR)
#: How many colours what stands may have. The palette: these, the same in the light, those of what moves, the shades.
_STANDING = (256 - len(_MOVING) - _SHADES) // 2
_NUMBER = {colour: 2 * _STANDING + i for i, colour in enumerate(_MOVING)} | {INK: 256 - _SHADES, GROUND: 255}
#: By the number of a colour: its number in the light.
_LIT = [i + _STANDING if i < _STANDING else i for i in range(256)]
#: By how much a letter covers of a pixel, 0 to 255: the number of its shade; 255 where its halo is drawn, else 0.
_SHADE = [255 - round(i / 255 * (_SHADES - 1)) for i in range(256)]
_SOLID = [255 if i >= 128 else 0 for i in range(256)]
#: Colour and words; ~ marks what is drawn as a thin line.
_LEGEND = (
    (ROBOT, "robot"),
    (VELOCITY, "~velocity"),
    (LASER, "~laser"),
    (MOVABLE, "movable object"),
    (drawing.FIXED, "object"),
    (DOOR, "~door"),
    (drawing.LOCKED, "~locked"),
    (CABIN, "cabin here"),
    (CLOSED_SHAFT, "elsewhere"),
)


class ScanFan(NamedTuple):
    """What a laser at x, y (m) sees: `distances` in m of rays, the first at `first_rad` from its heading (rad), the
    others `step_rad` apart, counter-clockwise."""

    x: float
    y: float
    heading: float
    first_rad: float
    step_rad: float
    distances: NDArray[np.float64]


class _Shaft(NamedTuple):
    """An elevator that serves the floor, in pixels: the ground within, and the floor's doors."""

    name: str
    ground: list[XY]
    doors: list[list[XY]]


class _Layer(NamedTuple):
    """What stands on a floor. `pixels` are the numbers of colours in `palette`; `elevation` in m."""

    frame: Frame
    elevation: float
    pixels: Image.Image
    palette: bytes
    shafts: list[_Shaft]


class FloorPainter:
    """Draws the floors of `building`. Several threads may use one."""

    def __init__(self, building: Building) -> None:
        self._building = building
        #: By floor and width, what was used last at the end.
        self._layers: OrderedDict[tuple[str, int], _Layer] = OrderedDict()
        self._lock = threading.Lock()
        #: Held while a layer is drawn: nobody draws it a second time.
        self._drawing = threading.Lock()

    def png(self, view: FloorView, fans: Sequence[ScanFan], width_px: int, caption: str = "") -> bytes:
        """A floor as a PNG file, everything where drawing.to_pixel says; `view` must not change meanwhile.

        What has no finite place is left out. The first picture of a floor and a width takes as long as draw_floor does.
        Raises UnknownFloor, and InvalidPicture for a width outside LEAST_WIDTH_PX to MOST_WIDTH_PX."""
        if view.floor not in self._building.floors:
            raise UnknownFloor("picture", view.floor, list(self._building.floors))
        if not LEAST_WIDTH_PX <= width_px <= MOST_WIDTH_PX:
            raise InvalidPicture("width", f"{width_px} is not {LEAST_WIDTH_PX} to {MOST_WIDTH_PX} pixels")
        picture = _Picture(self._layer((view.floor, width_px)))
        picture.add_cabins(view.floor, view.elevators)
        picture.add_fans(fans)
        picture.add_bodies(view)
        picture.add_caption(caption)
        return picture.png()

    def _layer(self, key: tuple[str, int]) -> _Layer:
        layer = self._kept(key)
        if layer is None:
            with self._drawing:
                layer = self._kept(key) or self._keep(key, _layer(self._building, *key))
        return layer

    def _kept(self, key: tuple[str, int]) -> _Layer | None:
        with self._lock:
            if key in self._layers:
                self._layers.move_to_end(key)
            return self._layers.get(key)

    def _keep(self, key: tuple[str, int], layer: _Layer) -> _Layer:
        with self._lock:
            self._layers[key] = layer
            while sum(kept.frame.width * kept.frame.height for kept in self._layers.values()) > MOST_KEPT_PX:
                self._layers.popitem(last=False)
        return layer


class _Picture:
    """A copy of a layer, and what is drawn over it, from the ground up. Pixels count from the top left."""

    def __init__(self, layer: _Layer) -> None:
        self._layer, self._frame = layer, layer.frame
        self._pixels = layer.pixels.copy()
        self._pen = ImageDraw.Draw(self._pixels)
        self._letter_px = round(_px(layer.frame, 0.36, 9, 15))

    def png(self) -> bytes:
        """The picture as it is; nothing can be drawn any more."""
        self._pixels.putpalette(self._layer.palette)
        buffer = io.BytesIO()
        self._pixels.save(buffer, "PNG", compress_level=1)
        return buffer.getvalue()

    def add_cabins(self, floor: str, moments: Mapping[str, ElevatorState]) -> None:
        """A layer has all cabins, with closed doors: open the doors, and tell where a cabin is that is not here."""
        for shaft in self._layer.shafts:
            moment, says = moments.get(shaft.name), shaft.name
            if moment is not None and moment.floor == floor:
                for door in shaft.doors:
                    self._open(door, moment.opening)
            else:
                self._pen.polygon(shaft.ground, _NUMBER[CLOSED_SHAFT])
                if moment is not None:
                    says += f" {'▲' if moment.height > self._layer.elevation else '▼'} {moment.floor}"
            self._write(says, *_middle(shaft.ground))

    def _open(self, door: list[XY], share: float) -> None:
        """Let both leaves of a closed door withdraw by a share of their way."""
        if not share > 0.0:
            return
        (ax, ay), (bx, by) = door
        left = max(0.0, 1.0 - share) / 2
        dx, dy = left * (bx - ax), left * (by - ay)
        self._pen.line(door, _NUMBER[GROUND], round(_px(self._frame, 0.2, 4, 8)))
        for leaf in ((ax, ay, ax + dx, ay + dy), (bx, by, bx - dx, by - dy)):
            self._pen.line(leaf, _NUMBER[DOOR], round(_px(self._frame, 0.09, 2, 4)))

    def add_fans(self, fans: Sequence[ScanFan]) -> None:
        """Light what lies between lasers and what they see, with a line around each fan."""
        outlines = [outline for fan in fans if len(outline := self._outline(fan)) > 2]
        light = Image.new("L", self._pixels.size)
        pen = ImageDraw.Draw(light)
        for outline in outlines:
            pen.polygon(outline, 255)
        box = light.getbbox()
        if box is not None:
            self._pixels.paste(self._pixels.crop(box).point(_LIT), box, light.crop(box))
        for outline in outlines:
            self._pen.polygon(outline, outline=_NUMBER[LASER])

    def _outline(self, fan: ScanFan) -> list[XY]:
        """The laser, and where its rays end; nothing for one without a place."""
        if not all(abs(value) < _FAR_M for value in fan[:5]):
            return []
        rays = np.arange(0, len(fan.distances), 1 + len(fan.distances) // MOST_RAYS)
        angles = fan.heading + fan.first_rad + fan.step_rad * rays
        seen = np.nan_to_num(fan.distances[rays]).clip(0.0, _FAR_PX / self._frame.scale)
        x, y = seen * np.cos(angles), seen * np.sin(angles)
        return _polygon(self._frame, fan.x + np.append(0.0, x), fan.y + np.append(0.0, y))

    def add_bodies(self, view: FloorView) -> None:
        """Objects, over them robots, over them names."""
        found = [
            (body, *motion[1:])
            for body, motion in zip(view.bodies.values(), view.motions.tolist(), strict=True)
            if all(abs(value) < _FAR_M for value in motion[4:])
        ]
        names = []
        for body, vx, vy, _, x, y, heading in sorted(found, key=lambda row: row[0].kind is BodyKind.ROBOT):
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
        """With its name, where that has room on it."""
        if len(body.outline) < 3:
            return
        (ahead, aside), cos, sin = np.transpose(body.outline), math.cos(heading), math.sin(heading)
        corners = _polygon(self._frame, x + cos * ahead - sin * aside, y + sin * ahead + cos * aside)
        self._pen.polygon(corners, _NUMBER[MOVABLE], _NUMBER[INK])
        column, row = _middle(corners)
        if 0 <= column < self._frame.width and 0 <= row < self._frame.height:
            self._write(body.name, column, row, room_px=2 * (column - min(corners)[0]))

    def _add_robot(self, column: float, row: float, radius: float, heading: float, vx: float, vy: float) -> None:
        """`radius` in pixels, the velocity in m/s along the floor's axes."""
        speed, course = math.hypot(vx, vy), math.atan2(vy, vx)
        if speed < math.inf:
            tip = _ahead(column, row, course, min(radius + ARROW_S * speed * self._frame.scale, _FAR_PX))
            self._pen.line((column, row, *tip), _NUMBER[VELOCITY], 2)
            self._pen.polygon(_wedge(*tip, course, min(4.0, radius / 2)), _NUMBER[VELOCITY])
        for reach, colour in ((radius + 1, GROUND), (radius, ROBOT)):
            self._pen.ellipse((column - reach, row - reach, column + reach, row + reach), _NUMBER[colour])
        front = _ahead(column, row, heading, 0.85 * radius)
        self._pen.polygon(_wedge(*front, heading, 0.3 * radius), _NUMBER[GROUND])

    def add_caption(self, caption: str) -> None:
        """A line above the floor."""
        letters, halo = _written(caption[:MAX_CAPTION], round(min(18.0, max(10.0, self._frame.width / 50))), bold=True)
        self._pixels.paste(letters, (12, (HEAD_PX - letters.height) // 2), halo)

    def _write(self, name: str, column: float, row: float, room_px: float = math.inf) -> None:
        """A name around a place, moved as far as the picture needs; nothing where it is wider than its room."""
        shown = name if len(name) <= MAX_LETTERS else f"{name[: MAX_LETTERS - 2]}…"
        letters, halo = _name(shown, self._letter_px)
        if letters.width < room_px:
            left = min(max(0, round(column - letters.width / 2)), self._frame.width - letters.width)
            top = min(max(0, round(row - letters.height / 2)), self._frame.height - letters.height)
            self._pixels.paste(letters, (left, top), halo)


def _layer(building: Building, floor: str, width_px: int) -> _Layer:
    """Draw what stands, and find a palette for it."""
    frame = Frame(building, floor, width_px, titled=True)
    served = [elevator for elevator in building.elevators.values() if floor in elevator.floors()]
    drawn = _draw_standing(frame, building, floor).quantize(
        _STANDING, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    )
    return _Layer(
        frame,
        building.floors[floor].floor.elevation,
        Image.frombytes("L", drawn.size, drawn.tobytes()),
        _palette(drawn.getpalette() or []),
        [_shaft(frame, elevator, floor) for elevator in served],
    )


def _draw_standing(frame: Frame, building: Building, floor: str) -> Image.Image:
    """No roads, nothing that can be moved; elevators that serve the floor get their names with their cabins."""
    entry = building.floors[floor]
    moving = {thing.name for thing, where in movables(building).values() if where == floor}
    objects = {name: thing for name, thing in entry.geometrical.objects.items() if name not in moving}
    plan = msgspec.structs.replace(entry.geometrical, objects=objects)
    standing = FloorMap(entry.floor, plan)
    building = msgspec.structs.replace(building, floors={**building.floors, floor: standing})

    sheet = Sheet(frame)
    drawing.draw_standing(sheet, building, floor)
    drawing.draw_furniture(sheet, "", _LEGEND)
    elsewhere = [elevator for elevator in building.elevators.values() if floor not in elevator.floors()]
    drawing.write_names(sheet, standing, elsewhere, ())
    return sheet.image()


def _palette(standing: Sequence[int]) -> bytes:
    """Red, green and blue of all colours, from those of what stands."""
    colours = np.zeros((256, 3))
    colours[: len(standing) // 3] = np.reshape(standing, (-1, 3))
    colours[_STANDING : 2 * _STANDING] = colours[:_STANDING] * (1 - LIGHT) + LIGHT * np.array(ImageColor.getrgb(LASER))
    for colour, number in _NUMBER.items():
        colours[number] = ImageColor.getrgb(colour)
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


def _px(frame: Frame, metres: float, least: float, most: float) -> float:
    """A width that grows with the scale, as Sheet.px."""
    return min(most, max(least, metres * frame.scale))


def _pixel(frame: Frame, x: float, y: float) -> XY:
    return (x - frame.x0) * frame.scale, (frame.y1 - y) * frame.scale


def _polygon(frame: Frame, x: NDArray[np.float64], y: NDArray[np.float64]) -> list[XY]:
    """The same for corners, none of them too far away for Pillow."""
    columns, rows = (x - frame.x0) * frame.scale, (frame.y1 - y) * frame.scale
    return list(zip(columns.clip(-_FAR_PX, _FAR_PX).tolist(), rows.clip(-_FAR_PX, _FAR_PX).tolist(), strict=True))


def _radius(frame: Frame, body: Body) -> float:
    """In pixels."""
    return min(max(LEAST_RADIUS_PX, body.radius_m * frame.scale), _FAR_PX)


def _middle(corners: Sequence[XY]) -> XY:
    """Of the box around them."""
    columns, rows = zip(*corners, strict=True)
    return (min(columns) + max(columns)) / 2, (min(rows) + max(rows)) / 2


def _ahead(column: float, row: float, course: float, length: float) -> XY:
    """So many pixels from a place, on a course in rad on the floor."""
    return column + length * math.cos(course), row - length * math.sin(course)


def _wedge(column: float, row: float, course: float, size: float) -> list[XY]:
    """A triangle with its tip there, two sizes long and wide."""
    dx, dy = size * math.cos(course), -size * math.sin(course)
    return [(column, row), (column - 2 * dx + dy, row - 2 * dy - dx), (column - 2 * dx - dy, row - 2 * dy + dx)]


@lru_cache(maxsize=1024)
def _name(text: str, letter_px: int) -> tuple[Image.Image, Image.Image]:
    return _written(text, letter_px, bold=False)


def _written(text: str, letter_px: int, bold: bool) -> tuple[Image.Image, Image.Image]:
    """A line of text as numbers of shades, and as a mask of it and its halo."""
    text = "".join(letter if letter.isprintable() else "□" for letter in text)
    font = _font(letter_px, bold)
    size = math.ceil(font.getlength(text)) + 2 * _HALO_PX, sum(font.getmetrics()) + 2 * _HALO_PX
    letters, halo = Image.new("L", size), Image.new("L", size)
    ImageDraw.Draw(letters).text((_HALO_PX, _HALO_PX), text, 255, font)
    ImageDraw.Draw(halo).text((_HALO_PX, _HALO_PX), text, 255, font, stroke_width=_HALO_PX)
    return letters.point(_SHADE), halo.point(_SOLID)


@lru_cache(maxsize=32)
def _font(letter_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    file = findfont(FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal"))
    return ImageFont.truetype(file, letter_px, layout_engine=ImageFont.Layout.BASIC)

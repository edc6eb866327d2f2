"""Pictures of robots for a film: all their links, from above and from the side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from matplotlib.font_manager import findfont
from PIL import Image, ImageDraw, ImageFont

from robocorba.clients.hand_over_facts import in_building
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.model import Solid, links
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.motion.robot_state import RobotState

GROUND, FLOOR, INK, EDGE = "#ffffff", "#eef0f3", "#1f2430", "#5a6270"
#: Pictures are drawn larger by this factor and then reduced, for smooth edges.
SUPERSAMPLING = 2
#: Height of the line of text, size of its font, and gap between the two views [pixels].
HEAD_PX, FONT_PX, GAP_PX = 26, 12, 6
#: Height of the side view [m].
HEIGHT_M = 1.5
Colour = tuple[int, int, int]


class ConvexShape(NamedTuple):
    """The convex hull of points (n, 3) [m]."""

    points: Floats
    colour: Colour


class RobotShapes:
    """The shapes of a robot's links."""

    def __init__(self) -> None:
        self.body = SmartPalBody()
        self._links = [(link.name, _shape(solid)) for link in links() for solid in link.solids]

    def at(self, state: RobotState) -> list[ConvexShape]:
        """The links at a state, in the building's frame with the floor at z = 0."""
        frames = self.body.frames(state.joints)
        found = []
        for name, shape in self._links:
            position, rotation = frames[name]
            points = shape.points @ rotation.T + position
            found.append(ConvexShape(in_building(points, state), shape.colour))
        return found


class Views:
    """Pictures of an area from the top, and below it from -y. west, south, east, north: bounds of
    the area [m]."""

    def __init__(self, west: float, south: float, east: float, north: float, px_per_m: int = 150) -> None:
        self._west, self._north, self._scale = west, north, px_per_m * SUPERSAMPLING
        self._width = round((east - west) * px_per_m)
        self._above, self._beside = round((north - south) * px_per_m), round(HEIGHT_M * px_per_m)
        self._font = ImageFont.truetype(findfont("DejaVu Sans"), FONT_PX * SUPERSAMPLING)
        self.size = self._width + self._width % 2, _even(HEAD_PX + self._above + GAP_PX + self._beside)

    def draw(self, shapes: Sequence[ConvexShape], words: Iterable[tuple[float, str]]) -> Image.Image:
        """Draw shapes and words. words: texts at the top, each with its left edge as a share of the width."""
        image = Image.new("RGB", (self.size[0] * SUPERSAMPLING, self.size[1] * SUPERSAMPLING), GROUND)
        canvas = ImageDraw.Draw(image)
        top = HEAD_PX * SUPERSAMPLING
        canvas.rectangle((0, top, image.width, top + self._above * SUPERSAMPLING), FLOOR)
        from_above = sorted(shapes, key=lambda shape: float(shape.points[:, 2].max()))
        self._fill(canvas, from_above, 1, (self._west, self._north), top)
        # The top view overflows into the side view.
        below = top + self._above * SUPERSAMPLING
        canvas.rectangle((0, below, image.width, image.height), GROUND)
        from_beside = sorted(shapes, key=lambda shape: -float(shape.points[:, 1].min()))
        self._fill(canvas, from_beside, 2, (self._west, HEIGHT_M), below + GAP_PX * SUPERSAMPLING)
        canvas.rectangle((0, 0, image.width, top - 1), GROUND)
        for share, text in words:
            canvas.text((share * image.width + 8 * SUPERSAMPLING, 7 * SUPERSAMPLING), text, INK, self._font)
        return image.reduce(SUPERSAMPLING)

    def _fill(
        self,
        canvas: ImageDraw.ImageDraw,
        shapes: Sequence[ConvexShape],
        upwards: int,
        corner: tuple[float, float],
        top: int,
    ) -> None:
        """Fill the shapes one over the other: x to the right, the axis `upwards` up. corner: the upper
        left one."""
        points = np.vstack([shape.points for shape in shapes])
        pixels = np.column_stack((points[:, 0] - corner[0], corner[1] - points[:, upwards])) * self._scale + (0, top)
        owner = np.repeat(np.arange(len(shapes)), [len(shape.points) for shape in shapes])
        hulls = shapely.convex_hull(shapely.multipoints(pixels, indices=owner))
        for shape, hull in zip(shapes, hulls, strict=True):
            outline = shapely.get_coordinates(hull).ravel().tolist()
            if hull.area > hull.length / 2:
                canvas.polygon(outline, shape.colour, EDGE)
            else:  # seen edge-on
                canvas.line(outline, shape.colour, 2 * SUPERSAMPLING)


def sheet(hand: HandPose, state: RobotState, long_m: float, wide_m: float, held_m: float) -> ConvexShape:
    """A sheet of paper held at one end. held_m: depth of the grip."""
    corners = [(ahead, aside, 0.0) for ahead in (-held_m, long_m - held_m) for aside in (-wide_m / 2, wide_m / 2)]
    points = np.array(corners) @ hand.rotation.T + hand.position
    return ConvexShape(in_building(points, state), (214, 23, 110))


def _shape(solid: Solid) -> ConvexShape:
    """The shape of a solid, in the frame of its link."""
    points = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * solid.half
    if solid.radius_m:  # a sphere, or a capsule: two of them
        turns = np.linspace(0.0, math.tau, 12, endpoint=False)
        tilts = np.linspace(-math.pi / 2, math.pi / 2, 7)[:, None]
        ball = solid.radius_m * np.stack(
            (np.cos(tilts) * np.cos(turns), np.cos(tilts) * np.sin(turns), np.sin(tilts) + 0 * turns), axis=-1
        ).reshape(-1, 3)
        half = np.array(solid.half)
        points = np.vstack((ball - half, ball + half))
    red, green, blue = (round(255 * part) for part in solid.colour[:3])
    return ConvexShape(points + solid.at, (red, green, blue))


def _even(px: int) -> int:
    return px + px % 2

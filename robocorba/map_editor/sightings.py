"""What robots have seen that no map has: how they publish it, and which of their sightings are of one thing.

A channel's conjunction finds events of two robots at the same time, but its patterns compare type and source only, and
it uses each event once: so an event has everything that its robot sees, and the places are compared here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Any

import msgspec
import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.element_rules import MAX_NUMBER
from robocorba.map_editor.spatial.pose import XY
from robocorba.system.decoding import convert

#: Greatest gap between outlines of one thing [m]: robots see different sides of it. No robot fits through such a gap.
SAME_THING_M = 0.3
#: Maximum number of obstacles in an event.
MAX_SEEN = 100
#: By how much a thing is grown that has no area, such as one seen from one side [m].
THIN_M = 0.02

Metres = Annotated[float, msgspec.Meta(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]


class SeenObstacle(msgspec.Struct):
    """Something that a robot sees and its map lacks. number: the robot's own, of the thing as long as it knows it. x,
    y: its middle [m]. outline: corners around it, as far as it is seen [m]. certainty: 0 to 1. known_s, unseen_s: how
    long ago it was seen first, and last [s]."""

    number: int
    floor: str
    x: Metres
    y: Metres
    outline: Annotated[tuple[tuple[Metres, Metres], ...], msgspec.Meta(min_length=1, max_length=128)]
    certainty: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
    known_s: Seconds = 0.0
    unseen_s: Seconds = 0.0


class ObstaclesSeen(msgspec.Struct):
    """The payload of obstacle.seen: everything that the robot which is the event's source sees at present."""

    obstacles: Annotated[tuple[SeenObstacle, ...], msgspec.Meta(max_length=MAX_SEEN)]


def seen_of(payload: Any) -> tuple[SeenObstacle, ...]:
    """What the payload of an event says; nothing for one that is not valid: other programs may publish, too."""
    try:
        return convert(payload, ObstaclesSeen).obstacles
    except msgspec.DecodeError:
        return ()


def shape_of(outline: Iterable[XY]) -> BaseGeometry:
    """The convex polygon around points [m]; a point or a line is grown to one."""
    points = list(outline)
    hull: BaseGeometry = shapely.convex_hull(shapely.linestrings([*points, points[0]]))
    return hull if hull.area > THIN_M**2 else hull.buffer(THIN_M, cap_style="square")


def corners(shape: BaseGeometry) -> tuple[XY, ...]:
    """The corners of a convex polygon [m], without those that matter less than a centimetre."""
    simple = shape.simplify(0.01)
    return tuple(simple.exterior.coords[:-1]) if isinstance(simple, Polygon) else ()


def is_same(one: BaseGeometry, other: BaseGeometry) -> bool:
    """Whether two shapes on a floor can be of one thing."""
    return bool(one.distance(other) <= SAME_THING_M)


def same_things(
    one: Sequence[SeenObstacle], other: Sequence[SeenObstacle]
) -> Iterator[tuple[SeenObstacle, SeenObstacle]]:
    """What two robots both see. Where several things are near each other, the nearest ones belong together."""
    if not one or not other:
        return
    ours, theirs = (np.array([shape_of(each.outline) for each in seen], object) for seen in (one, other))
    gaps = shapely.distance(ours[:, None], theirs)
    is_floor = np.array([[a.floor == b.floor for b in other] for a in one])
    rows, columns = np.nonzero(is_floor & (gaps <= SAME_THING_M))
    apart = shapely.distance(shapely.centroid(ours[rows]), shapely.centroid(theirs[columns]))
    left_ours, left_theirs = set(rows.tolist()), set(columns.tolist())
    for pair in np.lexsort((apart, gaps[rows, columns])):
        row, column = int(rows[pair]), int(columns[pair])
        if row in left_ours and column in left_theirs:
            left_ours.remove(row)
            left_theirs.remove(column)
            yield one[row], other[column]

"""The static obstacles of a floor as parts that the physics knows, segments and solid polygons.

Parts are compared by their places, so that an edit changes only what differs, however many obstacles a floor has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.grids import segments_of

#: A segment as x, y, x, y [m], or a polygon as WKB.
StaticPart = tuple[float, float, float, float] | bytes
#: Keys in the order in which they are added, on which results depend, without values.
StaticParts = dict[StaticPart, None]
#: Parts to be removed, and to be added.
StaticChange = tuple[list[StaticPart], list[StaticPart]]
#: Maximum number of parts that are changed between two steps: 5 ms of work.
MAX_CHANGES = 250


def static_parts(obstacles: Iterable[BaseGeometry]) -> StaticParts:
    """The parts of lines and solid polygons, polygons first."""
    parts = shapely.get_parts([shape for shape in obstacles if not shape.is_empty])
    is_solid = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    segments = map(tuple, segments_of(parts[~is_solid])[0].tolist())
    return dict.fromkeys(chain(shapely.to_wkb(parts[is_solid]).tolist(), segments))


def changes_between(before: Mapping[StaticPart, object], after: StaticParts) -> Iterator[StaticChange]:
    """What makes `before` to `after`, in changes of at most MAX_CHANGES parts: removed and added ones."""
    removed, added = [part for part in before if part not in after], [part for part in after if part not in before]
    for first in range(0, len(removed), MAX_CHANGES):
        yield removed[first : first + MAX_CHANGES], []
    for first in range(0, len(added), MAX_CHANGES):
        yield [], added[first : first + MAX_CHANGES]

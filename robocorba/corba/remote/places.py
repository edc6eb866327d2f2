"""Start positions for robots on the map."""

from __future__ import annotations

from collections.abc import Iterator

from robocorba.corba.conversion import maps
from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import translated
from robocorba.errors.paths import UnknownFloor
from robocorba.maps.model import PathNode
from robocorba.stubs import RoboCorba

#: Timeout to find the map editor [s].
RESOLVE_TIMEOUT_S = 5.0


def path_node_positions(orb: Orb, floor: str) -> Iterator[tuple[str, float, float]]:
    """Floor, x and y [m] of the path nodes of a floor (of the first floor if `floor` is empty).

    Raises UnknownFloor, NotReachable."""
    editor = orb.resolve("MapEditor", RoboCorba.MapEditor, RESOLVE_TIMEOUT_S)
    with translated("the map editor"):
        floors = [maps.element_of(record.value).name for record in editor.elements(RoboCorba.FLOOR_ELEMENT, "")]
        if floor and floor not in floors:
            raise UnknownFloor("floor", floor, floors)
        chosen = floor or floors[0]
        for record in editor.elements(RoboCorba.NODE_ELEMENT, chosen):
            node = maps.element_of(record.value)
            assert isinstance(node, PathNode)
            yield chosen, *node.at

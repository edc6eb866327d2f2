"""Where elements are: the places of problems, for editors that show them on the map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robocorba.errors.maps import InvalidElement, MapError, StaleEdit
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.model import (
    Area,
    Building,
    Door,
    ElementKind,
    Elevator,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    Wall,
)
from robocorba.map_editor.spatial.pose import XY


def placed(problem: Any, *buildings: Building) -> Finding:
    """A problem of an element (InvalidElement, StaleEdit, UnknownElement or DuplicateElement) as a finding at the place
    of the element in the first of the buildings that has it."""
    kind = ElementKind(problem.kind)
    found = (place_of(building, kind, problem.floor, problem.name) for building in buildings)
    where = next((place for place in found if place is not None), (problem.floor, 0.0, 0.0))
    return Finding(kind, problem.floor, problem.name, where, _reason(problem))


def place_of(building: Building, kind: ElementKind, floor: str, name: str) -> tuple[str, float, float] | None:
    """Floor, x and y [m] of an element's middle: of an edge between its nodes, of a floor within its outline.

    None if there is no such element."""
    element = building.find(kind, floor, name)
    if element is None:
        return None
    if isinstance(element, Floor):
        return (element.name, *_mean(element.outline))
    if isinstance(element, Elevator):
        served = [each for each in element.floors() if each in building.floors]
        return (served[0] if served else "", *element.at)
    if isinstance(element, PathEdge):
        nodes = building.floors[floor].topological.nodes
        return (floor, *_mean([nodes[end].at for end in (element.a, element.b) if end in nodes]))
    return (floor, *_middle(element))


def _middle(element: Wall | Door | Area | MapObject | PathNode) -> XY:
    if isinstance(element, Area):
        return _mean(element.polygon)
    return _mean([element.a, element.b]) if isinstance(element, Wall | Door) else element.at


def _mean(points: Sequence[XY]) -> XY:
    count = max(len(points), 1)
    return sum(x for x, _ in points) / count, sum(y for _, y in points) / count


def _reason(problem: MapError) -> str:
    if isinstance(problem, InvalidElement):
        return problem.reason
    return "another client has changed it since" if isinstance(problem, StaleEdit) else str(problem)

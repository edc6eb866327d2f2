"""Elements for the tests of editors, and buildings made of elements."""

from __future__ import annotations

from typing import TypeAlias

from robocorba.map_editor.changes import Change, ElementKey, apply
from robocorba.map_editor.model import Building, Element, ElementKind, Wall

WALL, NODE, EDGE, FLOOR, ELEVATOR = (
    *(ElementKind.WALL, ElementKind.NODE, ElementKind.EDGE),
    *(ElementKind.FLOOR, ElementKind.ELEVATOR),
)
Elements: TypeAlias = dict[ElementKey, Element]


def wall(name: str, x: float = 2.0) -> Wall:
    return Wall(name=name, a=(x, 1.0), b=(x, 2.0))


def building_of(elements: Elements) -> Building:
    """A building put together from nothing but its elements."""
    first = sorted(elements, key=lambda key: key.kind is not FLOOR)
    return apply(Building("two floors"), [Change(1, key, None, elements[key]) for key in first])

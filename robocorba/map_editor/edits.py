"""Edits and problems as clients read them: who changed what, in words; what is wrong, and where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from robocorba.errors.maps import InvalidElement, MapError, StaleEdit
from robocorba.map_editor.changes import Change, ChangeKind
from robocorba.map_editor.model import Area, Building, Door, Element, ElementKind, Elevator, Floor, PathEdge, Wall
from robocorba.map_editor.spatial.pose import XY


class EditRecord(NamedTuple):
    """One edit: a change or a transaction to `version`.

    author: empty if it was made without a session. time_s: seconds since 1970, 0 if unknown. changes: their number.
    summary: such as "wall w1 on L1 created"."""

    version: int
    author: str
    time_s: float
    changes: int
    summary: str


class MapChange(NamedTuple):
    """One element after the change to `version`; the removed element if it was removed.

    floor: empty for floors and elevators."""

    version: int
    kind: ChangeKind
    floor: str
    element: Element


class Finding(NamedTuple):
    """A restriction or a broken rule: the element, `where` it is (floor, x and y [m]), and a sentence.

    summary: the sentence for all findings of the same kind, with {n} for their number and {names} for their `subject`s;
    empty for broken rules, and for findings of another process."""

    kind: ElementKind
    floor: str
    name: str
    where: tuple[str, float, float]
    reason: str
    summary: str = ""
    subject: str = ""


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
    if isinstance(element, Area):
        return (floor, *_mean(element.polygon))
    if isinstance(element, Wall | Door):
        return (floor, *_mean((element.a, element.b)))
    return (floor, *element.at)


def _mean(points: Sequence[XY]) -> XY:
    count = max(len(points), 1)
    return sum(x for x, _ in points) / count, sum(y for _, y in points) / count


def _reason(problem: MapError) -> str:
    if isinstance(problem, InvalidElement):
        return problem.reason
    return "another client has changed it since" if isinstance(problem, StaleEdit) else str(problem)


def summary_of(changes: Sequence[Change]) -> str:
    """What an edit changed, such as "wall w1 on L1 created" or "3 walls on L1 removed, node n on L1 changed"."""
    groups: dict[tuple[ElementKind, str, ChangeKind], list[str]] = {}
    for change in changes:
        groups.setdefault((change.key.kind, change.floor, change.kind), []).append(change.key.name)
    parts = [_group(kind, floor, what, names) for (kind, floor, what), names in groups.items()]
    if len(parts) > 3:
        parts[3:] = ["and more"]
    return shortened(", ".join(parts))


def renamed(kind: ElementKind, floor: str, name: str, new_name: str) -> str:
    """The summary of a rename."""
    return shortened(f"{kind.value} {name}{f' on {floor}' if floor else ''} renamed to {new_name}")


def shortened(summary: str) -> str:
    """A summary of at most 300 characters; names may have 200."""
    return summary if len(summary) <= 300 else f"{summary[:299]}…"


def _group(kind: ElementKind, floor: str, what: ChangeKind, names: Sequence[str]) -> str:
    where = f" on {floor}" if floor else ""
    subject = f"{kind.value} {names[0]}" if len(names) == 1 else f"{len(names)} {kind.value}s"
    return f"{subject}{where} {what.value}"

"""Losses of a conversion between formats, and its assumptions: one sentence for each kind."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import msgspec

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor import validation
from robocorba.map_editor.model import Building, ElementKind
from robocorba.map_editor.yaml_file import YamlFile

#: Names listed in one sentence; the others are counted.
MAX_NAMES_LISTED = 12
#: The position of a collision at the end of a reason: removed, since it differs from edge to edge.
_POSITION = re.compile(r" near \S+, \S+$")


class Imported(msgspec.Struct, frozen=True):
    """An imported building, the name of its format, and a sentence for each kind of loss."""

    building: Building
    format: str
    losses: tuple[str, ...] = ()


class Exported(msgspec.Struct, frozen=True):
    """The content of each file of an exported building, and a sentence for each kind of loss."""

    files: dict[Path, bytes]
    losses: tuple[str, ...] = ()


class Losses:
    """Collects losses. Equal ones become one sentence with the number and names of their subjects."""

    def __init__(self) -> None:
        self._subjects: dict[str, list[str]] = {}

    def add(self, sentence: str, subject: str = "") -> None:
        """Add a loss. {n} and {names} in `sentence` are replaced by the number and names of its subjects."""
        self._subjects.setdefault(sentence, []).append(subject)

    def sentences(self) -> tuple[str, ...]:
        """One sentence for each kind of loss, in the order of their first occurrence."""
        return tuple(
            sentence.replace("{n}", str(len(subjects))).replace("{names}", listed(subjects))
            for sentence, subjects in self._subjects.items()
        )


def listed(subjects: Iterable[str]) -> str:
    """The first MAX_NAMES_LISTED different names, and the number of the others."""
    counted = Counter(subjects)
    shown = [f"{name} (x{n})" if n > 1 else name for name, n in list(counted.items())[:MAX_NAMES_LISTED]]
    rest = len(counted) - len(shown)
    return ", ".join(shown) + (f" and {rest} more" if rest else "")


def remove_invalid_elements(building: Building, losses: Losses, file: YamlFile) -> Building:
    """Remove, and report, every element that breaks a rule, until none does.

    A floor with an invalid outline loses the outline; a removed node loses its edges. Raises
    MapFileError if a rule is broken by something that can't be removed."""
    while problems := validation.problems(building, limit=100_000):
        before = building
        of_edges = [wrong for wrong in problems if wrong.kind == ElementKind.EDGE.value]
        others = [wrong for wrong in problems if wrong.kind != ElementKind.EDGE.value]
        building = _without_invalid(building, others, losses)
        for floor, entry in building.floors.items():
            nodes = entry.topological.nodes
            for name, edge in entry.topological.edges.items():
                if not (edge.a in nodes and edge.b in nodes):
                    losses.add(f"left out: edges of {floor} ({{n}}): a node at its end is left out: {{names}}", name)
                    building = building.without(ElementKind.EDGE, floor, name)
        building = _without_invalid(building, of_edges, losses)
        if building is before:
            raise file.error("$", str(problems[0]))
    return building


def _without_invalid(building: Building, problems: Iterable[InvalidElement], losses: Losses) -> Building:
    for wrong in problems:
        reduced = _without(building, wrong.kind, wrong.floor, wrong.name)
        if reduced is not building:
            where = f" of {wrong.floor}" if wrong.floor else ""
            reason = _POSITION.sub("", wrong.reason)
            losses.add(f"left out: {wrong.kind}s{where} ({{n}}): {reason}: {{names}}", wrong.name)
            building = reduced
    return building


def _without(building: Building, what: str, floor: str, name: str) -> Building:
    """The building without that element; the identical building if there is nothing to remove.

    Nodes in the cabin of a removed elevator become ordinary nodes."""
    if what == "building":
        return building
    kind = ElementKind(what)
    if kind is ElementKind.FLOOR:
        entry = building.floors.get(name)
        if entry is None or not entry.floor.outline:
            return building
        return building.with_element("", msgspec.structs.replace(entry.floor, outline=()))
    if building.find(kind, floor, name) is None:
        return building
    if kind is ElementKind.ELEVATOR:
        for other, entry in building.floors.items():
            for node in entry.topological.nodes.values():
                if node.elevator == name:
                    building = building.with_element(other, msgspec.structs.replace(node, elevator=""))
    return building.without(kind, floor, name)

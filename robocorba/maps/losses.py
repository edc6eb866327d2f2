"""What a conversion between formats could not keep: one sentence for each kind of loss."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import msgspec

from robocorba.errors.maps import InvalidElement
from robocorba.maps import validation
from robocorba.maps.model import Building, ElementKind, Elevator
from robocorba.maps.yaml_file import YamlFile

#: Names listed in one sentence; the rest is counted.
NAMES_SHOWN = 12
#: Broken rules dealt with between two looks at the whole building.
MOST_PROBLEMS = 100_000
TYPE_NAMES = {kind.value for kind in ElementKind}
#: Where an edge meets an obstacle, at the end of a reason: it differs from edge to edge.
_POSITION = re.compile(r" near \S+, \S+$")


class Imported(msgspec.Struct, frozen=True):
    """A building that was read, the name of the format, and a sentence for everything that was lost."""

    building: Building
    format: str
    losses: tuple[str, ...] = ()


class Exported(msgspec.Struct, frozen=True):
    """The files that were written, and a sentence for everything that was lost."""

    files: tuple[Path, ...]
    losses: tuple[str, ...] = ()


class Losses:
    """Collects losses; equal ones become one sentence that counts and names what they befell."""

    def __init__(self) -> None:
        self._subjects: dict[str, list[str]] = {}

    def add(self, sentence: str, subject: str = "") -> None:
        """`sentence` may hold {n} and {names}: how many subjects it befell, and which."""
        self._subjects.setdefault(sentence, []).append(subject)

    def sentences(self) -> tuple[str, ...]:
        """All losses, in the order in which their kinds first occurred."""
        return tuple(
            sentence.replace("{n}", str(len(subjects))).replace("{names}", listed(subjects))
            for sentence, subjects in self._subjects.items()
        )


def listed(subjects: Iterable[str]) -> str:
    """The first NAMES_SHOWN different names, and how many more there are."""
    counted = Counter(subjects)
    shown = [f"{name} (x{n})" if n > 1 else name for name, n in list(counted.items())[:NAMES_SHOWN]]
    rest = len(counted) - len(shown)
    return ", ".join(shown) + (f" and {rest} more" if rest else "")


def settle(building: Building, losses: Losses, file: YamlFile) -> Building:
    """Leave out, and report, every element that breaks a rule, until none does.

    A floor with a wrong outline loses the outline, and a node takes its edges with it. Raises
    MapFileError where the fault lies in something that can't be left out."""
    while problems := validation.problems(building, limit=MOST_PROBLEMS):
        before = building
        of_edges = [wrong for wrong in problems if wrong.kind == ElementKind.EDGE.value]
        others = [wrong for wrong in problems if wrong.kind != ElementKind.EDGE.value]
        building = _without_wrong(building, others, losses)
        building = _without_loose_edges(building, losses)
        building = _without_wrong(building, of_edges, losses)
        if building is before:
            raise file.error("$", str(problems[0]))
    return building


def _without_wrong(building: Building, problems: Iterable[InvalidElement], losses: Losses) -> Building:
    for wrong in problems:
        reduced = _without(building, wrong.kind, wrong.floor, wrong.name)
        if reduced is not building:
            where = f" of {wrong.floor}" if wrong.floor else ""
            reason = _POSITION.sub("", wrong.reason)
            losses.add(f"left out: {wrong.kind}s{where} ({{n}}): {reason}: {{names}}", wrong.name)
            building = reduced
    return building


def _without_loose_edges(building: Building, losses: Losses) -> Building:
    for floor, entry in building.floors.items():
        nodes = entry.topological.nodes
        for name, edge in entry.topological.edges.items():
            if not (edge.a in nodes and edge.b in nodes):
                losses.add(f"left out: edges of {floor} ({{n}}): a node at its end is left out: {{names}}", name)
                building = building.without(ElementKind.EDGE, floor, name)
    return building


def _without(building: Building, what: str, floor: str, name: str) -> Building:
    """The building without that element; the same building where there is nothing to leave out."""
    if what not in TYPE_NAMES:
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
        return _without_elevator(building, building.elevators[name])
    return building.without(kind, floor, name)


def _without_elevator(building: Building, elevator: Elevator) -> Building:
    """The building without an elevator; nodes in its cabin become ordinary ones."""
    for entry in building.floors.values():
        for node in entry.topological.nodes.values():
            if node.elevator == elevator.name:
                building = building.with_element(entry.floor.name, msgspec.structs.replace(node, elevator=""))
    return building.without(ElementKind.ELEVATOR, "", elevator.name)

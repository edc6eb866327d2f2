"""Edits as clients read them: who made them and what they changed, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from robocorba.map_editor.changes import Change, ChangeKind
from robocorba.map_editor.model import Element, ElementKind


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

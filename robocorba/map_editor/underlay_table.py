"""The underlays in the file of a map: they follow the renaming and the removal of their floors.

The picture of a removed floor is set aside, and comes back when an undo creates the same floor again.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence

import msgspec

from robocorba.map_editor.changes import Change
from robocorba.map_editor.model import Element, ElementKind
from robocorba.map_editor.underlays import MAX_TOTAL_BYTES, Underlay, invalid_underlay

#: aside: the floor as JSON if it is removed, else NULL. removed: the version that removed it.
TABLE = """CREATE TABLE IF NOT EXISTS underlays (
    floor TEXT PRIMARY KEY, aside TEXT, removed INTEGER NOT NULL,
    x REAL NOT NULL, y REAL NOT NULL, resolution REAL NOT NULL, picture BLOB NOT NULL)"""


def read(connection: sqlite3.Connection, floor: str) -> Underlay | None:
    """The underlay of a floor."""
    query = "SELECT picture, x, y, resolution FROM underlays WHERE floor = ? AND aside IS NULL"
    row = connection.execute(query, (floor,)).fetchone()
    return Underlay(bytes(row[0]), (row[1], row[2]), row[3]) if row else None


def write(connection: sqlite3.Connection, floor: str, underlay: Underlay | None) -> None:
    """Set or remove the underlay of a floor. Raises InvalidElement if all pictures together would be too large."""
    connection.execute("DELETE FROM underlays WHERE floor = ?", (floor,))
    if underlay is None:
        return
    room = MAX_TOTAL_BYTES - len(underlay.picture)
    if _total(connection) > room:
        connection.execute("DELETE FROM underlays WHERE aside IS NOT NULL")
    if _total(connection) > room:
        raise invalid_underlay(floor, f"the pictures of all floors together have more than {MAX_TOTAL_BYTES} bytes")
    values = floor, *underlay.origin, underlay.resolution, underlay.picture
    connection.execute("INSERT INTO underlays VALUES (?, NULL, 0, ?, ?, ?, ?)", values)


def follow(connection: sqlite3.Connection, changes: Sequence[Change]) -> None:
    """Take over the renamed, removed and created floors of a commit."""
    floors = [change for change in changes if change.key.kind is ElementKind.FLOOR]
    removed = {change.key.name: change for change in floors if change.after is None}
    for change in floors:
        if change.before is not None or change.after is None:
            continue
        name = change.key.name
        renamed = next((old for old, gone in removed.items() if _renamed(gone.element, name) == change.after), None)
        if renamed is not None:
            del removed[renamed]
            connection.execute("DELETE FROM underlays WHERE floor = ?", (name,))
            connection.execute("UPDATE underlays SET floor = ? WHERE floor = ? AND aside IS NULL", (name, renamed))
        else:
            connection.execute("DELETE FROM underlays WHERE floor = ? AND aside <> ?", (name, _text(change.after)))
            connection.execute("UPDATE underlays SET aside = NULL WHERE floor = ?", (name,))
    for name, change in removed.items():
        values = _text(change.element), change.version, name
        connection.execute("UPDATE underlays SET aside = ?, removed = ? WHERE floor = ?", values)


def forget(connection: sqlite3.Connection, version: int) -> None:
    """Delete the pictures of floors that were removed up to `version`, which no undo reaches any more."""
    connection.execute("DELETE FROM underlays WHERE aside IS NOT NULL AND removed <= ?", (version,))


def _total(connection: sqlite3.Connection) -> float:
    total: float = connection.execute("SELECT total(length(picture)) FROM underlays").fetchone()[0]
    return total


def _renamed(floor: Element, name: str) -> Element:
    renamed: Element = msgspec.structs.replace(floor, name=name)
    return renamed


def _text(floor: Element) -> str:
    return msgspec.json.encode(floor).decode()

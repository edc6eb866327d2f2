"""An editor for load tests: python -m tests.system.editing_client NAMING NAME EDITS

Prints `ready`, waits for a line, makes EDITS edits of its own elements and every fifth one of an element that
all editors change, and prints as JSON the version and the element names of each accepted edit."""

from __future__ import annotations

import sys
from typing import Any

import msgspec

from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from tests.system.elements import XY, id_of, wall

SHARED = RoboCorba.ElementId(RoboCorba.OBJECT_ELEMENT, "L1", "table")
#: The shared element counts its edits by its heading.
STEP_RAD = 0.001


class Editor:
    """Five edits in turn: create, change, a transaction of two, the shared element, remove."""

    def __init__(self, editor: Any, name: str) -> None:
        self.editor, self.name = editor, name
        self.wall_version = 0
        self.stale = 0

    def edit(self, number: int) -> tuple[int, list[str]]:
        """Make edit `number`; the version it led to and the names of what it touched."""
        floor, turn = f"L{1 + number // 5 % 2}", number % 5
        name = f"{self.name}-{number // 5}"
        if turn == 0:
            self.wall_version = self.editor.create(floor, wall(name))
        elif turn == 1:
            self.wall_version = self.editor.change(floor, wall(name, height=1.0), self.wall_version)
        elif turn == 2:
            return self.add_node(f"{name}-node", 3.0 + number % 50 / 10)
        elif turn == 3:
            return self.count()
        else:
            return self.editor.remove(id_of(floor, wall(name)), self.wall_version), [name]
        return self.wall_version, [name]

    def add_node(self, name: str, x: float) -> tuple[int, list[str]]:
        transaction = self.editor.begin()
        edge = RoboCorba.PathEdge(f"{name}-edge", name, "top", False, 0.0, 0.0, [])
        transaction.create("L2", RoboCorba.Element(aNode=RoboCorba.PathNode(name, XY(x, 2.0), "")))
        transaction.create("L2", RoboCorba.Element(anEdge=edge))
        return transaction.commit(), [name, f"{name}-edge"]

    def count(self) -> tuple[int, list[str]]:
        while True:
            record = self.editor.read(SHARED)
            record.value._v.heading += STEP_RAD
            try:
                return self.editor.change("L1", record.value, record.changedAt), ["table"]
            except RoboCorba.StaleEdit:
                self.stale += 1


def main(naming: str, name: str, edits: str) -> None:
    with Orb(Address.parse(naming)) as orb:
        editor = Editor(orb.resolve("MapEditor", RoboCorba.MapEditor), name)
        print("ready", flush=True)
        sys.stdin.readline()
        accepted = [editor.edit(number) for number in range(int(edits))]
    print(msgspec.json.encode({"accepted": accepted, "stale": editor.stale}).decode())


if __name__ == "__main__":
    main(*sys.argv[1:])

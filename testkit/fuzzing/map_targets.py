"""The objects of the map editor server: the map editor, sessions, transactions, the path planning agent."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from omniORB import CORBA

from robocorba.stubs import RoboCorba
from testkit.fuzzing.calls import Target
from testkit.fuzzing.examples import PNG, example, fresh, with_members
from testkit.fuzzing.fuzzed_system import FuzzedSystem


def undo_edit(system: FuzzedSystem, name: str, result: Any) -> None:
    """Undo edits, and end what was begun."""
    for one in result if isinstance(result, tuple) else (result,):
        if isinstance(one, RoboCorba._objref_Transaction):
            one.rollBack()
        elif isinstance(one, RoboCorba._objref_EditSession):
            one.close()
        elif name not in ("undo", "redo") and isinstance(one, int) and one > 1:
            with contextlib.suppress(RoboCorba.NothingToUndo):
                system.editor.undo(system.editor._get_currentVersion())


def targets(system: FuzzedSystem) -> Iterator[Target]:
    """One for each interface."""
    elements = [
        each
        for kind in RoboCorba.ElementKind._items
        for floor in ("", "L1", "L2")
        for each in _elements(system, kind, floor)
    ]
    edits = {
        "create": [example(each.onFloor, _renamed(each.value)) for each in elements],
        "change": [example(each.onFloor, each.value, each.changedAt) for each in elements],
        "remove": [example(_id(each), each.changedAt) for each in elements],
        "setFact": [example(RoboCorba.ElementFact(_id(each), "mass", "2"), each.changedAt) for each in elements],
        "rename": [example(_id(each), "renamed", each.changedAt) for each in elements],
    }
    document = system.editor.exportMap()
    version = system.editor._get_currentVersion
    on_editor = {
        **edits,
        "importMap": [lambda: (document, version())],
        "elements": [example(each.value._d, each.onFloor) for each in elements],
        "read": [example(_id(each)) for each in elements],
        "buildTopologicalMap": [example("L1", 0.4)],
        "checkFloor": [example("L1", 0.4)],
        "changesSince": [lambda: (max(0, version() - 3),)],
        "editsSince": [lambda: (max(0, version() - 3),)],
        "undo": [lambda: (version(),)],
        "redo": [lambda: (version(),)],
        "getUnderlay": [example("L1")],
        "setUnderlay": [example("L1", RoboCorba.Underlay(PNG, RoboCorba.XY(0.0, 0.0), 0.05))],
        "openSession": [example("author")],
    }
    end = partial(undo_edit, system)
    yield Target(RoboCorba.MapEditor, lambda: system.editor, on_editor, end)
    session = [system.editor.openSession("fuzz")]

    def open_session() -> Any:
        try:
            session[0]._get_author()
        except CORBA.OBJECT_NOT_EXIST:
            session[0] = system.editor.openSession("fuzz")
        return session[0]

    yield Target(RoboCorba.EditSession, open_session, edits, end, frozenset({"close"}))
    ends = frozenset({"commit", "rollBack"})
    begin = fresh(system.editor.begin, "rollBack")
    yield Target(RoboCorba.Transaction, begin, edits, end, ends)
    start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L2", 3.0, 3.0)
    request = system.planner.defaultRequest(start, RoboCorba.Point("L1", 15.0, 3.0))
    on_planner = {
        "getPath": [example(start, goal)],
        "findPaths": [example(request)],
        "defaultRequest": [example(start, goal)],
    }
    also = dict.fromkeys(("getPath", "findPaths"), (CORBA.TIMEOUT,))
    yield Target(RoboCorba.PathPlanner, lambda: system.planner, on_planner, also=also)


def _elements(system: FuzzedSystem, kind: Any, floor: str) -> Sequence[Any]:
    try:
        found: Sequence[Any] = system.editor.elements(kind, floor)
    except RoboCorba.UnknownElement:
        return ()
    return found


def _id(record: Any) -> Any:
    return RoboCorba.ElementId(record.value._d, record.onFloor, record.value._v.name)


def _renamed(element: Any) -> Any:
    return RoboCorba.Element(element._d, with_members(element._v, name="new"))

"""The building of a system: which one the servers begin with, when they refuse one, and that accepted edits stay, also
where the map editor is killed while two clients edit and others ask for paths."""

from __future__ import annotations

import itertools
import os
import random
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from omniORB import CORBA

from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from testkit.buildings import two_floors
from testkit.processes import Running, eventually, refusal
from tests.map_editor.formats.rmf_files import small, written
from tests.system.elements import XY, all_elements, id_of, replay, wall
from tests.system.test_up import answers
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

Start = Callable[..., Running]


def served(orb: Orb) -> tuple[str, int]:
    """Name and version of the building that is served."""
    editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
    return editor._get_buildingName(), editor._get_currentVersion()


def test_a_foreign_file_gives_way_to_another_until_it_is_edited(
    robocorba_up: Start, client: Orb, tmp_path: Path
) -> None:
    (tmp_path / "small.building.yaml").write_bytes(written(small()))
    native.save(two_floors(), tmp_path / "two-floors.yaml")

    running = robocorba_up("--building", "small.building.yaml").wait_ready()
    assert served(client) == ("small", 1)
    assert " WARNING map_editor " in (running.state / "logs" / "map_editor.log").read_text()  # what the import lost
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
    assert planner.getPath(RoboCorba.Point("L1", 2.5, -2.5), RoboCorba.Point("L1", 7.5, -2.5))
    assert running.stop() == 0

    running = robocorba_up("--building", "two-floors.yaml").wait_ready()
    assert served(client) == ("two floors", 1)
    client.resolve("MapEditor", RoboCorba.MapEditor).create("L2", wall("mine"))
    assert running.stop() == 0

    running = robocorba_up("--building", "small.building.yaml")
    said = refusal(running.process, 60)
    assert said.startswith("robocorba up: map_editor ended with exit code 1")
    assert f"{running.state} holds edits of the map 'two floors', which was not created from" in said
    assert "small.building.yaml; choose another --state, or omit --building" in said

    running = robocorba_up().wait_ready()
    assert served(client) == ("two floors", 2)
    assert running.stop() == 0


def test_a_wrong_or_missing_file_is_one_line(robocorba_up: Start, tmp_path: Path) -> None:
    (tmp_path / "wrong.yaml").write_text("robocorba: 1\nname: x\nfloors:\n- name: L1\n  level: one\n  elevation: 0\n")
    running = robocorba_up("--building", "wrong.yaml")
    said = refusal(running.process, 60)
    assert said.startswith("robocorba up: map_editor ended with exit code 1")
    assert f"{tmp_path / 'wrong.yaml'}:5: floors[0].level: " in said
    assert sorted(path.name for path in running.state.iterdir() if "map" in path.name and "lock" not in path.name) == []
    assert not (running.state / "up.json").exists()
    said = refusal(robocorba_up("--building", "nowhere.yaml").process)
    assert said == "robocorba up: --building is 'nowhere.yaml': there is no such file"


# ---- edits under load ----

#: Between two kills in a row the supervisor waits longer each time, so the whole is restarted now and then.
ROUNDS, KILLS_EACH = 2, 3
EDITS_EACH, ROBOTS = 500, 4
#: What a call says whose server died, or is not back yet.
GONE = (CORBA.COMM_FAILURE, CORBA.TRANSIENT)
#: All editors change this element, and count their edits of it by its heading.
SHARED, STEP_RAD = RoboCorba.ElementId(RoboCorba.OBJECT_ELEMENT, "L1", "table"), 0.001
WEST, EAST, ABOVE = (RoboCorba.Point(*at) for at in (("L1", 3.0, 3.0), ("L1", 15.0, 3.0), ("L2", 14.0, 3.0)))
#: Nothing leads down again: the edge into the elevator is one-way.
TRIPS = ((WEST, EAST), (EAST, WEST), (WEST, ABOVE), (EAST, ABOVE))


class Editing:
    """A client that edits without a pause: create, change, a transaction of two, the shared element, remove, and again.

    accepted: the names of what was touched, by the version that an edit returned. unknown: names of an edit whose call
    did not return."""

    def __init__(self, editor: Any, name: str) -> None:
        self.editor, self.name, self.number = editor, name, 0
        self.accepted: dict[int, tuple[str, ...]] = {}
        self.unknown: list[tuple[str, ...]] = []
        self.unexpected: list[str] = []
        self._wall_version = 0

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Edits from another thread, until its server is gone or the `with` ends."""
        stop = threading.Event()
        with ThreadPoolExecutor() as pool:
            pool.submit(self.edit_until, stop.is_set)
            try:
                yield
            finally:
                stop.set()

    def edit_until(self, is_over: Callable[[], bool]) -> None:
        while not is_over():
            turn, name = self.number % 5, f"{self.name}-{self.number // 5}"
            names = {2: (f"{name}-node", f"{name}-edge"), 3: ("table",)}.get(turn, (name,))
            try:
                self.accepted[self._edit(turn, f"L{1 + self.number // 5 % 2}", names)] = names
            except GONE:
                self.unknown.append(names)
                self.number += 5 - turn  # whether its wall is there is not known
                return
            except CORBA.Exception as error:
                self.unexpected.append(repr(error))
                return
            self.number += 1

    def _edit(self, turn: int, floor: str, names: tuple[str, ...]) -> int:
        """The version that it led to."""
        if turn == 0:
            self._wall_version = self.editor.create(floor, wall(*names))
        elif turn == 1:
            self._wall_version = self.editor.change(floor, wall(*names, height=1.0), self._wall_version)
        elif turn == 2:
            transaction, (node, edge) = self.editor.begin(), names
            at = RoboCorba.PathNode(node, XY(3.0 + self.number % 50 / 10, 2.0), "")
            transaction.create("L2", RoboCorba.Element(aNode=at))
            to_top = RoboCorba.PathEdge(edge, node, "top", False, 0.0, 0.0, [])
            transaction.create("L2", RoboCorba.Element(anEdge=to_top))
            return int(transaction.commit())
        elif turn == 3:
            return self._count()
        else:
            return int(self.editor.remove(id_of(floor, wall(*names)), self._wall_version))
        return self._wall_version

    def _count(self) -> int:
        while True:
            record = self.editor.read(SHARED)
            record.value._v.heading += STEP_RAD
            try:
                return int(self.editor.change("L1", record.value, record.changedAt))
            except RoboCorba.StaleEdit:
                continue


def ask_for_paths(planner: Any, stop: threading.Event) -> int:
    """A robot that asks without a pause; how many answers it had."""
    for number, (start, goal) in enumerate(itertools.cycle(TRIPS)):
        if stop.is_set():
            return number
        path = planner.getPath(start, goal)
        assert (path[0].kind, path[-1].kind) == (RoboCorba.START, RoboCorba.GOAL)
    raise AssertionError


def check(editor: Any, editors: list[Editing], before: dict[tuple[str, str, str], str]) -> None:
    """Everything accepted is there at its version, everything else is a whole edit whose answer was lost."""
    made: dict[int, set[str]] = {}
    changes = editor.changesSince(1)
    for change in changes:
        made.setdefault(change.changedTo, set()).add(change.value._v.name)
    accepted = {version: set(names) for each in editors for version, names in each.accepted.items()}
    unknown = [set(names) for each in editors for names in each.unknown]
    assert {version: made.get(version) for version in accepted} == accepted
    assert [names for version, names in made.items() if version not in accepted and names not in unknown] == []
    assert sorted(made) == list(range(2, editor._get_currentVersion() + 1))
    assert replay(before, changes) == all_elements(editor)
    counted = round(editor.read(SHARED).value._v.heading / STEP_RAD)
    assert counted == sum(names == {"table"} for names in made.values())
    assert [each.unexpected for each in editors] == [[], []]


def test_what_was_accepted_stays_and_references_go_on(robocorba_up: Start, client: Orb, tmp_path: Path) -> None:
    native.save(two_floors(), tmp_path / "two-floors.yaml")
    running = robocorba_up("--building", "two-floors.yaml").wait_ready()
    editor = client.resolve("MapEditor", RoboCorba.MapEditor, call_timeout_s=60.0)
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner, call_timeout_s=60.0)
    before, chance = all_elements(editor), random.Random(1)
    editors = [Editing(editor, "one"), Editing(editor, "two")]

    # No edit is lost, and no robot is refused.
    stop, pid = threading.Event(), running.pid("map_editor")
    with ThreadPoolExecutor(ROBOTS + len(editors)) as pool:
        robots = [pool.submit(ask_for_paths, planner, stop) for _ in range(ROBOTS)]
        editing = [pool.submit(each.edit_until, lambda each=each: each.number >= EDITS_EACH) for each in editors]
        wait(editing)
        stop.set()
    assert all(robot.result() for robot in robots)
    assert sum(len(each.accepted) for each in editors) == 2 * EDITS_EACH
    assert running.pid("map_editor") == pid
    check(editor, editors, before)

    for round in range(ROUNDS):
        if round:
            assert running.stop() == 0
            running = robocorba_up("--building", "two-floors.yaml").wait_ready()
        for _ in range(KILLS_EACH):
            pid = running.pid("map_editor")
            accepted = sum(len(each.accepted) for each in editors)
            with editors[0].going_on(), editors[1].going_on():
                eventually(lambda: sum(len(each.accepted) for each in editors) > accepted + 3, what="edits")  # noqa: B023
                pause(chance.uniform(0.0, 0.1))
                os.kill(pid, signal.SIGKILL)
            # The same Python objects as from the beginning.
            eventually(lambda: answers(planner), 60.0, "the old references work")
            assert editor._get_currentVersion() == planner._get_mapVersion()
            check(editor, editors, before)
            eventually(lambda: running.pid("map_editor") not in (0, pid), what="recorded")  # noqa: B023
    assert sum(len(each.unknown) for each in editors) > 0, "no kill came in the middle of an edit"

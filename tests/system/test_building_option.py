"""The building of a system: which one the servers begin with, when they refuse one, and that accepted edits stay, also
where the map editor is killed while two clients edit and others ask for paths."""

from __future__ import annotations

import os
import random
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
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
from tests.system.elements import all_elements, id_of, replay, wall
from tests.system.test_up import answers
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.full]

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

#: Between two kills in a row the supervisor waits longer each time.
KILLS = 3
#: What a call says whose server died, or is not back yet.
GONE = (CORBA.COMM_FAILURE, CORBA.TRANSIENT)


class Editing:
    """A client that edits without a pause: create a wall, change it, remove it, and again.

    accepted: by the version that an edit returned, the wall that it touched. unknown: walls of edits whose call did not
    return."""

    def __init__(self, editor: Any, name: str) -> None:
        self.editor, self.name, self.number = editor, name, 0
        self.accepted: dict[int, str] = {}
        self.unknown: list[str] = []

    def edit_until(self, is_over: Callable[[], bool]) -> None:
        """Or until the server is gone."""
        while not is_over():
            self.number += 1
            name, floor = f"{self.name}-{self.number}", f"L{1 + self.number % 2}"
            try:
                version = self.editor.create(floor, wall(name))
                self.accepted[version] = name
                version = self.editor.change(floor, wall(name, height=1.0), version)
                self.accepted[version] = name
                self.accepted[self.editor.remove(id_of(floor, wall(name)), version)] = name
            except GONE:
                self.unknown.append(name)
                return


def check(editor: Any, editors: list[Editing], before: dict[tuple[str, str, str], str]) -> None:
    """Everything accepted is there at its version, everything else is an edit whose answer was lost."""
    changes = editor.changesSince(1)
    made = {change.changedTo: change.value._v.name for change in changes}
    accepted = {version: name for each in editors for version, name in each.accepted.items()}
    unknown = {name for each in editors for name in each.unknown}
    assert {version: made.get(version) for version in accepted} == accepted
    assert {name for version, name in made.items() if version not in accepted} <= unknown
    assert sorted(made) == list(range(2, editor._get_currentVersion() + 1))
    assert replay(before, changes) == all_elements(editor)


def test_what_was_accepted_stays_and_references_go_on(robocorba_up: Start, client: Orb, tmp_path: Path) -> None:
    """The map editor is killed while two clients edit; a robot asks for paths meanwhile."""
    native.save(two_floors(), tmp_path / "two-floors.yaml")
    running = robocorba_up("--building", "two-floors.yaml").wait_ready()
    editor = client.resolve("MapEditor", RoboCorba.MapEditor, call_timeout_s=60.0)
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner, call_timeout_s=60.0)
    before, chance = all_elements(editor), random.Random(1)
    editors = [Editing(editor, "one"), Editing(editor, "two")]
    west, above = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L2", 14.0, 3.0)

    def count() -> int:
        return sum(len(each.accepted) for each in editors)

    for _ in range(KILLS):
        pid, accepted, stop = running.pid("map_editor"), count(), threading.Event()
        with ThreadPoolExecutor() as pool:
            editing = [pool.submit(each.edit_until, stop.is_set) for each in editors]
            eventually(lambda accepted=accepted: count() > accepted + 100, what="edits")
            assert planner.getPath(west, above)[-1].kind == RoboCorba.GOAL
            pause(chance.uniform(0.0, 0.1))
            os.kill(pid, signal.SIGKILL)
            stop.set()
            wait(editing)
        assert [each.exception() for each in editing] == [None, None]
        # The same Python objects as from the beginning.
        eventually(lambda: answers(planner), 60.0, "the old references work")
        assert editor._get_currentVersion() == planner._get_mapVersion()
        check(editor, editors, before)
        eventually(lambda pid=pid: running.pid("map_editor") not in (0, pid), what="recorded")
    assert sum(len(each.unknown) for each in editors) > 0, "no kill came in the middle of an edit"

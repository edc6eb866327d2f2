"""kill -9 of the map editor server while two clients edit: what was accepted is there, and references go on."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.maps import native
from robocorba.stubs import RoboCorba
from robocorba.testing.buildings import two_floors
from robocorba.testing.processes import Running, eventually
from tests.system.elements import all_elements, replay, wall
from tests.system.test_up import answers
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: Between two kills in a row the supervisor waits longer each time, so the whole is started anew now and then.
ROUNDS, KILLS_EACH = 2, 3
#: What a call says whose server died, or is not back yet.
GONE = (CORBA.COMM_FAILURE, CORBA.TRANSIENT)


class Editing:
    """A client that edits without a pause: every third edit is a transaction of two elements, a and b.

    accepted: the names by the version that an edit returned. unknown: names whose call did not return."""

    def __init__(self, editor: Any, name: str) -> None:
        self.editor, self.name, self.number = editor, name, 0
        self.accepted: dict[int, tuple[str, ...]] = {}
        self.unknown: list[tuple[str, ...]] = []
        self.unexpected: list[str] = []

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Edits from another thread, until its server is gone or the `with` ends."""
        stop = threading.Event()
        thread = threading.Thread(target=self._edit_until, args=(stop,))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    def _edit_until(self, stop: threading.Event) -> None:
        while not stop.is_set():
            self.number += 1
            name = f"{self.name}-{self.number}"
            names = (f"{name}a", f"{name}b") if self.number % 3 == 0 else (name,)
            try:
                self.accepted[self._edit(names)] = names
            except GONE:
                self.unknown.append(names)
                return
            except CORBA.Exception as error:
                self.unexpected.append(repr(error))
                return

    def _edit(self, names: tuple[str, ...]) -> int:
        if len(names) == 1:
            return self.editor.create("L1", wall(*names))
        transaction = self.editor.begin()
        for name in names:
            transaction.create("L2", wall(name))
        return transaction.commit()


def test_accepted_edits_and_references_survive(
    robocorba_up: Callable[..., Running], client: Orb, tmp_path: Path
) -> None:
    native.save(two_floors(), tmp_path / "two-floors.yaml")
    running = robocorba_up("--building", "two-floors.yaml").wait_ready()
    editor = client.resolve("MapEditor", RoboCorba.MapEditor)
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
    before, chance, back_s = all_elements(editor), random.Random(1), []
    editors = [Editing(editor, "one"), Editing(editor, "two")]

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
                killed = time.monotonic()
            # The same Python objects as from the beginning.
            eventually(lambda: answers(planner), 60.0, "the old references work")
            assert editor._get_currentVersion() == planner._get_mapVersion()
            back_s.append(time.monotonic() - killed)
            check(editor, editors, before)
            eventually(lambda: running.pid("map_editor") not in (0, pid), what="recorded")  # noqa: B023

    assert sum(len(each.unknown) for each in editors) > 0, "no kill came in the middle of an edit"
    print(
        f"\n{sum(len(each.accepted) for each in editors)} edits accepted, {len(back_s)} kills; references worked again "
        f"after {min(back_s):.1f} to {max(back_s):.1f} s, {sorted(back_s)[len(back_s) // 2]:.1f} s at the median"
    )


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
    assert [each.unexpected for each in editors] == [[], []]

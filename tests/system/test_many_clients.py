"""Two editors and four robots in processes of their own, at the same time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.corba.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import Launcher, Running, read_json
from tests.system.editing_client import SHARED, STEP_RAD
from tests.system.elements import all_elements, replay

pytestmark = [pytest.mark.system, pytest.mark.full]

EDITORS, ROBOTS, EDITS_EACH = 2, 4, 500
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def clients(system: Running, launch: Launcher) -> Iterator[list[subprocess.Popen[str]]]:
    """All clients, ready."""
    module, naming = (sys.executable, "-m"), str(system.naming)
    commands: list[tuple[str, ...]]
    commands = [(*module, "tests.system.editing_client", naming, f"editor{i}", str(EDITS_EACH)) for i in range(EDITORS)]
    commands += [(*module, "tests.system.planning_client", naming)] * ROBOTS
    processes = [launch(*command, PYTHONPATH=str(ROOT)) for command in commands]
    for process in processes:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "ready\n", process.stderr.read()
    yield processes


def test_no_edit_is_lost_and_no_robot_is_refused(
    system: Running, system_orb: Orb, clients: list[subprocess.Popen[str]]
) -> None:
    editor = system_orb.resolve("MapEditor", RoboCorba.MapEditor)
    before, began = all_elements(editor), editor._get_currentVersion()
    pid = system.pid("map_editor")

    editors, robots = clients[:EDITORS], clients[EDITORS:]
    for process in editors:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    reports = [read_json(answer(process)) for process in editors]
    planned = [read_json(answer(process)) for process in robots]

    accepted = {version: names for report in reports for version, names in report["accepted"]}
    assert sorted(accepted) == list(range(began + 1, began + 1 + EDITORS * EDITS_EACH))
    touched: dict[int, list[str]] = {}
    changes = editor.changesSince(began)
    for change in changes:
        touched.setdefault(change.changedTo, []).append(change.value._v.name)
    assert {version: sorted(names) for version, names in touched.items()} == {
        version: sorted(names) for version, names in accepted.items()
    }
    assert replay(before, changes) == all_elements(editor)
    counted = round(editor.read(SHARED).value._v.heading / STEP_RAD)
    assert counted == sum(names == ["table"] for names in accepted.values()) == EDITORS * EDITS_EACH // 5
    assert [robot["errors"] for robot in planned] == [[]] * ROBOTS
    assert all(robot["answers"] > 0 for robot in planned)
    assert system.pid("map_editor") == pid
    longest_ms = max(robot["longest_ms"] for robot in planned)
    print(
        f"\n{len(accepted)} edits, {sum(report['stale'] for report in reports)} stale ones repeated; "
        f"{sum(robot['answers'] for robot in planned)} paths, at most {longest_ms:.0f} ms between two answers"
    )


def answer(process: subprocess.Popen[str]) -> str:
    """What a client prints at its end, which a line brings about where it does not end by itself."""
    out, err = process.communicate("stop\n", timeout=100)
    assert process.returncode == 0, err
    return out

"""The building of a system: which one the servers begin with, and when they refuse one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from testkit.buildings import two_floors
from testkit.processes import Running, refusal
from tests.map_editor.formats.rmf_files import small, written
from tests.system.elements import wall

pytestmark = [pytest.mark.system, pytest.mark.slow(30), pytest.mark.full]

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
    said = refusal(robocorba_up("--building", "nowhere.yaml").process)
    assert said == "robocorba up: --building is 'nowhere.yaml': there is no such file"

    running = robocorba_up().wait_ready()
    assert served(client) == ("two floors", 2)
    assert running.stop() == 0

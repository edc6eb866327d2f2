"""What robots see and no map has: proposed, planned around, and drawn, by a person or by a rule."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from robocorba.map_editor.corba.remote_edit_session import RemoteMapEditor
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from testkit.processes import Launcher, Running, eventually, read_json

pytestmark = [pytest.mark.system, pytest.mark.slow(100), pytest.mark.full]


def test_the_rule_of_a_system_draws_what_enough_robots_have_seen(
    robocorba_up: Callable[..., Running], client: Orb
) -> None:
    running = robocorba_up("--building", "paper-scene", "--accept", "3,1").wait_ready()
    editor, propose = RemoteMapEditor(client), client.resolve("MapEditor", RoboCorba.MapEditor).propose
    began, chair = editor.version(), [RoboCorba.XY(3.0 + dx, 5.5 + dy) for dx, dy in ((0, 0), (0.5, 0), (0.5, 0.5))]
    for seen_by in "AB":
        propose("L1", chair, 0.9, seen_by)
    assert [proposal.seen_by for proposal in editor.proposals()] == [("A", "B")]
    propose("L1", chair, 0.9, "C")
    (edit,) = eventually(lambda: editor.edits_since(began), what="the edit by the rule")
    assert edit.author == "rule: 3 robots" and edit.summary.startswith("object seen ")
    assert editor.proposals() == []
    assert running.stop() == 0


def test_the_demo_of_perception_finds_the_chair(launch: Launcher) -> None:
    """In time, where the machine is not busy: its exit code says that, too."""
    demo = launch(sys.executable, "-m", "robocorba.clients.perception_demo", "found")
    printed, errors = demo.communicate(timeout=600)
    assert "path from A's lookout to C's: 2.8" in printed and "accepted: seen 1" in printed, printed + errors
    found = read_json((launch.folder / "found" / "perception.json").read_text())
    assert set(found["seen_s"]) == {"A", "B", "C"}
    assert found["off_m"] <= 0.05 and found["certainty"] > 0.9
    assert demo.returncode == (found["after_s"] > 10.0)
    for picture in ("proposed.png", "accepted.png"):
        assert (launch.folder / "found" / picture).stat().st_size > 10_000

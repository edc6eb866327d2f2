"""The sample programs are valid on the sample buildings."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

from robocorba.kinematics.inverse import InverseKinematics
from robocorba.maps.samples import load_sample
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Place
from robocorba.programs.checker import Start, check
from robocorba.programs.icons import kind
from robocorba.programs.program import dumps, icons_with_paths, load

SAMPLES = Path(str(files("robocorba") / "samples"))


@pytest.mark.parametrize(
    ("name", "building", "start"),
    [
        ("drive", "paper-scene", Start(Place("L1", 1.1, 3.3), 0.0)),
        ("fetch", "five-floors", Start(Place("L1", 17.0, 1.2), 1.57)),
        ("both-floors", "five-floors", Start(Place("L1", 17.0, 7.5), 1.57)),
    ],
)
def test_a_sample_is_valid_in_its_building(name: str, building: str, start: Start) -> None:
    file = SAMPLES / f"{name}.json"
    program = load(file)
    report = check(program, InverseKinematics(), PathPlanner(load_sample(building)), start)
    assert report.findings == ()
    assert dumps(program) == file.read_text()


def test_fetch_has_what_the_same_program_on_two_robots_shall_show() -> None:
    kinds = [kind(icon) for _, icon in icons_with_paths(load(SAMPLES / "fetch.json"))]
    assert {"mbase_path", "mhand_pose", "mhand_offset", "mhand_joints", "gripper", "stop_if_closer"} <= set(kinds)

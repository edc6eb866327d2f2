"""Operations of the arm poser."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from robocorba.console.kinematics_operations import InvalidPosture, KinematicsOperations
from robocorba.errors.robots import Unreachable
from robocorba.kinematics.body import SmartPalBody
from robocorba.kinematics.smartpal import Side
from robocorba.kinematics.tasks import POSTURES


@pytest.fixture(scope="module")
def operations() -> KinematicsOperations:
    return KinematicsOperations()


@pytest.fixture(scope="module")
def ready(operations: KinematicsOperations) -> list[float]:
    return [*operations.arm_postures()["ready"] * 2, 0.0, 0.0, 0.0, 0.0]


def test_a_hand_follows_its_target(operations: KinematicsOperations, ready: list[float]) -> None:
    pose = operations.hand_poses(ready)["left"]
    wanted = {**pose, "x": pose["x"] + 0.05, "z": pose["z"] + 0.1}
    answer: dict[str, Any] = operations.solve_hand(ready, "left", wanted)
    assert answer["hands"]["left"] == pytest.approx(wanted, abs=1e-5)
    assert answer["joints"][7:] == pytest.approx(ready[7:])  # the other arm stays
    hand = SmartPalBody().hand(Side.LEFT, np.array(answer["joints"]))
    assert hand._asdict() == pytest.approx(answer["hands"]["left"])


def test_both_hands_mirror_each_other(operations: KinematicsOperations, ready: list[float]) -> None:
    pose = operations.hand_poses(ready)["left"]
    answer: dict[str, Any] = operations.solve_hand(ready, "both", {**pose, "z": pose["z"] + 0.05})
    left, right = (answer["hands"][side] for side in ("left", "right"))
    assert right["y"] == pytest.approx(-left["y"], abs=1e-5)
    assert right["z"] == pytest.approx(left["z"], abs=1e-5)


def test_what_is_out_of_reach_is_said_in_words(operations: KinematicsOperations, ready: list[float]) -> None:
    with pytest.raises(Unreachable, match="misses the target by"):
        operations.solve_hand(ready, "right", {"x": 2.0, "y": 0.0, "z": 1.0})


@pytest.mark.parametrize(
    ("joints", "side", "pose", "match"),
    [
        ([0.0] * 17, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ("0" * 18, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ([math.nan] * 18, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ([10**400] * 18, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ([0.0] * 18, "<b>", {"x": 0, "y": 0, "z": 0}, "not left, right or both"),
        ([0.0] * 18, "left", {"x": 0, "y": 0}, "x, y and z"),
        ([0.0] * 18, "left", {"x": 0, "y": 0, "z": 0, "w": 1}, "x, y and z"),
        ([0.0] * 18, "left", {"x": 0, "y": 0, "z": math.inf}, "z is not a number"),
        ([0.0] * 18, "left", None, "x, y and z"),
    ],
)
def test_bad_input_is_refused(operations: KinematicsOperations, joints: Any, side: Any, pose: Any, match: str) -> None:
    with pytest.raises(InvalidPosture, match=match):
        operations.solve_hand(joints, side, pose)


def test_the_postures_are_those_of_the_icons(operations: KinematicsOperations) -> None:
    assert operations.arm_postures().keys() == POSTURES.keys()

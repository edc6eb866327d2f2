"""The looks: within the robot's dimensions, and where its links and joints are."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.appearance import PAINTS, Part, Shape, parts
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.link_tree import as_json
from robocorba.robot.kinematics.model import (
    BASE_BACK_M,
    BASE_FRONT_M,
    BASE_HALF_WIDTH_M,
    LASER_M,
    PROXIMITY_HEIGHT_M,
    links,
)
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import HEIGHT_M, JOINTS, Side

from .postures import HOME, anywhere, shift, turn


def outline(part: Part) -> Floats:
    """Points (n, 3) on a part's surface, in its link's frame."""
    if part.shape is Shape.BOX:
        own = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * part.size
    else:
        turns = np.linspace(0, math.tau, 24)
        ring = np.column_stack((np.cos(turns), np.sin(turns), np.zeros(24)))
        x, y, *rest = part.size
        if part.shape is Shape.CONE:
            top, height = rest
            rings = [(1.0, -height / 2), (top, height / 2)]
        else:
            rings = [(math.cos(tilt), math.sin(tilt) * rest[0]) for tilt in np.linspace(-1.57, 1.57, 9)]
        own = np.vstack([ring * (x * share, y * share, 1) + (0, 0, z) for share, z in rings])
    return own @ HandPose(0, 0, 0, *part.rpy).rotation.T + part.at


@pytest.fixture(scope="module")
def surface(body: SmartPalBody) -> dict[int, Floats]:
    """Points of each part at zero angles, in the robot's frame."""
    found = body.links(HOME)
    return {number: outline(part) + found[part.link][0] for number, part in enumerate(parts())}


def test_every_link_is_seen_every_paint_exists_and_every_joint_has_something_dark() -> None:
    assert {part.link for part in parts()} == {link.name for link in links()}
    assert {part.paint for part in parts()} == set(PAINTS)
    assert [part.link for part in parts() if part.paint == "display"] == ["trunk"]
    dark = {"dark", "glass"}
    for link in links():
        for joint in link.joints:
            axis = np.array(joint.axis)
            offsets = [
                np.array(part.at) - joint.at for part in parts() if part.link == link.name and part.paint in dark
            ]
            away = min(float(np.linalg.norm(np.cross(axis, offset))) for offset in offsets)
            assert away < 0.06, joint.name


def test_it_has_the_robot_s_height_footprint_two_arms_alike_and_sensors(surface: dict[int, Floats]) -> None:
    heights = np.concatenate([points[:, 2] for points in surface.values()])
    assert heights.max() == pytest.approx(HEIGHT_M, abs=0.01)
    assert -1e-9 <= heights.min() <= 0.01
    base = np.vstack([surface[number] for number, part in enumerate(parts()) if part.link == "base"])
    assert base[:, 0].min() == pytest.approx(BASE_BACK_M, abs=0.01)
    assert base[:, 0].max() == pytest.approx(BASE_FRONT_M, abs=0.01)
    assert np.abs(base[:, 1]).max() == pytest.approx(BASE_HALF_WIDTH_M, abs=0.01)
    left, right = (
        np.vstack([points for n, points in surface.items() if parts()[n].link.startswith(side.value)]) for side in Side
    )
    assert left.min(axis=0)[[0, 2]] == pytest.approx(right.min(axis=0)[[0, 2]])
    assert left[:, 1].max() == pytest.approx(-right[:, 1].min())
    cap = [points for n, points in surface.items() if parts()[n].link == "waist" and parts()[n].paint == "blue"]
    assert np.abs(cap[0].mean(axis=0) - LASER_M).max() < 0.05
    windows = [p for p in parts() if p.link == "base" and p.paint == "glass" and p.shape is Shape.BOX]
    assert [window.at[2] for window in windows] == [PROXIMITY_HEIGHT_M] * 8


def test_the_tree_moves_links_and_mounts_as_the_model_does(body: SmartPalBody) -> None:
    """Forward kinematics as a browser does it from the JSON."""
    tree = as_json()
    for joints in anywhere(20, 5):
        frames: dict[str, Floats] = {"": np.eye(4)}
        for link in tree["links"]:
            frame = frames[link["parent"]] @ shift(*link["at"])
            for joint in link["joints"]:
                turned = turn(np.array(joint["axis"]), joints[joint["number"]])
                frame = frame @ shift(*joint["at"]) @ turned @ shift(*-np.array(joint["at"]))
            frames[link["name"]] = frame
        for mount in tree["mounts"]:
            if mount["name"].endswith("_hand"):
                own = shift(*mount["at"])
                own[:3, :3] = Rotation.from_quat(np.roll(mount["attitude"], -1)).as_matrix()
                found = frames[mount["link"]] @ own
                hand = body.hand(Side(mount["name"].partition("_")[0]), joints)
                assert found[:3, 3] == pytest.approx(hand.position, abs=1e-9)
                assert found[:3, :3] == pytest.approx(hand.rotation, abs=1e-6)
    assert tree["joints"] == JOINTS

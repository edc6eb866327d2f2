"""The model against the robot's public figures, and the URDF against the model."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.robot.kinematics.appearance import PAINTS
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.model import links
from robocorba.robot.kinematics.mujoco_headless import specification
from robocorba.robot.kinematics.smartpal import JOINT_ACCELERATION, JOINT_LOWER, JOINT_UPPER, JOINTS, MASS_KG
from robocorba.robot.kinematics.urdf import urdf

from .postures import anywhere, links_by_urdf


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return specification().compile()


@pytest.fixture(scope="module")
def of_urdf() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(urdf())


@pytest.fixture(scope="module")
def standing(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_its_joints_are_the_robots_with_their_limits(model: mujoco.MjModel, of_urdf: mujoco.MjModel) -> None:
    for each in (model, of_urdf):
        assert sorted(each.joint(row).name for row in range(each.njnt)) == sorted(JOINTS)
        for name, lower, upper in zip(JOINTS, JOINT_LOWER, JOINT_UPPER, strict=True):
            assert each.joint(name).range == pytest.approx([lower, upper])
            assert each.joint(name).type == mujoco.mjtJoint.mjJNT_HINGE


def test_mass_height_footprint_and_sensors_that_look_outwards(model: mujoco.MjModel, standing: mujoco.MjData) -> None:
    assert model.body_mass.sum() == pytest.approx(MASS_KG)
    corners = np.array([corner for geom in range(model.ngeom) for corner in _corners(model, standing, geom)])
    assert corners[:, 2].max() == pytest.approx(1.325)
    base = np.array([c for g in np.flatnonzero(model.geom_bodyid == 1) for c in _corners(model, standing, g)])
    assert base.min(axis=0)[:2] == pytest.approx([-0.376, -0.2775])
    assert base.max(axis=0)[:2] == pytest.approx([0.237, 0.2775])
    assert corners[:, 2].min() >= 0.0
    assert standing.site("laser").xmat.reshape(3, 3) == pytest.approx(np.eye(3))
    middle = np.array([(-0.376 + 0.237) / 2, 0.0])
    for number in range(1, 9):
        sensor = standing.site(f"proximity_{number}")
        out, bearing = sensor.xpos[:2] - middle, (number - 1) * math.pi / 4
        assert sensor.xmat.reshape(3, 3)[:, 0] == pytest.approx([math.cos(bearing), math.sin(bearing), 0])
        assert max(abs(out / (0.3065, 0.2775))) == pytest.approx(1.0)  # on the border of the footprint
        assert out @ sensor.xmat.reshape(3, 3)[:2, 0] > 0.2


def test_links_collide_as_those_of_mujoco(body: SmartPalBody, model: mujoco.MjModel) -> None:
    data, rows = mujoco.MjData(model), [model.joint(name).qposadr[0] for name in JOINTS]
    owner = [model.body(number).name for number in model.geom_bodyid]
    counts = []
    for joints in anywhere(300, 8):
        data.qpos[rows] = joints
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        deep = {tuple(owner[geom] for geom in contact.geom) for contact in data.contact if contact.dist < -1e-4}
        assert set(body.collisions(joints)) == deep
        counts.append(len(deep))
    assert sum(map(bool, counts)) > 30


def test_its_joints_are_strong_enough(of_urdf: mujoco.MjModel) -> None:
    """For their acceleration against more than the robot's weight, as the file says it."""
    data, inertia = mujoco.MjData(of_urdf), np.zeros((of_urdf.nv, of_urdf.nv))
    acceleration = [JOINT_ACCELERATION[JOINTS.index(of_urdf.joint(row).name)] for row in range(of_urdf.njnt)]
    for joints in anywhere(200, 8):
        data.qpos = [joints[JOINTS.index(of_urdf.joint(row).name)] for row in range(of_urdf.njnt)]
        mujoco.mj_forward(of_urdf, data)
        mujoco.mj_fullM(of_urdf, data, inertia)
        needed = 1.25 * np.abs(data.qfrc_bias) + inertia.diagonal() * acceleration
        assert (needed <= of_urdf.jnt_actfrcrange[:, 1]).all()


@pytest.mark.parametrize("base", [(3.0, -2.0, 2.5), (-1.0, 4.0, -math.pi)])
def test_links_are_in_the_frame_of_the_building(body: SmartPalBody, base: tuple[float, float, float]) -> None:
    for joints in anywhere(5, 8):
        found = body.links_at(base, joints)
        assert next(iter(found)) == "base" and found["base"][0] == pytest.approx([*base[:2], 0.0])
        expected = links_by_urdf(base, joints)
        assert {*expected, "base"} == found.keys()
        for name, (position, attitude) in expected.items():
            assert found[name][0] == pytest.approx(position, abs=1e-9), name
            assert abs(found[name][1] @ attitude) == pytest.approx(1.0, abs=1e-9), name


def test_the_command_writes_the_file_with_its_mass_and_its_looks(tmp_path: Path) -> None:
    robot = ElementTree.fromstring(urdf())
    masses = [float(mass.get("value", "")) for mass in robot.iter("mass")]
    assert sum(masses) == pytest.approx(MASS_KG) and min(masses) > 0
    assert {material.get("name") for material in robot.findall("link/visual/material")} == set(PAINTS)
    file = tmp_path / "smartpal.urdf"
    assert CliRunner().invoke(command(), ["robot-model", "urdf", str(file)]).exit_code == 0
    assert file.read_text() == urdf()
    failed = CliRunner().invoke(command(), ["robot-model", "urdf", str(tmp_path)])
    assert failed.exit_code == 1
    assert "Is a directory" in failed.output


def _corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> list[np.ndarray]:
    """Of the box along the axes of a shape that holds it; exact for boxes and round shapes that stand upright."""
    middle, half = model.geom_aabb[geom].reshape(2, 3)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3)
    return [data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ (middle + sign * half) for sign in signs]


def test_the_srdf_names_what_the_urdf_has_and_allows_only_neighbours_to_touch(tmp_path: Path) -> None:
    files = [tmp_path / f"smartpal.{kind}" for kind in ("urdf", "srdf")]
    for file in files:
        assert CliRunner().invoke(command(), ["robot-model", file.suffix[1:], str(file)]).exit_code == 0
    robot, groups = (ElementTree.parse(file).getroot() for file in files)
    joints, links_of = ({each.get("name") for each in robot.iter(tag)} for tag in ("joint", "link"))
    assert {each.get("name") for each in groups.iter("joint")} == {*JOINTS} <= joints
    pairs = {(each.get("link1"), each.get("link2")) for each in groups.iter("disable_collisions")}
    assert pairs == {(link.parent, link.name) for link in links() if link.parent}
    hands = {each.get("parent_link") for each in groups.iter("end_effector")}
    assert {*hands, *(name for pair in pairs for name in pair)} <= links_of
    defined = {each.get("name") for each in groups.findall("group")}
    assert {each.get("name") for each in groups.iter("group")} == defined
    assert {each.get("group") for tag in ("group_state", "end_effector") for each in groups.iter(tag)} <= defined

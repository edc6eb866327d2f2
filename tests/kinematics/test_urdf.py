"""The URDF: MuJoCo reads it and puts every link where our model has it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.kinematics.appearance import PAINTS
from robocorba.kinematics.body import SmartPalBody
from robocorba.kinematics.smartpal import JOINT_LOWER, JOINT_UPPER, JOINTS, MASS_KG
from robocorba.kinematics.urdf import urdf

from .postures import anywhere


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(urdf())


def test_links_are_where_the_model_has_them(body: SmartPalBody, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    rows = [model.joint(name).qposadr[0] for name in JOINTS]
    for joints in anywhere(100, 7):
        data.qpos[rows] = joints
        mujoco.mj_kinematics(model, data)
        for name, (position, attitude) in body.links(joints).items():
            if name == "base":  # the root of a URDF is MuJoCo's world
                continue
            found = data.body(name)
            assert found.xpos == pytest.approx(position, abs=1e-9), name
            assert abs(found.xquat @ attitude) == pytest.approx(1.0, abs=1e-9), name
            assert found.xquat * np.sign(found.xquat @ attitude) == pytest.approx(attitude, abs=1e-9), name


def test_joints_have_the_limits_of_the_robot(model: mujoco.MjModel) -> None:
    assert {model.joint(row).name for row in range(model.njnt)} == set(JOINTS)
    for name, lower, upper in zip(JOINTS, JOINT_LOWER, JOINT_UPPER, strict=True):
        assert model.joint(name).range == pytest.approx([lower, upper], abs=1e-9)


def test_the_mass_is_the_robots() -> None:
    robot = ElementTree.fromstring(urdf())
    masses = [float(mass.get("value", "")) for mass in robot.iter("mass")]
    assert sum(masses) == pytest.approx(MASS_KG)
    assert min(masses) > 0


def test_its_looks_are_those_of_the_part_list() -> None:
    robot = ElementTree.fromstring(urdf())
    paints = {material.get("name") for material in robot.findall("link/visual/material")}
    assert paints == set(PAINTS)


def test_the_command_writes_the_file(tmp_path: Path) -> None:
    file = tmp_path / "smartpal.urdf"
    assert CliRunner().invoke(command(), ["robot-model", "urdf", str(file)]).exit_code == 0
    assert file.read_text() == urdf()
    failed = CliRunner().invoke(command(), ["robot-model", "urdf", str(tmp_path)])
    assert failed.exit_code == 1
    assert "Is a directory" in failed.output

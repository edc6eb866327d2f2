"""The core needs no package of an extra, an extra none of the others, and a command says which one it needs."""

from __future__ import annotations

import configparser
import json
import subprocess
import sys
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from robocorba.commands import SUBCOMMANDS
from robocorba.errors.services import ServiceError
from robocorba.map_editor import native
from robocorba.map_editor.model import TopologicalMap, with_topology
from robocorba.map_editor.samples import sample_path
from robocorba.system import extras
from robocorba.system.extras import require_extra, requirements

from .test_structure import PRODUCT

pytestmark = [pytest.mark.system, pytest.mark.full]

PROGRAM = Path(__file__).with_name("without_extras_program.py")
#: By extra, what imports its packages. All else is the core.
OF_EXTRA = {
    "console": (
        *(f"robocorba.console.{name}" for name in ("access", "calls", "leaving", "pages", "robot_views", "server")),
        *("robocorba.console.viewers", "robocorba.clients.console"),
    ),
    "films": (
        *("robocorba.console.video", "robocorba.map_editor.drawing", "robocorba.map_editor.sheet"),
        *("robocorba.simulation.picture", "robocorba.clients.robot_film", "robocorba.console.films"),
    ),
    "foxglove": tuple(
        f"robocorba.bridges.foxglove.{name}" for name in ("files", "live", "publisher", "scene", "shapes")
    ),
    "recordings": (
        *(f"robocorba.console.{name}" for name in ("contacts", "happenings", "live_floors")),
        *("robocorba.simulation.recording", "robocorba.console.history", "robocorba.console.recordings"),
        *(f"robocorba.console.{name}" for name in ("monitor_operations", "monitor_state", "past_files")),
    ),
    "maps": (
        "robocorba.map_editor.topology",
        *(
            f"robocorba.map_editor.topology.{name}"
            for name in ("axis", "coverage", "doorways", "pruning", "roadmap", "simplification", "sites")
        ),
    ),
    "ros2": ("robocorba.bridges.ros2.bag",),
    "smartpal": (
        *(f"robocorba.robot.smartpal_stand_in.{name}" for name in ("arm", "axes", "dynamics", "faults")),
        *(f"robocorba.robot.smartpal_stand_in.{name}" for name in ("mobility", "robot", "setpoint", "unit")),
        "robocorba.robot.kinematics.mujoco_headless",
        "robocorba.robot.corba.smartpal_unit_servants",
    ),
}
#: Python packages of ROS 2 itself, which is on no index.
OF_ROS = {"rclpy", "rcl_interfaces"}


def names(found: Iterable[str]) -> set[str]:
    """Packages by their names in the metadata, and all that they need in turn here."""
    todo, done = list(found), set[str]()
    while todo:
        need = Requirement(todo.pop())
        try:
            package = metadata.distribution(need.name)
        except metadata.PackageNotFoundError:
            continue
        name = package.metadata["Name"]
        if name not in done and name != "robocorba":
            done.add(name)
            todo += [each for each in package.requires or () if applies(Requirement(each), need.extras)]
    return done


def applies(need: Requirement, chosen: Iterable[str]) -> bool:
    return not need.marker or any(need.marker.evaluate({"extra": extra}) for extra in ("", *chosen))


@pytest.fixture(scope="module")
def core() -> set[str]:
    own = metadata.requires("robocorba") or []
    return names(line for line in own if applies(Requirement(line), ()))


def test_the_core_runs_without_extras_and_an_extra_without_the_others(core: set[str], tmp_path: Path) -> None:
    missing = names(requirements("all").values()) - core
    modules = set(PRODUCT) - {"robocorba.__main__", "robocorba.clients.new_robot"}  # which run when they are imported
    helps = [[name, "--help"] for name in SUBCOMMANDS]
    film, recording = str(tmp_path / "new.mp4"), str(tmp_path / "old.mcap")
    bare = str(tmp_path / "bare.yaml")
    native.save(with_topology(native.load(sample_path("paper-scene")), "L1", TopologicalMap()), bare)
    wanting = {
        "films": (["map", "show", "paper-scene"], ["replay", recording, "--video", film]),
        "recordings": (["replay", recording],),
        "foxglove": (["convert", recording, film],),
        "ros2": (["convert", recording, film, "--ros2"],),
        "maps": (["map", "import", bare, film, "--topology"],),
        "console": (["up", "--console", "--state", str(tmp_path)], ["console"]),
    }
    lines = [line for each in wanting.values() for line in each]
    cases = [[sorted(missing - names(requirements(extra).values())), OF_EXTRA[extra]] for extra in OF_EXTRA]
    given = json.dumps([sorted(missing), sorted(modules), [*helps, *lines], cases])
    command = (sys.executable, str(PROGRAM))
    ran = subprocess.run(command, input=given, capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    tops, failures, outputs, of_extras = json.loads(ran.stdout)
    assert {"av", "matplotlib", "mcap", "nicegui", "zstandard"} <= set(tops)
    failed = {module for module, package in failures.items() if package not in OF_ROS}
    assert failed == {module for each in OF_EXTRA.values() for module in each}
    assert set(failures.values()) - OF_ROS <= set(tops)
    assert [line for line, (code, *_) in zip(helps, outputs, strict=False) if code] == []
    said = iter(outputs[len(helps) :])
    for extra, each in wanting.items():
        for line in each:
            code, output, error = next(said)
            assert (code, len(output.splitlines())) == (1, 1), (line, output, error)
            assert f"need the extra {extra} (" in output
            assert f"[{extra}]" in output or all(name in output for name in requirements(extra))
    assert dict(zip(OF_EXTRA, of_extras, strict=True)) == {extra: {} for extra in OF_EXTRA}


def test_all_and_the_tests_have_every_extra_but_those_of_benches_and_the_site() -> None:
    config = configparser.ConfigParser()
    config.read(Path(__file__).parents[1] / "setup.cfg")
    listed = config["options.extras_require"]
    assert set(OF_EXTRA) == set(listed) - {"all", "bench", "dev", "docs"}
    every = {name for extra in OF_EXTRA for name in requirements(extra)}
    assert every == set(requirements("all"))
    assert every <= set(requirements("dev"))


def test_what_to_type_works(monkeypatch: pytest.MonkeyPatch) -> None:
    """RoboCorba is on no index: it is installed again from its checkout, or the packages are from theirs."""
    require_extra("films", "films")
    monkeypatch.setattr(extras, "_is_installed", lambda name: name != "av")
    monkeypatch.setattr(extras, "_checkout", lambda: "/a checkout")
    with pytest.raises(ServiceError, match=r"^films need the extra films \(av\): pip install --editable '/a checkout"):
        require_extra("films", "films")
    monkeypatch.setattr(extras, "_checkout", lambda: "")
    with pytest.raises(ServiceError, match=r"^films need the extra films \(av\): pip install 'av<19,>=14'$"):
        require_extra("films", "films")

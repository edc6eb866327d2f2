"""The robot client in 20 lines: it is what the README shows, and does against real servers what it says."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from robocorba.corba.naming import corbaname
from robocorba.corba.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import module_command
from robocorba.testing.processes import Launcher, Running, eventually

ROOT = Path(__file__).resolve().parents[2]
CLIENT = ROOT / "clients" / "new_robot.py"
#: Where it begins.
X, Y = 3.0, 4.0


def code() -> str:
    """Without the docstring."""
    text = CLIENT.read_text()
    end = ast.parse(text).body[0].end_lineno
    return "".join(text.splitlines(keepends=True)[end:]).lstrip("\n")


def test_the_readme_shows_it() -> None:
    section = (ROOT / "README.md").read_text().split("## A robot client in 20 lines")[1].split("\n## ")[0]
    assert re.findall(r"```python\n(.*?)```", section, re.DOTALL) == [code()]


def test_it_has_20_lines_and_needs_nothing_but_an_orb_and_the_stubs() -> None:
    assert len(code().splitlines()) <= 20
    imports = {line for line in code().splitlines() if "import" in line}
    assert imports == {
        "import sys",
        "import time",
        "from omniORB import CORBA",
        "from robocorba.stubs import RoboCorba",
    }


@pytest.mark.system
def test_it_drives_until_something_is_near(system: Running, launch: Launcher, system_orb: Orb) -> None:
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)

    def robots() -> dict[str, float]:
        return {client.name: client.at.x for client in server.clients()}

    uri = corbaname(system.naming, "RoboCorba/SimulationServer")
    process = launch(*module_command("robocorba.clients.new_robot"), uri, PYTHONPATH=str(ROOT))
    eventually(lambda: robots().get("new", 0.0) > X + 1.0, 60.0, "it drives")
    out, err = process.communicate(timeout=60.0)
    assert (process.returncode, err) == (0, "")
    found = re.fullmatch(r"something is near .*RoboCorba\.Pose\(floor='L1', x=(.*), y=(.*), heading=(.*)\)\n", out)
    assert found, out
    x, y, heading = map(float, found.groups())
    assert (y, heading) == pytest.approx((Y, 0.0), abs=1e-3)
    # The wall across the floor is at x = 10; at 0.5 m/s it needs a tick and some way to stand.
    assert 8.7 < x < 9.5
    assert robots() == {}


@pytest.mark.system
def test_it_is_logged_off_also_where_it_is_refused(system: Running, launch: Launcher, system_orb: Orb) -> None:
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    limits = RoboCorba.MotionLimits(1.0, 1.75, 1.0, 1.75)
    start = RoboCorba.Pose("L1", X + 0.5, Y, 0.0)
    other = server.registerRobot(RoboCorba.RobotDescription("other", start, 0.4, 127.0, limits))
    process = launch(
        *(*module_command("robocorba.clients.new_robot"), corbaname(system.naming, "RoboCorba/SimulationServer")),
        PYTHONPATH=str(ROOT),
    )
    _, err = process.communicate(timeout=60.0)
    other.deregister()
    assert process.returncode == 1
    assert "PlaceTaken" in err and "other" in err
    assert [client.name for client in server.clients()] == []

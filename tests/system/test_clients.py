"""Clients of every kind against running servers: our commands, a bare CORBA client, the demo, and the robot client in
20 lines."""

from __future__ import annotations

import ast
import contextlib
import os
import re
import signal
from pathlib import Path

import psutil
import pytest
from omniORB import CORBA
from PIL import Image

from robocorba.orb.naming import corbaname
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.supervision.launch import LoggedProcess, module_command
from testkit.heartbeats import heartbeats
from testkit.processes import ROBOCORBA, Launcher, Running, eventually, read_json
from testkit.simulation import about

pytestmark = [pytest.mark.system, pytest.mark.slow(120)]

ROOT = Path(__file__).resolve().parents[2]
#: Where the robot of this client begins.
X, Y = 3.0, 4.0
WEST, EAST = ("L1", "3", "3"), ("L1", "15", "3")
#: A spot within the wall between them.
WALLED = ("L1", "10", "2")


def run(launch: Launcher, *command: str, timeout_s: float = 60.0) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command that finds our programs."""
    process = launch(*command, PYTHONPATH=str(ROOT), COLUMNS="200")
    out, err = process.communicate(timeout=timeout_s)
    return process.returncode, out, err


def place(words: tuple[str, str, str]) -> str:
    return f"{words[0]}:{words[1]},{words[2]}"


def test_the_small_client(system: Running, launch: Launcher) -> None:
    module = module_command("robocorba.clients.get_path")
    code, out, err = run(launch, *module, *WEST, *EAST, str(system.naming))
    assert (code, err) == (0, "")
    first, *_, last = out.splitlines()
    assert first.startswith("   0.0 s  L1:3.00,3.00  START")
    assert "L1:15.00,3.00  GOAL" in last
    code, out, err = run(launch, *module, *WEST, *WALLED, str(system.naming))
    assert (code, out) == (1, "")
    assert err.startswith("no path: ") and "NotFree" in err and "Traceback" not in err


def test_the_command_prints_and_draws(system: Running, launch: Launcher, tmp_path: Path) -> None:
    naming = ("--naming", str(system.naming))
    code, out, err = run(launch, ROBOCORBA, "path", place(WEST), "L2:14,3", "--picture", "path.png", *naming)
    assert (code, err) == (0, "")
    assert "map version 1" in out
    for word in ("start", "goal", "elevator entry E1", "elevator exit E1", "15.00", "distance [m]"):
        assert word in out
    assert "drew path.png" in out
    with Image.open(tmp_path / "path.png") as picture:
        assert min(picture.size) > 100


def test_a_robot_drives_along_a_path_and_rides(system: Running, system_orb: Orb, launch: Launcher) -> None:
    def said(*command: str) -> str:
        code, out, err = run(launch, ROBOCORBA, "simulation", *command, "--state", str(system.state))
        assert (code, err) == (0, "")
        return out

    # A ride is lost 15 s of simulated time after the doors opened: faster, a busy machine takes longer to drive in.
    assert said("pace", "2") == ""
    environment = {"PYTHONPATH": str(ROOT), "ROBOCORBA_NAMING": str(system.naming)}
    process = launch(*module_command("robocorba.clients.drive"), "A", *WEST, "L2", "14", "3", **environment)
    out, err = process.communicate(timeout=180.0)
    assert (process.returncode, err) == (0, "")
    assert said("pace", "1") == ""
    assert out.splitlines()[:2] == ["A calls E1", "A is on L2"]
    assert out.splitlines()[2].startswith("A has arrived: L2 (")
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer, 30.0)
    robot = about("A", float(WEST[1]), float(WEST[2]))
    again = "To let it in again: robocorba simulation admit A"

    assert said("evict", "A") == f"A\tis kept out; it was not logged on. {again}\n"
    with pytest.raises(RoboCorba.InvalidDescription) as refused:
        server.registerRobot(robot)
    assert refused.value.reason == "an administrator keeps A out, until `robocorba simulation admit A`"
    assert said("admit") == "kept out\nA\n"
    assert said("admit", "A") == "A\tmay log on again\n"
    session = server.registerRobot(robot)
    with contextlib.closing(heartbeats(lambda: [session])):
        assert said("evict", "A") == f"A\tis logged off and kept out. {again}\n"
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        session.heartbeat()
    assert said("admit", "A") == "A\tmay log on again\n"
    assert said("admit", "A") == "A\twas not kept out\n"


def test_a_bare_uri_and_the_stubs_suffice(system: Running, system_orb: Orb) -> None:
    uri = corbaname(system.naming, "RoboCorba/PathPlanner")
    assert f"map_editor\t{system.pid('map_editor')}\t{uri}" in system.printed
    planner = CORBA.ORB_init([], CORBA.ORB_ID).string_to_object(uri)._narrow(RoboCorba.PathPlanner)
    path = planner.getPath(RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L1", 15.0, 3.0))
    assert [str(path[0].kind), str(path[-1].kind)] == ["START", "GOAL"]


def test_the_demo_carries_the_table(tmp_path: Path) -> None:
    command = (*module_command("robocorba.clients.demo"), "demo", "--quick")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    printed = []
    with LoggedProcess(tmp_path / "errors", *command, cwd=tmp_path, env=environment) as process:
        while line := process.read_line(300.0):  # on a new machine kernels are compiled first
            printed.append(line)
        assert process.wait(60) == 0, "".join(printed) + process.log_tail()
    for phase in ("gathering", "gripping", "carrying", "putting down", "done"):
        assert f" {phase} " in "".join(printed)
    report = read_json((tmp_path / "demo" / "report.json").read_text())
    assert report["result"] == "done"
    said = report["simulation_server"]
    assert said["is_there"] and said["off_mm"] <= 50.0 and abs(said["off_deg"]) <= 3.0
    assert {"lab", "hall"} <= report["latency_ms"].keys()
    page = (tmp_path / "demo" / "report.html").read_text()
    for name in ("before.png", "carrying.png", "after.png", "timeline.png"):
        assert f"src='{name}'" in page
        with Image.open(tmp_path / "demo" / name) as picture:
            picture.verify()
    assert (tmp_path / "demo" / "logs" / "robot_A.log").is_file()
    eventually(lambda: left_of_the_demo(tmp_path) == [], what="nothing is left")


def test_a_demo_that_is_interrupted_leaves_nothing_behind(launch: Launcher, tmp_path: Path) -> None:
    demo = (*module_command("robocorba.clients.demo"), "demo", "--quick")
    process = launch(*demo, PYTHONPATH=str(ROOT), TMPDIR=str(tmp_path))
    eventually(lambda: list(tmp_path.glob("robocorba-demo-*/up.json")), what="the servers' start")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err == "demo: ended by Ctrl-C; logs are in demo/logs\n"
    eventually(lambda: left_of_the_demo(tmp_path) == [], what="nothing is left")


def left_of_the_demo(folder: Path) -> list[str]:
    """State folders in `folder`, and processes that use it."""
    lines = (" ".join(child.info["cmdline"] or []) for child in psutil.process_iter(["cmdline"]))
    folders = map(str, folder.glob("robocorba-demo-*"))
    return [*(line for line in lines if f"{folder}/robocorba-demo-" in line), *folders]


# ---- the robot client in 20 lines ----


def test_it_needs_nothing_but_an_orb_and_the_stubs() -> None:
    text = (ROOT / "clients" / "new_robot.py").read_text()
    lines = text.splitlines(keepends=True)[ast.parse(text).body[0].end_lineno :]  # without the docstring
    code = "".join(lines).lstrip("\n")
    assert len(code.splitlines()) <= 20
    assert {line for line in code.splitlines() if "import" in line} == {
        *("import sys", "import time", "from omniORB import CORBA", "from robocorba.stubs import RoboCorba")
    }


def test_it_drives_until_something_is_near(system: Running, launch: Launcher, system_orb: Orb) -> None:
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)

    def robots() -> dict[str, float]:
        return {client.name: client.at.x for client in server.clients()}

    uri = corbaname(system.naming, "RoboCorba/SimulationServer")
    process = launch(*module_command("robocorba.clients.new_robot"), uri, PYTHONPATH=str(ROOT))
    eventually(lambda: robots().get("new", 0.0) > X + 1.0, what="it drives")
    out, err = process.communicate(timeout=60.0)
    assert (process.returncode, err) == (0, "")
    found = re.fullmatch(r"something is near .*RoboCorba\.Pose\(floor='L1', x=(.*), y=(.*), heading=(.*)\)\n", out)
    assert found, out
    x, y, heading = map(float, found.groups())
    assert (y, heading) == pytest.approx((Y, 0.0), abs=1e-3)
    # The wall across the floor is at x = 10; at 0.5 m/s it needs a tick and some way to stand.
    assert 8.7 < x < 9.5
    assert robots() == {}

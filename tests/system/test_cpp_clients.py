"""Clients that are compiled here, against running servers: in C++, and in Python with the IDL of a release."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robocorba import __version__
from robocorba.errors.robots import InvalidProgram, RobotError
from robocorba.orb.naming import corbaname
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Destination
from robocorba.robot.programs.program import dumps
from robocorba.stubs import RoboCorba
from testkit.processes import ROBOCORBA, Launcher, Running, drain, eventually, read_json
from testkit.simulation import about

pytestmark = [pytest.mark.system, pytest.mark.slow(160), pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
RELEASED = ROOT / "idl" / "released"
LIMIT_S = 180.0
WEST, EAST = ("L1", "3", "3"), ("L1", "15", "3")
#: A spot within the wall between them.
WALLED = ("L1", "10", "2")


#: The system's one: that of a virtual environment comes first on PATH and has no back-end for C++.
OMNIIDL = shutil.which("omniidl", path="/usr/local/bin:/usr/bin:/bin")
#: A clean environment: Debian's omniidl must not find the Python modules of another one.
CLEAN = {"PATH": "/usr/local/bin:/usr/bin:/bin"}
#: Makes the program of a client.
CppCompiler = Callable[[str], Path]


def run_clean(*command: str | None, limit_s: float = 250.0, **options: Any) -> subprocess.CompletedProcess[str]:
    """A command that has ended, in a clean environment."""
    words = [str(each) for each in command]
    return subprocess.run(words, capture_output=True, text=True, env=CLEAN, timeout=limit_s, **options)


def has_cpp() -> bool:
    """Whether a program for C++ and omniORB can be built here."""
    if not (shutil.which("make") and shutil.which("g++") and OMNIIDL):
        return False
    includes = run_clean("g++", "-E", "-x", "c++", "-", input="#include <omniORB4/CORBA.h>")
    back_end = run_clean(OMNIIDL, "-bcxx", "-u")
    return includes.returncode == 0 and "-Wb" in back_end.stdout + back_end.stderr


@pytest.fixture(scope="module")
def cpp(tmp_path_factory: pytest.TempPathFactory) -> CppCompiler:
    """Compiles a client in C++."""
    if not has_cpp():
        pytest.skip("needs make, g++, libomniorb4-dev and omniidl with its back-end for C++")
    folder = tmp_path_factory.mktemp("cpp")
    make = ("make", "-C", str(ROOT / "clients" / "cpp"), f"OUT={folder}", f"OMNIIDL={OMNIIDL}", "OPTIMIZE=-O0")

    def compiled(name: str) -> Path:
        made = run_clean(*make, str(folder / name))
        assert made.returncode == 0, made.stdout + made.stderr
        return folder / name

    return compiled


def run_cpp(program: Path, *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    ran = run_clean(str(program), *arguments, limit_s=60.0)
    return ran.returncode, ran.stdout, ran.stderr


def test_a_client_in_cpp(system: Running, cpp: CppCompiler) -> None:
    client = (cpp("get_path"), corbaname(system.naming, "RoboCorba/PathPlanner"))
    code, out, err = run_cpp(*client, *WEST, *EAST)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["0", "s", "L1:3,3"]
    assert lines[-1].split()[2] == "L1:15,3"
    assert run_cpp(*client, *WEST, *WALLED) == (1, "", "goal is too near to wall w\n")


def test_a_robot_in_cpp(system: Running, cpp: CppCompiler) -> None:
    client = (cpp("new_robot"), corbaname(system.naming, "RoboCorba/SimulationServer"))
    code, out, err = run_cpp(*client, *WEST)
    assert (code, err) == (0, "")
    assert out.startswith("something is near L1:")
    assert run_cpp(*client, "L9", "1", "1") == (1, "", "there is no floor L9\n")
    code, out, err = run_cpp(*client, *WALLED)
    assert (code, out) == (1, "") and err.startswith("the place is taken by")


def test_a_consumer_of_events_in_cpp(system: Running, system_orb: Orb, launch: Launcher, cpp: CppCompiler) -> None:
    channel = corbaname(system.naming, "RoboCorba/EventChannels/main")
    client = (str(cpp("floor_events")), corbaname(system.naming, "RoboCorba/OmniDatabase"), channel)
    consumer = launch(*client, "L1", "5")
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    robot = server.registerRobot(about("seen", 3.0, 3.0, floor="L1"))
    try:

        def has_ended() -> bool:
            robot.command(RoboCorba.Velocity(0.2, 0.0, 0.0), 0.5)
            return consumer.poll() is not None

        eventually(has_ended, what="five lines of a moving robot")
        out, err = consumer.communicate(timeout=60.0)
        assert (consumer.returncode, err) == (0, "")
        assert len(out.splitlines()) == 5
        assert all(line.split()[2] == "seen" for line in out.splitlines())
    finally:
        robot.deregister()
    assert run_cpp(Path(client[0]), *client[1:], "L9") == (1, "", "there is no floor L9\n")


def test_an_adaptor_in_cpp(
    system: Running, system_orb: Orb, launch: Launcher, cpp: CppCompiler, tmp_path: Path
) -> None:
    """A robot without arms drives; what needs arms is refused."""
    adaptor = launch(str(cpp("disc_adaptor")), f"corbaloc::{system.naming}/NameService", "disc")
    assert adaptor.stdout is not None and adaptor.stdout.readline() == "ready\n"
    where = ("--floor", "L1", "--at", "3,3,0", "--naming", str(system.naming), "--state", str(tmp_path / "disc"))
    robot = launch(ROBOCORBA, "robot", "disc", *where, "--adaptor", "corba", "--", "3", "3", "0")
    assert robot.stdout is not None and robot.stdout.readline() == "ready\n"
    drain(robot)
    agent = RemoteAgent(system_orb, "disc")
    for json in (
        dumps(ProgramBuilder("waves").mhand_posture("both", "home").program()),
        dumps(ProgramBuilder("carries").move_table("table", Destination("L1", 6.0, 3.0)).program()),
    ):
        with pytest.raises(InvalidProgram, match="this robot has 0 joints, not SmartPal's 18"):
            agent.load(json)
    agent.load(dumps(ProgramBuilder("drives").mbase_to(4.0, 3.0).program()))
    agent.run()
    eventually(lambda: is_done(agent), LIMIT_S, "the disc has arrived")
    assert agent.state().at[1:3] == pytest.approx((4.0, 3.0), abs=0.02)
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    eventually(lambda: abs(next(c for c in server.clients() if c.name == "disc").at.x - 4.0) < 0.05)  # its body follows
    # Its laser sees a wall that the map does not have, but only if it is said where.
    watched = ProgramBuilder("watched")
    with watched.stop_if_closer("laser", 1.0):
        watched.mbase_by(ahead=3.0, speed=0.2)
    with pytest.raises(InvalidProgram, match="the adaptor corba has no sensor laser; it has no sensors"):
        agent.load(dumps(watched.program()))
    agent.switch("corba", ["4", "3", "0", "6.5"])
    agent.load(dumps(watched.program()))
    agent.run()
    eventually(lambda: is_done(agent), LIMIT_S, "its laser has stopped the disc")
    assert 5.4 < agent.state().at.x < 6.0  # before the wall, on a busy machine later
    with pytest.raises(RoboCorba.UnknownSensor) as unknown:
        system_orb.resolve("Robots/disc", RoboCorba.RobotAgent)._get_sensors().ranges("sonar")
    assert (unknown.value.name, unknown.value.known) == ("sonar", ["laser"])
    nobody = run_cpp(cpp("disc_adaptor"), "corbaloc::127.0.0.1:1/NameService", "disc")
    assert nobody == (1, "", "the call failed: TRANSIENT\n")


def is_done(agent: RemoteAgent) -> bool:
    """Whether the program is done. It is run again where a busy machine kept the adaptor from an answer in time."""
    program = agent.state().program
    if program.result is ProgramResult.FAILED:
        assert "does not answer" in program.reason
        with contextlib.suppress(RobotError):  # it may not have reconnected yet
            agent.run()
    return program.result is ProgramResult.DONE


@pytest.mark.parametrize("release", [folder.name for folder in sorted(RELEASED.iterdir())])
def test_a_client_of_a_release_works_unchanged(system: Running, tmp_path: Path, release: str) -> None:
    """With Python stubs of its IDL, as the client's own project would make them."""
    make = [sys.executable, str(ROOT / "idl" / "make_stubs.py"), str(tmp_path / "stubs"), str(RELEASED / release)]
    subprocess.run(make, check=True, timeout=60)
    command = (sys.executable, str(Path(__file__).with_name("released_client.py")), str(system.naming))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "stubs")}
    ran = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stderr) == (0, "")
    found: dict[str, Any] = read_json(ran.stdout)
    path = found.pop("path")
    assert (path[0], path[-1]) == ("START", "GOAL") and "ELEVATOR_ENTRY" in path
    assert "released" in found.pop("bodies")  # beside a robot of another test, perhaps, that has just been killed
    assert found == {
        "paths": 1,
        "refused": ["goal", "L9", ["L1", "L2"]],
        "edited": True,
        "rays": 181,
        "since": True,
        "event": "released.client",
        "missions": 0,
        "release": __version__,
    }

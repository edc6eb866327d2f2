"""Clients of every kind against running servers: our commands, a bare CORBA client, those in C++, the demo."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import psutil
import pytest
from omniORB import CORBA
from PIL import Image

from robocorba.control.agent_state import ProgramResult
from robocorba.corba.naming import corbaname
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.errors.robots import InvalidProgram
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.icons import Destination
from robocorba.programs.program import dumps
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import LoggedProcess, module_command
from robocorba.testing.heartbeats import heartbeats
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, drain, eventually, read_json
from robocorba.testing.simulation import about

pytestmark = [pytest.mark.system, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]
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
    simulation, state = (ROBOCORBA, "simulation"), ("--state", str(system.state))
    # A ride is lost 15 s of simulated time after the doors opened: faster, a busy machine takes longer to drive in.
    assert run(launch, *simulation, "pace", "2", *state) == (0, "", "")
    environment = {"PYTHONPATH": str(ROOT), "ROBOCORBA_NAMING": str(system.naming)}
    process = launch(*module_command("robocorba.clients.drive"), "A", *WEST, "L2", "14", "3", **environment)
    out, err = process.communicate(timeout=180.0)
    code = process.returncode
    assert (code, err) == (0, "")
    assert out.splitlines()[:2] == ["A calls E1", "A is on L2"]
    assert out.splitlines()[2].startswith("A has arrived: L2 (")
    code, out, err = run(launch, *simulation, "evict", "A", *state)
    again = "To let it in again: robocorba simulation admit A"
    assert (code, out, err) == (0, f"A\tis kept out; it was not logged on. {again}\n", "")
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer, 30.0)
    robot = about("A", float(WEST[1]), float(WEST[2]))
    with pytest.raises(RoboCorba.InvalidDescription) as refused:
        server.registerRobot(robot)
    assert refused.value.reason == "an administrator keeps A out, until `robocorba simulation admit A`"
    assert run(launch, *simulation, "admit", *state) == (0, "A\n", "")
    assert run(launch, *simulation, "admit", "A", *state) == (0, "A\tmay log on again\n", "")
    session = server.registerRobot(robot)
    with contextlib.closing(heartbeats(lambda: [session])):
        code, out, err = run(launch, *simulation, "evict", "A", *state)
    assert (code, out, err) == (0, f"A\tis logged off and kept out. {again}\n", "")
    with pytest.raises(CORBA.OBJECT_NOT_EXIST):
        session.heartbeat()
    assert run(launch, *simulation, "admit", "A", *state) == (0, "A\tmay log on again\n", "")
    assert run(launch, *simulation, "admit", "A", *state) == (0, "A\twas not kept out\n", "")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((place(WEST), place(WALLED)), "goal L1:10,2 is not free: 0.000 m to wall w, 0.400 m needed"),
        ((place(WEST), "L9:1,1"), "goal: there is no floor 'L9'; known are L1, L2"),
        ((place(WEST), "L1:nan,1"), "goal.x: nan is not a number within 1000000 m"),
        ((place(WEST), "L1"), "goal: 'L1' is not of the form FLOOR:X,Y, such as L1:3,4"),
        ((place(WEST), place(EAST), "--radius", "5"), "robotRadius: 5.0 is not between 0 and 3 m"),
        ((place(WEST), place(EAST), "--graph", "tram"), "navigationGraph: no edge belongs to a graph 'tram'"),
        ((place(WEST), "L2:14,3", "--avoid", "E1"), "no elevator leads from L1 to L2; elevator 'E1'"),
    ],
)
def test_the_command_says_why_there_is_no_path(
    system: Running, launch: Launcher, arguments: tuple[str, ...], reason: str
) -> None:
    code, out, err = run(launch, ROBOCORBA, "path", *arguments, "--naming", str(system.naming))
    assert (code, out) == (1, "")
    assert err.startswith(f"robocorba path: {reason}"), err
    assert len(err.splitlines()) == 1


def test_a_bare_uri_and_the_stubs_suffice(system: Running, system_orb: Orb) -> None:
    uri = corbaname(system.naming, "RoboCorba/PathPlanner")
    assert f"map_editor\t{system.pid('map_editor')}\t{uri}" in system.printed
    planner = CORBA.ORB_init([], CORBA.ORB_ID).string_to_object(uri)._narrow(RoboCorba.PathPlanner)
    path = planner.getPath(RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L1", 15.0, 3.0))
    assert [str(path[0].kind), str(path[-1].kind)] == ["START", "GOAL"]


def has_cpp() -> bool:
    """Whether a program for C++ and omniORB can be built here."""
    if not (shutil.which("make") and shutil.which("g++") and OMNIIDL):
        return False
    includes = subprocess.run(
        ["g++", "-E", "-x", "c++", "-"], input="#include <omniORB4/CORBA.h>", capture_output=True, text=True
    )
    back_end = subprocess.run(
        [OMNIIDL, "-bcxx", "-u"], capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"}, timeout=30
    )
    return includes.returncode == 0 and "-Wb" in back_end.stdout + back_end.stderr


#: The system's one: that of a virtual environment comes first on PATH and has no back-end for C++.
OMNIIDL = shutil.which("omniidl", path="/usr/local/bin:/usr/bin:/bin")


#: A clean environment: Debian's omniidl must not find the Python modules of another one.
CLEAN = {"PATH": "/usr/local/bin:/usr/bin:/bin"}


#: Makes the program of a client.
CppCompiler = Callable[[str], Path]


def make_cpp(folder: Path, target: str) -> subprocess.Popen[str]:
    """Begin to make a file of clients/cpp in a folder."""
    options = (f"OUT={folder}", f"OMNIIDL={OMNIIDL}", "OPTIMIZE=-O0")
    command = ("make", "-C", str(ROOT / "clients" / "cpp"), *options, str(folder / target))
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=CLEAN)


def made(making: subprocess.Popen[str]) -> None:
    """Wait for what `make_cpp` has begun."""
    output, _ = making.communicate(timeout=250)
    assert making.returncode == 0, output


@pytest.fixture(scope="module")
def cpp_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cpp")


@pytest.fixture(scope="module", autouse=True)
def cpp_stubs(cpp_folder: Path) -> Iterator[subprocess.Popen[str] | None]:
    """Compiles the stubs that all clients in C++ need, while the tests before theirs run; None where C++ is missing."""
    if not has_cpp():
        yield None
        return
    with make_cpp(cpp_folder, "robocorbaSK.o") as making:
        yield making
        making.terminate()  # if no test has waited for it


@pytest.fixture(scope="module")
def cpp(cpp_folder: Path, cpp_stubs: subprocess.Popen[str] | None) -> CppCompiler:
    """Compiles a client in C++."""
    if cpp_stubs is None:
        pytest.skip("needs make, g++, libomniorb4-dev and omniidl with its back-end for C++")
    made(cpp_stubs)

    def compiled(name: str) -> Path:
        made(make_cpp(cpp_folder, name))
        return cpp_folder / name

    return compiled


def run_cpp(program: Path, *arguments: str, timeout_s: float = 60.0) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    ran = subprocess.run((str(program), *arguments), capture_output=True, text=True, env=CLEAN, timeout=timeout_s)
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

        eventually(has_ended, 60.0, "five lines of a moving robot")
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
    eventually(lambda: agent.state().program.result is ProgramResult.DONE, 60.0, "the disc has arrived")
    assert agent.state().at[1:3] == pytest.approx((4.0, 3.0), abs=0.02)
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    eventually(lambda: abs(next(c for c in server.clients() if c.name == "disc").at.x - 4.0) < 0.05)  # its body follows
    nobody = run_cpp(cpp("disc_adaptor"), "corbaloc::127.0.0.1:1/NameService", "disc")
    assert nobody == (1, "", "the call failed: TRANSIENT\n")


class Demo(NamedTuple):
    """A demo that runs in a folder. printed: so far."""

    process: LoggedProcess
    folder: Path
    printed: list[str]

    def read_until(self, word: str) -> None:
        """Read what it prints up to a line with this word, or all."""
        while line := self.process.read_line(300.0):  # on a new machine kernels are compiled first
            self.printed.append(line)
            if word and word in line:
                return
        assert not word, "".join(self.printed) + self.process.log_tail()


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Demo]:
    folder = tmp_path_factory.mktemp("demo")
    command = (*module_command("robocorba.clients.demo"), "demo", "--quick")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder)}
    with LoggedProcess(folder / "errors", *command, cwd=folder, env=environment) as process:
        yield Demo(process, folder, [])


def test_the_demo_starts_a_mission(demo: Demo) -> None:
    demo.read_until(" gathering ")


def test_its_robots_grip_the_table(demo: Demo) -> None:
    demo.read_until(" gripping ")


def test_its_robots_carry_the_table(demo: Demo) -> None:
    demo.read_until("")
    out, folder = "".join(demo.printed), demo.folder
    assert demo.process.wait(60) == 0, out + demo.process.log_tail()
    for phase in ("gathering", "gripping", "carrying", "putting down", "done"):
        assert f" {phase} " in out
    report = read_json((folder / "demo" / "report.json").read_text())
    assert report["result"] == "done"
    said = report["simulation_server"]
    assert said["is_there"] and said["off_mm"] <= 50.0 and abs(said["off_deg"]) <= 3.0
    assert {"lab", "hall"} <= report["latency_ms"].keys()
    page = (folder / "demo" / "report.html").read_text()
    for name in ("before.png", "carrying.png", "after.png", "timeline.png"):
        assert f"src='{name}'" in page
        with Image.open(folder / "demo" / name) as picture:
            picture.verify()
    assert (folder / "demo" / "logs" / "robot_A.log").is_file()
    assert left_of_the_demo(folder) == []


def test_a_demo_that_is_interrupted_leaves_nothing_behind(launch: Launcher, tmp_path: Path) -> None:
    demo = (*module_command("robocorba.clients.demo"), "demo", "--quick")
    process = launch(*demo, PYTHONPATH=str(ROOT), TMPDIR=str(tmp_path))
    eventually(lambda: list(tmp_path.glob("robocorba-demo-*/up.json")), 60.0, "the servers' start")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err == "demo: ended by Ctrl-C; logs are in demo/logs\n"
    assert left_of_the_demo(tmp_path) == []


def left_of_the_demo(folder: Path) -> list[str]:
    """State folders in `folder`, and processes that use it."""
    lines = (" ".join(child.info["cmdline"] or []) for child in psutil.process_iter(["cmdline"]))
    return [line for line in lines if f"{folder}/robocorba-demo-" in line] + [
        *map(str, folder.glob("robocorba-demo-*"))
    ]

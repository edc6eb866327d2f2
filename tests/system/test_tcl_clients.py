"""A foreign ORB, Combat for Tcl, calls every operation that clients call, and gets what Python gets.

The script tcl_client.tcl checks most answers itself. What it prints is compared here with the same calls in Python."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import CosEventChannelAdmin
import pytest
from omniORB import EnumItem

from robocorba import __version__
from robocorba.orb.naming import corbaname
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.supervision.launch import LoggedProcess
from testkit.processes import ROBOCORBA, Launcher, Running, drain, read_json
from testkit.simulation import error_lines
from tests.system.event_place import PushConsumer

pytestmark = [pytest.mark.system, pytest.mark.slow(90), pytest.mark.full]

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
IDL = ROOT / "idl"
NAMING_IDL = HERE / "CosNaming.idl"
ROBOT = "A"
#: Time limit of what the script does between two lines; it waits for robots that drive [s].
LIMIT_S = 280.0

#: Why operations are not called, by interface or by operation. Everything else of the IDL is.
NOT_CALLED = {
    "CosEventChannelAdmin/EventChannel/destroy": "ends the channel of the system; test_event_channel.py calls it",
    "RoboCorba/CallbackRoute": "needs bidirectional GIOP, which Combat has not",
    "RoboCorba/EventChannel/joinGateway": "channels of release 0.1.0 called it among themselves",
    "RoboCorba/EventChannel/joinPeer": "channels call it among themselves",
    "RoboCorba/EventGateway": "channels call it among themselves",
    "RoboCorba/GatewayFeed": "channels call it among themselves",
    "RoboCorba/PeerFeed": "channels call it among themselves",
    "RoboCorba/PeerGateway": "channels call it among themselves",
    "RoboCorba/NameRegistry": "servers and robots call it, in a guarded system",
    "RoboCorba/SensorRegistration": "sensor servers call it",
    "RoboCorba/SimulationServer/registerSensor": "sensor servers call it",
    "RoboCorba/SimulationServer/reportScans": "sensor servers of earlier releases call it",
    "RoboCorba/SimulationServer/reportSensor": "sensor servers of earlier releases call it",
    **dict.fromkeys(
        ("ArmUnit", "GripperExtAxes", "GripperUnit", "LumbaExtAxes", "LumbarUnit", "YeRTUnitMobility/mobility"),
        "the robot SmartPal V serves it, and RoboCorba is its client",
    ),
    "RoboCorba/SmartPalFaults": "belongs to the stand-in of the robot",
}


def has_combat() -> bool:
    """Whether Tcl and Combat are installed."""
    if not shutil.which("tclsh"):
        return False
    script = "exit [catch {package require combat}]"
    return subprocess.run(["tclsh"], input=script, text=True, capture_output=True, timeout=120).returncode == 0


if not has_combat():
    pytest.skip("needs tclsh with Combat (Debian's tcl-combat)", allow_module_level=True)


def of_idl(name: str) -> ModuleType:
    """A module beside the IDL, which is no part of the package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(IDL)
        return importlib.import_module(name)


def plain(value: Any) -> Any:
    """A value of omniORB as the script prints it."""
    if isinstance(value, EnumItem):
        return str(value)
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if hasattr(value, "_d") and hasattr(value, "_v"):
        return [plain(value._d), plain(value._v)]
    if hasattr(value, "_NP_RepositoryId"):
        return {name: plain(member) for name, member in vars(value).items()}
    return value


class Script:
    """The script, while it runs. answers: by their names; failed: the reasons, by subject; called: operations; pushed:
    what a consumer in Python has received meanwhile, which is connected before the script begins."""

    process: LoggedProcess

    def __init__(self, orb: Orb) -> None:
        self.answers: dict[str, Any] = {}
        self.called: set[str] = set()
        self.passed: list[str] = []
        self.failed: dict[str, str] = {}
        self.pushed: list[Any] = []
        consumer = PushConsumer(take=lambda value: self.pushed.append(plain(value.value())))
        channel = orb.resolve("EventChannels/main", CosEventChannelAdmin.EventChannel)
        channel.for_consumers().obtain_push_supplier().connect_push_consumer(orb.activate(consumer))

    def read_until(self, subject: str = "") -> None:
        """Read what it prints until it has ended a subject, or all."""
        while subject not in self.passed and subject not in self.failed:
            line = self.process.read_line(LIMIT_S)
            if not line:
                assert (self.process.wait(LIMIT_S), self.process.log_tail()) == (0, "")
                break
            kind, about, *more = read_json(line)
            if kind == "answer":
                self.answers[about] = more[0]
            elif kind == "called":
                self.called.add(about)
            elif kind == "failed":
                self.failed[about] = more[0]
            else:
                self.passed.append(about)


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file with the IDL for Combat."""
    file = tmp_path_factory.mktemp("tcl") / "robocorba.tcl"
    files = [*sorted(map(str, IDL.glob("*.idl"))), str(NAMING_IDL)]
    file.write_text(of_idl("make_stubs").omniidl("-p", str(IDL), "-b", "tcl", *files))
    return file


@pytest.fixture(scope="module")
def robot(system: Running, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with Launcher(tmp_path_factory.mktemp("robot")) as launch:
        where = ("--floor", "L1", "--at", "3,5,0", "--channel", "main", "--naming", str(system.naming))
        process = launch(ROBOCORBA, "robot", ROBOT, *where, "--state", str(launch.folder / "state"))
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "ready\n", process.stderr.read()
        drain(process)
        yield ROBOT


@pytest.fixture(scope="module")
def pids(system: Running) -> set[int]:
    """The processes of the system before the script begins."""
    return {process.pid for process in system.record().processes}


@pytest.fixture(scope="module")
def script(
    system: Running,
    system_orb: Orb,
    robot: str,
    repository: Path,
    pids: set[int],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Script]:
    command = ("tclsh", "-encoding", "utf-8", str(HERE / "tcl_client.tcl"))
    arguments = (str(repository), str(system.naming), str(system.state), "main", robot)
    log = tmp_path_factory.mktemp("script") / "errors"
    script = Script(system_orb)
    with LoggedProcess(log, *command, *arguments, encoding="utf-8") as script.process:
        yield script


@pytest.fixture(scope="module")
def output(script: Script) -> Script:
    """The whole script, run once."""
    script.read_until()
    return script


SUBJECTS = [
    line.split()[1] for line in (HERE / "tcl_client.tcl").read_text().splitlines() if line.startswith("subject ")
]


@pytest.mark.parametrize("subject", SUBJECTS)
def test_the_script_finds_what_it_expects(script: Script, subject: str) -> None:
    script.read_until(subject)
    assert subject not in script.failed, script.failed[subject]
    assert subject in script.passed


def test_every_operation_that_clients_call_is_called_or_served(output: Script) -> None:
    contract = of_idl("contract")
    signatures = contract.signatures([*map(str, IDL.glob("*.idl")), str(NAMING_IDL)])
    operations = {
        declaration.removeprefix("IDL:").removeprefix("omg.org/").removesuffix(":1.0")
        for declaration, signature in signatures.items()
        if " raises (" in signature or "attribute " in signature
    }
    called = {each.removeprefix("IDL:").removeprefix("omg.org/").removesuffix(":1.0") for each in output.called}
    excepted = {each for each in operations if {each, each.rpartition("/")[0]} & NOT_CALLED.keys()}
    assert called == operations - excepted
    assert {each for each in NOT_CALLED if not any(f"{one}/".startswith(f"{each}/") for one in excepted)} == set()


def test_the_servers_live_on(output: Script, system: Running, pids: set[int]) -> None:
    assert pids <= {process.pid for process in system.record().processes}
    assert error_lines(system.state) == []


# ---- the same calls in Python ----


@pytest.fixture(scope="module")
def objects(system_orb: Orb, output: Script) -> SimpleNamespace:
    return SimpleNamespace(
        editor=system_orb.resolve("MapEditor", RoboCorba.MapEditor),
        planner=system_orb.resolve("PathPlanner", RoboCorba.PathPlanner),
        database=system_orb.resolve("OmniDatabase", RoboCorba.OmniDatabase),
        sensor=system_orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor),
        channel=system_orb.resolve("EventChannels/main", RoboCorba.EventChannel),
        agent=system_orb.resolve(f"Robots/{ROBOT}", RoboCorba.RobotAgent),
        control=system_orb.resolve("MissionControl", RoboCorba.MissionControl),
    )


WEST, TOP = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L2", 14.0, 3.1)
MOUNT = RoboCorba.Mount(0.1, 0.05, 0.2)
BAD_PROGRAM = '{"name": "x", "icons": [{"icon": "wait", "seconds": -1}]}'


def paths(planner: Any) -> Any:
    request = planner.defaultRequest(WEST, TOP)
    request.alternatives, request.mode, request.best = 2, RoboCorba.GEOMETRIC, RoboCorba.SHORTEST_TIME
    corners = [RoboCorba.XY(5.0, 2.0), RoboCorba.XY(6.0, 2.0), RoboCorba.XY(6.0, 4.0)]
    request.forbiddenAreas = [RoboCorba.ForbiddenArea("L1", corners)]
    return planner.findPaths(request)


def scan(sensor: Any, x: float, spec: Any) -> Any:
    return sensor.scan(RoboCorba.Pose("L2", x, 5.0, 0.5), MOUNT, spec)


def noisy_scans(sensor: Any) -> Any:
    spec = sensor.laser()
    spec.noise = RoboCorba.ScanNoise(0.01, 0.02, 0.1, 7)
    places = [RoboCorba.Pose("L2", 13.0, 5.0, 0.5), RoboCorba.Pose("L2", 14.0, 4.0, 0.0)]
    return sensor.scanMany(places, MOUNT, spec)


def page(editor: Any, start: int) -> Any:
    part = RoboCorba.MapSelection([RoboCorba.WALL_ELEMENT, RoboCorba.NODE_ELEMENT], "L1")
    return editor.readElements(start, part, 2)


#: By the name of an answer in the script, the same call.
SAME_CALLS: dict[str, Callable[[SimpleNamespace], Any]] = {
    "path": lambda of: of.planner.getPath(WEST, TOP),
    "paths": lambda of: paths(of.planner),
    "floors": lambda of: of.editor.floors(),
    "elements_EDGE": lambda of: of.editor.elements(RoboCorba.EDGE_ELEMENT, "L1"),
    "elements_ELEVATOR": lambda of: of.editor.elements(RoboCorba.ELEVATOR_ELEMENT, ""),
    "changes": lambda of: of.editor.changesSince(1),
    "next_page": lambda of: page(of.editor, page(of.editor, 0).next),
    "document": lambda of: of.editor.exportMap(),
    "no_picture": lambda of: of.editor.getUnderlay("L1"),
    "proximity": lambda of: of.sensor.proximity(0.3),
    "scan": lambda of: scan(of.sensor, 13.0, of.sensor.laser()),
    "noisy_scans": lambda of: noisy_scans(of.sensor),
    "own_scan": lambda of: scan(of.sensor, 16.4, of.sensor.proximity(0.3)),
    "elevators": lambda of: of.database.elevators(),
    "adaptors": lambda of: of.agent.adaptors(),
    "check_program": lambda of: of.agent.checkProgram(BAD_PROGRAM),
    "leaders": lambda of: of.control.leaders(of.control.missionsSince(0)[0].name),
}
#: Members that change meanwhile.
VARIABLE = {"time", "left", "readAt", "changedAt", "mapVersion"}
#: Lists that grow meanwhile: what came later is left out.
GROWING = ("changes", "edits", "missions")


def without_variable(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: without_variable(member) for name, member in value.items() if name not in VARIABLE}
    return [without_variable(each) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize("name", SAME_CALLS)
def test_python_gets_the_same(output: Script, objects: SimpleNamespace, name: str) -> None:
    answer, same = output.answers[name], plain(SAME_CALLS[name](objects))
    if name in GROWING:
        assert answer
        same = same[: len(answer)]
    if name != "path":  # its times are the same as well
        answer, same = without_variable(answer), without_variable(same)
    assert answer == same


def test_every_server_says_its_release(output: Script) -> None:
    releases = {name: answer for name, answer in output.answers.items() if name.endswith("release")}
    assert len(releases) == 9 and set(releases.values()) == {__version__}


def test_what_the_script_has_edited_was_as_it_drew_it(output: Script) -> None:
    wall = {"name": "Küche", "fromPoint": {"x": 2.0, "y": 1.0}, "toPoint": {"x": 4.0, "y": 1.0}, "height": 2.5}
    edge = {
        **{"name": "e1", "fromNode": "n1", "toNode": "n2", "directed": True},
        **{"speedLimit": 0.25, "clearance": 0.0, "graphs": ["g", "h"]},
    }
    record, drawn = output.answers["record"], output.answers["edge"]
    assert (record["onFloor"], record["value"]) == ("L1", ["WALL_ELEMENT", wall])
    assert (drawn["onFloor"], drawn["value"]) == ("L1", ["EDGE_ELEMENT", edge])
    (problem,) = output.answers["problems"]
    assert problem["id"] == {"kind": "EDGE_ELEMENT", "onFloor": "L1", "name": "e1"}
    assert [edit["author"] for edit in output.answers["edits_of_Ada"]] == ["Ada", "Ada", "Ada"]
    (proposal,) = output.answers["proposals"]
    assert (proposal["seenBy"], proposal["certainty"], len(proposal["outline"])) == (["camera", "厨房"], 0.75, 3)
    picture = output.answers["picture"]
    assert bytes.fromhex(picture["picture"]).startswith(b"\x89PNG") and picture["origin"] == {"x": 1.0, "y": 2.0}
    assert read_json(output.answers["program"])["name"] == "Küche"
    assert output.answers["url"] == "corbaname::127.0.0.1:2809#RoboCorba/PathPlanner"


def test_python_receives_what_tcl_pushes(output: Script) -> None:
    """Combat sends types without names and, of enumerations, without repository ids."""
    point = RoboCorba.PathPoint(RoboCorba.ELEVATOR_ENTRY, "n", RoboCorba.Point("L1", 0.5, -0.25), 1.0, 2.0, 3.0, "")
    wall = RoboCorba.Element(aWall=RoboCorba.Wall("w", RoboCorba.XY(0.5, 1.0), RoboCorba.XY(2.0, 4.0), 2.5))
    sent = ["Küche", -7, plain(point), plain(wall)]
    assert [each for each in output.pushed if each in sent][:4] == sent


# ---- the example ----


def test_the_example_prints_a_path(system: Running, repository: Path) -> None:
    def get_path(uri: str, *where: str) -> tuple[int, str, str]:
        """Exit code, stdout and stderr of the example."""
        command = ("tclsh", str(ROOT / "clients" / "tcl" / "get_path.tcl"), str(repository), uri, *where)
        ran = subprocess.run(command, capture_output=True, text=True, timeout=120)
        return ran.returncode, ran.stdout, ran.stderr

    uri, west = corbaname(system.naming, "RoboCorba/PathPlanner"), ("L1", "3", "3")
    code, out, err = get_path(uri, *west, "L1", "15", "3")
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == "0.0 s  L1:3.0,3.0  "
    assert out.splitlines()[-1].split()[2] == "L1:15.0,3.0"
    assert get_path(uri, *west, "L1", "10", "2") == (1, "", "goal is too near to wall w\n")
    code, out, err = get_path("corbaname::127.0.0.1:1#RoboCorba/PathPlanner", *west, "L1", "3", "4")
    assert (code, out) == (1, "") and err.startswith("the call failed: IDL:omg.org/CORBA/COMM_FAILURE:1.0")
    assert get_path(uri)[0] == 2

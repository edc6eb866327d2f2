"""Options and outputs of commands: those without effect are refused, an input is never replaced; what they load."""

from __future__ import annotations

import inspect
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command
from typer.testing import CliRunner, Result

from robocorba.commands import SUBCOMMANDS, command
from robocorba.errors.files import OutputError
from robocorba.map_editor import native
from robocorba.system.output_files import check_output, write_outputs
from testkit.buildings import two_floors
from tests.simulation.places import recorded_drive

#: A command, the option that is refused, and what it is for.
WITHOUT_EFFECT = [
    ("map import two.yaml new.yaml --radius 0.3", "--radius", "--topology"),
    ("map import two.yaml new.yaml --unknown free", "--unknown", "ROS maps"),
    ("map import two.yaml new.yaml --specks all", "--specks", "ROS maps"),
    ("map export two.yaml new.yaml -f native --resolution 0.1", "--resolution", "--format ros"),
    ("map export two.yaml new.yaml -f openrmf --image png", "--image", "--format ros"),
    ("watch --seconds 5", "--seconds", "--video"),
    ("watch --once --fps 5", "--fps", "--video"),
    ("watch --json --width 500", "--width", "--video"),
    ("watch --video new.mp4 --once", "--once", "tables"),
    ("watch --video new.mp4 --json", "--json", "tables"),
    ("replay old.mcap --at 5 --video new.mp4", "--at", "tables and --png"),
    ("replay old.mcap --at 5 --speed 2", "--speed", "--video and tables without --at"),
    ("replay old.mcap --png new.png --speed 2", "--speed", "--video and tables without --at"),
    ("replay old.mcap --png new.png --fps 5", "--fps", "--video"),
    ("replay old.mcap --width 500", "--width", "--png and --video"),
    ("convert old.mcap new.mcap --robots A", "--robots", "--ros2"),
    ("convert old.mcap new.mcap --namespaced-tf", "--namespaced-tf", "--ros2"),
    ("mission status --leader A --json", "--json", "a mission by its name"),
    ("up --console-port 9000", "--console-port", "--console"),
    ("up --hang-limit 0 --spare-stopped", "--spare-stopped", "a --hang-limit above 0"),
    ("robots fleet.yaml --prefix Q", "--prefix", "robots of --count, a file has its own"),
    ("robots fleet.yaml --floor L1", "--floor", "robots of --count, a file has its own"),
    ("foxglove --state here", "--state", "--steer"),
]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    native.save(two_floors(), "two.yaml")


def run(*words: str) -> Result:
    """Call a command; nothing is made of the others."""
    return CliRunner().invoke(command(words[:1]), words, env={"COLUMNS": "200", "NO_COLOR": "1"})


def test_help_is_the_same_where_no_subcommand_is_loaded() -> None:
    shown, loaded = (CliRunner().invoke(command(only_for_help=each), ["--help"]) for each in (True, False))
    assert (shown.output, shown.exit_code) == (loaded.output, 0)


def leaves(name: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The words and the object of each command below a subcommand."""
    waiting: list[tuple[tuple[str, ...], Any]] = [((name,), get_command(command([name])).commands[name])]
    for words, each in waiting:
        inner = getattr(each, "commands", {})
        waiting += [((*words, word), one) for word, one in inner.items()]
        if not inner:
            yield words, each


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_each_command_shows_its_whole_help_within_80_columns_and_facts_as_json_too(name: str) -> None:
    for words, found in leaves(name):
        shown = CliRunner().invoke(command([name]), [*words, "-h"], env={"COLUMNS": "80", "NO_COLOR": "1"})
        assert shown.exit_code == 0 and max(map(len, shown.output.splitlines())) <= 80, words
        helps = " ".join([found.help, *(option.help or "" for option in found.params)])
        assert set(re.findall(r"[\[\]\w]+", helps)) <= set(re.findall(r"[\[\]\w]+", shown.output))
        assert "<bool>" not in shown.output
        prints_facts = re.search(r"(?<!def )(?<![.\w])(show|print_json)\(", inspect.getsource(found.callback))
        has_json = any("--json" in option.opts for option in found.params)
        assert has_json or not prints_facts or words == ("up",), words


def test_words_are_completed_and_quietly_not_where_nothing_runs(tmp_path: Path) -> None:
    environment = os.environ | {"ROBOCORBA_STATE": str(tmp_path), "ROBOCORBA_NAMING": "127.0.0.1:1"}
    for typed, found in (("sim", "simulation"), ("map show five", "five-floors"), ("watch --floor L", "")):
        environment |= {"_ROBOCORBA_COMPLETE": "complete_bash", "COMP_WORDS": f"robocorba {typed}"}
        environment["COMP_CWORD"] = str(len(typed.split()))
        call = (sys.executable, "-m", "robocorba")
        ran = subprocess.run(call, capture_output=True, text=True, timeout=60, env=environment)
        assert (ran.stdout.strip(), ran.returncode, ran.stderr) == (found, 0, "")


@pytest.mark.parametrize("module", ["robocorba", "robocorba.clients.robot", "robocorba.clients.console"])
def test_ctrl_c_while_modules_are_loaded_ends_a_command_quietly(module: str) -> None:
    call = (sys.executable, "-X", "importtime", "-m", module, "watch")
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr and any(line.endswith(" robocorba.system\n") for line in process.stderr)
        process.send_signal(signal.SIGINT)
        assert "Traceback" not in process.stderr.read()
    assert process.returncode == -signal.SIGINT


def test_files_to_start_from_are_valid() -> None:
    for words in (("map", "new", "lab.yaml"), ("program", "new", "lab.json")):
        assert run(*words).exit_code == 0
    assert run("map", "check", "lab.yaml").output.startswith("lab.yaml is valid: 1 floors, 5 walls, 2 nodes, 1 edges")
    checked = json.loads(run("program", "check", "lab.json", "--building", "five-floors", "--json").output)
    assert (native.load("lab.yaml").name, checked["is_valid"], checked["findings"]) == ("lab", True, [])


def test_containers_call_commands_with_options_that_exist() -> None:
    """No container runs here."""
    text, image = (Path(__file__).parents[2].joinpath(name).read_text() for name in ("compose.yaml", "Dockerfile"))
    services = yaml.safe_load(text)["services"]
    calls = [*(each["command"] for each in services.values()), services["system"]["healthcheck"]["test"][2:]]
    calls += list(map(json.loads, re.findall(r"(?:RUN|CMD) (\[.*\])", image)))
    calls += [line.split() for line in re.findall("exec system robocorba (.*)", text)]
    assert len(calls) == 7 and "USER robocorba" in image
    for words in ([word for word in call if word != "robocorba"] for call in calls):
        found = {" ".join(path): each for path, each in leaves(words[0])}
        path = next(path for path in found if " ".join(words).startswith(path))
        found[path].make_context(path, words[len(path.split()) :])


#: A command, its exit code, and what names a value beyond its limits.
BEYOND_LIMITS = [
    ("map show two.yaml --width 100", 2, "'--width'"),
    ("simulation limit 5000000000", 2, "robots"),
    ("simulation step 20000", 2, "steps"),
    ("path L1:1,1 L1:2,2 --alternatives -1", 2, "'--alternatives'"),
    ("watch --video new.mp4 --width 5000000000", 2, "'--width'"),
    ("mission start move-table --table box --to L1:nan,1", 1, "'L1:nan,1' is not of the form FLOOR:X,Y"),
    ("mission start move-table --table box --to L1:1,1,inf", 1, "'L1:1,1,inf' is not of the form FLOOR:X,Y"),
]
_NO_EFFECT = "Invalid value for '{}': it has no effect, it is for {}"


@pytest.mark.parametrize(
    ("typed", "code", "reason"),
    [*((typed, 2, _NO_EFFECT.format(*of)) for typed, *of in WITHOUT_EFFECT), *BEYOND_LIMITS],
)
def test_what_has_no_effect_or_is_beyond_its_limits_is_refused(typed: str, code: int, reason: str) -> None:
    """Before anything is called."""
    result = run(*typed.split())
    assert (result.exit_code, reason.lower() in result.output.lower()) == (code, True), result.output
    assert {path.name for path in Path().iterdir()} == {"two.yaml"}


def test_commands_refuse_their_own_input() -> None:
    Path("in.png").symlink_to("two.yaml")
    recorded_drive(Path(), "2-B", (0.4, 0.1, 0.2), {})
    Path("in.mp4").symlink_to("a.mcap")
    before = {file: file.read_bytes() for file in Path().iterdir()}
    for typed in (
        "map import two.yaml two.yaml --force",
        "map export two.yaml two.yaml -f native --force",
        "map export two.yaml two.yaml -f openrmf --force",
        "map show two.yaml --picture in.png",
        "convert a.mcap a.mcap --force",
        "convert a.mcap . --ros2 --force",
        "replay a.mcap --png a.mcap",
        "replay a.mcap --video in.mp4",
    ):
        result = run(*typed.split())
        assert (result.exit_code, "input itself" in result.output.splitlines()[-1]) == (1, True), typed
    assert {file: file.read_bytes() for file in Path().iterdir()} == before


def test_what_an_output_may_replace() -> None:
    Path("folder").mkdir()
    for name in ("folder", "nowhere/map.yaml"):
        with pytest.raises(OutputError, match=name):
            write_outputs({Path(name): b"1"})
    result = run("map", "show", "two.yaml", "--picture", "two.yaml")
    assert (result.exit_code, "a picture's name ends with" in result.output) == (1, True)
    assert native.load("two.yaml") == two_floors()
    assert sorted(Path().iterdir()) == [Path("folder"), Path("two.yaml")]
    file = Path("map.yaml")
    write_outputs({file: b"1"}, replace=False)
    write_outputs({file: b"1"}, replace=False)  # the same content
    with pytest.raises(OutputError, match=r"map\.yaml: exists already; .* --force"):
        write_outputs({Path("new.yaml"): b"3", file: b"2"}, replace=False)
    assert file.read_bytes() == b"1"
    assert not Path("new.yaml").exists()  # all or none
    write_outputs({file: b"2"})
    assert file.read_bytes() == b"2"
    Path("map.yaml").write_bytes(b"1")
    Path("symbolic.yaml").symlink_to("map.yaml")
    os.link("map.yaml", "hard.yaml")
    for name in ("map.yaml", "./map.yaml", "symbolic.yaml", "hard.yaml", "folder/../map.yaml"):
        with pytest.raises(OutputError, match="the input itself"):
            write_outputs({Path(name): b"2"}, ["map.yaml"])
    assert Path("map.yaml").read_bytes() == b"1"
    with pytest.raises(OutputError, match="the input itself"):
        check_output("bag", [Path("bag") / "recording.mcap"])
    Path("target").write_bytes(b"1")
    Path("target").chmod(0o640)
    Path("link").symlink_to("target")
    write_outputs({Path("link"): b"2"})
    assert Path("link").is_symlink()
    assert (Path("target").read_bytes(), Path("target").stat().st_mode & 0o777) == (b"2", 0o640)
    os.mkfifo("pipe")
    with subprocess.Popen(["cat", "pipe"], stdout=subprocess.PIPE) as reader:
        write_outputs({Path("pipe"): b"3"}, replace=False)
        assert reader.communicate(timeout=60)[0] == b"3"
    assert Path("pipe").is_fifo()


def test_a_folder_with_more_than_a_bag_is_kept() -> None:
    bag = Path("bag")
    bag.mkdir()
    for name in ("metadata.yaml", "bag.mcap", "notes.txt"):
        (bag / name).write_text("mine")
    recorded_drive(Path(), "2-B", (0.4, 0.1, 0.2), {})
    assert run("convert", "a.mcap", "bag", "--ros2", "--force").exit_code == 1
    assert len(list(bag.iterdir())) == 3
    (bag / "notes.txt").unlink()
    assert run("convert", "a.mcap", "bag", "--ros2").exit_code == 1
    assert run("convert", "a.mcap", "bag", "--ros2", "--force").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (("map", "import", "five-floors", "out.yaml"), "out.yaml"),
        (("map", "export", "paper-scene", "out.yaml", "-f", "openrmf"), "out.yaml"),
        (("map", "export", "five-floors", "out.yaml", "-f", "nav2"), "out-L3.geojson"),
        (("map", "export", "paper-scene", "out.yaml", "-f", "native"), "out.yaml"),
        (("robot-model", "urdf", "out.urdf"), "out.urdf"),
        (("map", "new", "out.yaml"), "out.yaml"),
        (("program", "new", "out.json"), "out.json"),
        (("samples", "copy", "fleet.yaml"), "fleet.yaml"),
    ],
)
def test_an_edited_file_is_kept_without_force(arguments: tuple[str, ...], output: str) -> None:
    Path("two.yaml").unlink()
    Path(output).write_text("mine")
    result = run(*arguments)
    assert result.exit_code == 1
    assert f"{output}: exists already" in result.output
    assert {file.read_text() for file in Path().iterdir()} == {"mine"}
    assert run(*arguments, "--force").exit_code == 0
    assert Path(output).read_text() != "mine"
    assert run(*arguments).exit_code == 0  # the same content again


#: Modules of all commands, and what `stop` loads when it is called.
LIGHT = (*sorted({f"commands.{module}" for module, *_ in SUBCOMMANDS.values()}), "robot.corba.emergency_stop")
#: What takes long to load: half of the time until a robot is ordered to stop.
HEAVY = ("numba", "mujoco", "pymunk", "matplotlib")


def test_commands_load_nothing_heavy() -> None:
    looks = "".join(
        f"import robocorba.{module}\nprint({module!r}, *[name for name in {HEAVY} if name in sys.modules])\n"
        for module in LIGHT
    )
    script = (
        f"import os, sys\n{looks}"
        + """
from robocorba.robot.kinematics.inverse import InverseKinematics
InverseKinematics()
print([name for name in ("scipy.linalg", "glfw", "OpenGL") if name in sys.modules], "MUJOCO_GL" in os.environ)
import numba, numpy
print(numba.njit(lambda a: numpy.dot(a, a))(numpy.eye(2)).tolist())
"""
    )
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    ran = subprocess.run((sys.executable, "-c", script), capture_output=True, text=True, timeout=120, env=environment)
    assert ran.stdout.splitlines() == [*LIGHT, "[] False", "[[1.0, 0.0], [0.0, 1.0]]"], ran.stderr

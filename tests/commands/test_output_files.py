"""Outputs of commands: what may be replaced, and that an input never is."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.errors.files import OutputError, OutputExists, OutputIsInput
from robocorba.maps import native
from robocorba.output_files import check_output, write_outputs
from robocorba.testing.buildings import two_floors
from tests.simulation.places import recorded_drive


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_file_with_another_content_is_replaced_only_on_request() -> None:
    file = Path("map.yaml")
    write_outputs({file: b"1"}, replace=False)
    write_outputs({file: b"1"}, replace=False)  # the same content
    with pytest.raises(OutputExists, match=r"map\.yaml: exists already; .* --force"):
        write_outputs({Path("new.yaml"): b"3", file: b"2"}, replace=False)
    assert file.read_bytes() == b"1"
    assert not Path("new.yaml").exists()  # all or none
    write_outputs({file: b"2"})
    assert file.read_bytes() == b"2"


@pytest.mark.parametrize("name", ["map.yaml", "./map.yaml", "symbolic.yaml", "hard.yaml", "folder/../map.yaml"])
def test_an_input_is_never_written_whatever_its_name(name: str) -> None:
    Path("folder").mkdir()
    Path("map.yaml").write_bytes(b"1")
    Path("symbolic.yaml").symlink_to("map.yaml")
    os.link("map.yaml", "hard.yaml")
    with pytest.raises(OutputIsInput, match="the input itself"):
        write_outputs({Path(name): b"2"}, ["map.yaml"])
    assert Path("map.yaml").read_bytes() == b"1"


def test_a_folder_that_holds_an_input_is_no_output() -> None:
    with pytest.raises(OutputIsInput):
        check_output("bag", [Path("bag") / "recording.mcap"])


def test_modes_links_and_devices_stay_what_they_are() -> None:
    Path("target").write_bytes(b"1")
    Path("target").chmod(0o640)
    Path("link").symlink_to("target")
    write_outputs({Path("link"): b"2"})
    assert Path("link").is_symlink()
    assert (Path("target").read_bytes(), Path("target").stat().st_mode & 0o777) == (b"2", 0o640)
    os.mkfifo("pipe")
    with subprocess.Popen(["cat", "pipe"], stdout=subprocess.PIPE) as reader:
        write_outputs({Path("pipe"): b"3"}, replace=False)
        assert reader.communicate(timeout=20)[0] == b"3"
    assert Path("pipe").is_fifo()


def test_what_cannot_be_written_is_named() -> None:
    Path("folder").mkdir()
    for name in ("folder", "nowhere/map.yaml"):
        with pytest.raises(OutputError, match=name):
            write_outputs({Path(name): b"1"})
    assert sorted(Path().iterdir()) == [Path("folder")]


@pytest.mark.parametrize(
    "arguments",
    [
        ("map", "import", "in.yaml", "in.yaml", "--force"),
        ("map", "export", "in.yaml", "in.yaml", "-f", "native", "--force"),
        ("map", "export", "in.yaml", "in.yaml", "-f", "openrmf", "--force"),
        ("map", "show", "in.yaml", "--picture", "in.png"),
        ("convert", "in.mcap", "in.mcap", "--force"),
        ("convert", "in.mcap", ".", "--ros2", "--force"),
        ("replay", "in.mcap", "--png", "in.mcap"),
        ("replay", "in.mcap", "--video", "in.mp4"),
    ],
)
def test_commands_refuse_their_own_input(arguments: tuple[str, ...]) -> None:
    native.save(two_floors(), "in.yaml")
    Path("in.png").symlink_to("in.yaml")
    recorded_drive(Path(), "2-B", (0.4, 0.1, 0.2), {})
    Path("a.mcap").rename("in.mcap")
    Path("in.mp4").symlink_to("in.mcap")
    before = {file: file.read_bytes() for file in Path().iterdir()}
    result = CliRunner().invoke(command(), list(arguments))
    assert result.exit_code == 1
    assert "input itself" in result.output.splitlines()[-1]
    assert {file: file.read_bytes() for file in Path().iterdir()} == before


def test_a_picture_has_a_name_of_one() -> None:
    native.save(two_floors(), "in.yaml")
    result = CliRunner().invoke(command(), ["map", "show", "in.yaml", "--picture", "in.yaml"])
    assert (result.exit_code, "a picture's name ends with" in result.output) == (1, True)
    assert native.load("in.yaml") == two_floors()


def test_a_folder_with_more_than_a_bag_is_kept() -> None:
    bag = Path("bag")
    bag.mkdir()
    for name in ("metadata.yaml", "bag.mcap", "notes.txt"):
        (bag / name).write_text("mine")
    recorded_drive(Path(), "2-B", (0.4, 0.1, 0.2), {})
    assert CliRunner().invoke(command(), ["convert", "a.mcap", "bag", "--ros2", "--force"]).exit_code == 1
    assert len(list(bag.iterdir())) == 3
    (bag / "notes.txt").unlink()
    assert CliRunner().invoke(command(), ["convert", "a.mcap", "bag", "--ros2"]).exit_code == 1
    assert CliRunner().invoke(command(), ["convert", "a.mcap", "bag", "--ros2", "--force"]).exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (("map", "import", "five-floors", "out.yaml"), "out.yaml"),
        (("map", "export", "paper-scene", "out.yaml", "-f", "openrmf"), "out.yaml"),
        (("map", "export", "five-floors", "out.yaml", "-f", "nav2"), "out-L3.geojson"),
        (("map", "export", "paper-scene", "out.yaml", "-f", "native"), "out.yaml"),
        (("robot-model", "urdf", "out.urdf"), "out.urdf"),
    ],
)
def test_an_edited_file_is_kept_without_force(arguments: tuple[str, ...], output: str) -> None:
    Path(output).write_text("mine")
    result = CliRunner().invoke(command(), list(arguments))
    assert result.exit_code == 1
    assert f"{output}: exists already" in result.output
    assert {file.read_text() for file in Path().iterdir()} == {"mine"}
    assert CliRunner().invoke(command(), [*arguments, "--force"]).exit_code == 0
    assert Path(output).read_text() != "mine"
    assert CliRunner().invoke(command(), list(arguments)).exit_code == 0  # the same content again

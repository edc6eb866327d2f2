"""robocorba.toml: what it may say, and what is stronger."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robocorba.commands import command
from robocorba.errors.services import NotReachable
from robocorba.map_editor import native
from robocorba.system.instances import instance_folder
from robocorba.system.settings import Settings, state_folder
from testkit.buildings import two_floors


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current one; the user's folder for configuration is beside it."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for variable in ("NAMING", "STATE", "INSTANCE"):
        monkeypatch.delenv(f"ROBOCORBA_{variable}", raising=False)
    return tmp_path / "here"


def run(*words: str) -> Result:
    return CliRunner().invoke(command(words[:1]), words)


def test_options_of_a_command_are_its_defaults(folder: Path) -> None:
    native.save(two_floors(), "two.yaml")
    (folder.parent / "robocorba").mkdir()
    (folder.parent / "robocorba" / "robocorba.toml").write_text("[map.check]\njson = true\n")
    assert json.loads(run("map", "check", "two.yaml").output)
    Path("robocorba.toml").write_text("[up]\nconsole-port = 0\n[events.tail]\njson = true\n")  # is read instead
    assert not run("map", "check", "two.yaml").output.startswith(("{", "["))
    listed = CliRunner().invoke(command(only_for_help=True), ["--help"])
    assert (listed.exit_code, "events" in listed.output) == (0, True)


def test_it_chooses_a_system_where_neither_options_nor_variables_do(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("robocorba.toml").write_text('instance = "anna"')
    assert state_folder() == instance_folder("anna")
    with pytest.raises(NotReachable, match="anna"):
        Settings.read()
    assert "a free port" in run("doctor").output  # whose number nobody knows yet
    assert state_folder(Path("other")) == folder / "other"
    Path("robocorba.toml").write_text('naming = "host:2810"\nstate = "state"')
    found = Settings.read()
    assert (str(found.naming), found.state, found.origin) == (
        "host:2810",
        folder / "state",
        str(folder / "robocorba.toml"),
    )
    assert str(Settings.read("host:2811").naming) == "host:2811"
    assert str(Settings.read(state=Path("other")).naming) == "127.0.0.1:2809"
    monkeypatch.setenv("ROBOCORBA_INSTANCE", "bert")
    assert state_folder() == instance_folder("bert")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("instance = 3", "instance is no text"),
        ('instance = "a b"', "not 1 to 60 letters, digits or _ -"),
        ("naming = [", "Invalid value"),
        ('namign = "host:1"', "'namign' is no table with options of a command"),
        ("[upp]", "`robocorba` has no command 'upp'"),
        ("[doctor]\nverbose = true", "`robocorba doctor` has no option 'verbose'"),
        ("[doctor.x]", "`robocorba doctor` has no option 'x'"),
    ],
)
def test_what_it_cannot_say_is_named_with_the_file(folder: Path, text: str, problem: str) -> None:
    (folder / "robocorba.toml").write_text(text)
    found = run("doctor")
    assert found.exit_code == 1
    assert str(folder / "robocorba.toml") in found.stderr
    assert problem in found.stderr

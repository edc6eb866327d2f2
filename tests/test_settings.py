"""What the environment and the command line may say."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.settings import Address, ChannelSettings, InvalidSetting, ServerSettings, Settings


@pytest.mark.parametrize("text", ["127.0.0.1:2809", "robot-1.example.org:1", "[::1]:65535", "localhost:80"])
def test_addresses_read_as_they_are_written(text: str) -> None:
    assert str(Address.parse(text)) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "host",
        ":2809",
        "host:",
        "host:0",
        "host:65536",
        "host:-1",
        "::1:2809",
        "a b:1",
        "0.0.0.0:1",
        "[::]:1",
        "h:²",
    ],
)
def test_nonsense_is_refused_by_name(text: str) -> None:
    with pytest.raises(InvalidSetting) as refused:
        Settings.read(environment={"ROBOCORBA_NAMING": text or " "})
    assert refused.value.setting == "ROBOCORBA_NAMING"


@given(st.text())
@settings(deadline=None)
def test_any_text_is_an_address_or_refused(text: str) -> None:
    try:
        address = Address.parse(text)
    except InvalidSetting as refused:
        assert len(str(refused)) < 1000
    else:
        assert Address.parse(str(address)) == address


def test_arguments_win_over_the_environment_and_it_over_defaults(tmp_path: Path) -> None:
    environment = {"ROBOCORBA_NAMING": "a:1", "ROBOCORBA_STATE": str(tmp_path)}
    assert Settings.read(environment=environment) == Settings(Address("a", 1), tmp_path)
    other = tmp_path / "other"
    assert Settings.read("b:2", other, environment) == Settings(Address("b", 2), other)
    assert Settings.read(environment={}).naming == Address("127.0.0.1", 2809)
    assert Settings.read(environment={}).state.name == "robocorba"


def test_a_state_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InvalidSetting, match="--state"):
        Settings.read(state=tmp_path / "file")


def test_a_server_reads_its_arguments(tmp_path: Path) -> None:
    arguments = ["--state", str(tmp_path), "--endpoint", "a:1", "--naming", "b:2", "--building", "map.yaml"]
    assert ServerSettings.read(arguments) == ServerSettings(
        tmp_path, Address("a", 1), Address("b", 2), Path.cwd() / "map.yaml"
    )
    with pytest.raises(SystemExit):
        ServerSettings.read(["--state", str(tmp_path)])


def test_a_channel_reads_its_arguments(tmp_path: Path) -> None:
    common = ["--state", str(tmp_path), "--endpoint", "a:1", "--naming", "b:2"]
    own = ["--name", "lab", "--peer", "hall", "--peer", "yard=c:3", "--foreign", "old=corbaloc::d:4/old=1"]
    assert ChannelSettings.read([*common, *own]) == ChannelSettings(
        ServerSettings(tmp_path, Address("a", 1), Address("b", 2), None),
        "lab",
        (("hall", ""), ("yard", "c:3")),
        (("old", "corbaloc::d:4/old=1"),),
    )
    alone = ChannelSettings.read([*common, "--name", "lab"])
    assert (alone.peers, alone.foreign) == ((), ())


@pytest.mark.parametrize("missing", ["--name", "--endpoint"])
def test_a_channel_needs_a_name_and_an_endpoint(missing: str) -> None:
    arguments = {"--name": "lab", "--endpoint": "a:1"}
    del arguments[missing]
    with pytest.raises(SystemExit):
        ChannelSettings.read([word for pair in arguments.items() for word in pair])


@pytest.mark.parametrize("foreign", ["old", "old="])
def test_a_foreign_channel_needs_a_uri(foreign: str) -> None:
    with pytest.raises(InvalidSetting) as refused:
        ChannelSettings.read(["--endpoint", "a:1", "--name", "lab", "--foreign", foreign])
    assert refused.value.setting == "--foreign"

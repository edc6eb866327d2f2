"""Texts from outside: settings, content that is decoded, names for ROS, and what is printed of them."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import itertools
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from robocorba.errors.files import LimitExceeded
from robocorba.errors.services import NotReachable
from robocorba.system.decoding import convert, decode_json, decode_msgpack, read_text
from robocorba.system.instances import port_to_start
from robocorba.system.plain_names import PlainNames, names_in, plain_name
from robocorba.system.printing import Console, echo, line
from robocorba.system.settings import (
    Address,
    ChannelSettings,
    InvalidSetting,
    RobotSettings,
    RoleNaming,
    ServerSettings,
    Settings,
    choose_instance,
)

ADDRESSES = ("127.0.0.1:2809", "robot-1.example.org:1", "[::1]:65535", "localhost:80")


@given(st.text() | st.sampled_from(ADDRESSES))
def test_any_text_is_an_address_or_refused(text: str) -> None:
    try:
        address = Address.parse(text)
    except InvalidSetting as refused:
        assert len(str(refused)) < 1000
    else:
        assert Address.parse(str(address)) == address


def test_addresses_read_as_they_are_written_and_nonsense_is_refused_by_name() -> None:
    for text in ADDRESSES:
        assert str(Address.parse(text)) == text
    for text in (
        *(" ", "host", ":2809", "host:", "host:0", "host:65536", "host:-1", "::1:2809"),
        *("a b:1", "0.0.0.0:1", "[::]:1", "h:²"),
    ):
        with pytest.raises(InvalidSetting) as refused:
            Settings.read(environment={"ROBOCORBA_NAMING": text})
        assert refused.value.setting == "ROBOCORBA_NAMING"


def test_arguments_win_over_the_environment_and_it_over_defaults(tmp_path: Path) -> None:
    environment = {"ROBOCORBA_NAMING": "a:1", "ROBOCORBA_STATE": str(tmp_path)}
    assert Settings.read(environment=environment) == Settings(Address("a", 1), tmp_path)
    other = tmp_path / "other"
    assert Settings.read("b:2", other, environment) == Settings(Address("b", 2), other)
    assert Settings.read(environment={}).naming == Address("127.0.0.1", 2809)
    assert Settings.read(environment={}).state.name == "robocorba"
    of_system, record = {"ROBOCORBA_STATE": str(tmp_path)}, tmp_path / "up.json"
    texts = ('{"naming": "c:3"}', "c:3", "the state folder"), ("[", "127.0.0.1:2809", "the default")
    for text, address, origin in texts:
        record.write_text(text)
        found = Settings.read(environment=of_system)
        assert str(found.naming) == address and found.origin.startswith(origin)
    other.touch()
    with pytest.raises(InvalidSetting, match="--state"):
        Settings.read(state=other)


def test_an_instance_wins_over_variables_and_yields_to_options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other, folder = tmp_path / "other", tmp_path / "robocorba-anna"
    given = {"NAMING": "a:1", "STATE": str(other), "INSTANCE": "eve"}
    for variable, value in given.items():
        monkeypatch.setenv(f"ROBOCORBA_{variable}", value)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert Settings.read() == Settings(Address("a", 1), other)
    folder.mkdir()
    (folder / "up.json").write_text('{"naming": "c:3"}')
    anna = RobotSettings.read(["A", "--instance", "anna"]).common
    assert anna == Settings.read() == Settings(Address("c", 3), folder)
    assert Settings.read("b:2") == Settings(Address("b", 2), folder)
    assert Settings.read(state=other) == Settings(Address("127.0.0.1", 2809), other)
    (folder / "up.json").unlink()
    with pytest.raises(NotReachable, match="'anna' does not run"):
        Settings.read()
    assert Settings.read(choose_port=port_to_start).naming.port > 2809
    (folder / "ports.json").write_text('{"naming": 12345}')
    assert Settings.read(choose_port=port_to_start).naming.port == 12345
    for wrong in ("", "a/b", "ä", "x" * 61):
        with pytest.raises(InvalidSetting, match="--instance"):
            choose_instance(wrong)


def test_servers_and_channels_read_their_arguments(tmp_path: Path) -> None:
    common = ["--state", str(tmp_path), "--endpoint", "a:1", "--naming", "b:2"]
    server = ServerSettings(tmp_path, Address("a", 1), Address("b", 2), None)
    assert ServerSettings.read([*common, "--building", "map.yaml"]) == dataclasses.replace(
        server, building=Path.cwd() / "map.yaml"
    )
    own = ["--name", "lab", "--peer", "hall", "--peer", "yard=c:3", "--foreign", "old=corbaloc::d:4/old=1"]
    peers, foreign = (("hall", ""), ("yard", "c:3")), (("old", "corbaloc::d:4/old=1"),)
    assert ChannelSettings.read([*common, *own]) == ChannelSettings(server, "lab", peers, foreign)
    alone = ChannelSettings.read([*common, "--name", "lab"])
    assert (alone.peers, alone.foreign) == ((), ())
    for reader, lacking in (
        (ServerSettings, ["--state", str(tmp_path)]),
        (ChannelSettings, ["--endpoint", "a:1"]),
        (ChannelSettings, ["--name", "lab"]),
    ):
        with pytest.raises(SystemExit):
            reader.read(lacking)
    for without_uri in ("old", "old="):
        with pytest.raises(InvalidSetting) as refused:
            ChannelSettings.read([*common, "--name", "lab", "--foreign", without_uri])
        assert refused.value.setting == "--foreign"


#: Threads that decode types of many nested ones for the first time, all at once. With msgspec's own functions, this
#: process crashed in each of five runs.
_THREADS = """
import sys, threading
import msgspec
from robocorba.system.decoding import convert, decode_json, decode_msgpack, read_text
from robocorba.errors.files import LimitExceeded
from robocorba.errors.services import NotReachable
from robocorba.system.settings import RoleNaming

sys.setswitchinterval(1e-6)
TYPES, PARTS = 10, 20
content = {f"part_{number}": {"one": 1} for number in range(PARTS)}
as_json, as_msgpack = msgspec.json.encode(content), msgspec.msgpack.encode(content)

def decode(barrier, kind):
    barrier.wait(60.0)
    found.append(decode_json(as_json, kind))
    found.append(decode_msgpack(as_msgpack, kind))
    found.append(convert(content, kind))

for number in range(TYPES):
    parts = [msgspec.defstruct(f"Part{index}", [("one", int), ("many", list[str], [])]) for index in range(PARTS)]
    kind = msgspec.defstruct("Whole", [(f"part_{index}", part) for index, part in enumerate(parts)])
    found = []
    barrier = threading.Barrier(8)
    threads = [threading.Thread(target=decode, args=(barrier, kind)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert len(found) == 24 and all(one == found[0] for one in found)
"""


def test_threads_decode_a_type_for_the_first_time_at_once() -> None:
    done = subprocess.run([sys.executable, "-c", _THREADS], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr


class Point(msgspec.Struct):
    x: float
    y: float = 0.0


def test_each_form_gives_the_type_and_what_is_wrong_is_named() -> None:
    assert decode_json('{"x": 1}', Point) == Point(1.0)
    assert decode_msgpack(msgspec.msgpack.encode([{"x": 1}]), list[Point]) == [Point(1.0)]
    assert convert({"a": {"x": 1, "y": 2}}, dict[str, Point]) == {"a": Point(1.0, 2.0)}
    for decode, content, kind, place in (
        (decode_json, b'{"x": "1"}', Point, r"\$\.x"),
        (convert, [{"x": None}], list[Point], r"\$\[0\]\.x"),
        (decode_msgpack, b"", Point, "truncated"),
    ):
        with pytest.raises(msgspec.DecodeError, match=place):
            decode(content, kind)


class Anything(msgspec.Struct):
    x: Any = None


def test_what_is_nested_too_deeply_is_invalid() -> None:
    for depth in (10_000, 1_000_000):
        with pytest.raises(msgspec.DecodeError, match="nested too deeply"):
            decode_json(b'{"x": ' + b"[" * depth + b"]" * depth + b"}", Anything)
        with pytest.raises(msgspec.DecodeError, match="nested too deeply"):
            decode_msgpack(b"\x81\xa1x" + b"\x91" * depth + b"\x90", Anything)


@given(data=st.binary(max_size=200))
def test_any_bytes_are_decoded_or_invalid(data: bytes) -> None:
    for decode, begin in itertools.product((decode_json, decode_msgpack), (b"", b"\x81\xa1x")):
        with contextlib.suppress(msgspec.DecodeError, ValueError):
            decode(begin + data, Anything)


def test_a_file_without_an_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LimitExceeded, match=r"/dev/zero has more than 65536 bytes, at most 65536 are read"):
        read_text(Path("/dev/zero"))
    with pytest.raises(LimitExceeded, match="/dev/zero"):
        RoleNaming.read(Path("/dev/zero"))
    (tmp_path / "a").write_text("é")
    assert read_text(tmp_path / "a") == "é"


@given(st.lists(st.text(min_size=1), unique=True))
def test_names_are_allowed_unique_and_stay(names: list[str]) -> None:
    ros = PlainNames()
    found = [ros[name] for name in names]
    assert all(re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) and "__" not in name for name in found)
    assert len(set(found)) == len(names)
    assert [ros[name] for name in names] == found
    names = [plain_name(name) for name in ("A", "robot_7", "2nd floor", "l'été", "a--b")]
    assert names == ["A", "robot_7", "_2nd_floor", "l_t_", "a_b"]
    assert (names_in("A, B,"), names_in("")) == ({"A", "B"}, None)


EVIL = "\x1b[2Jname\x9b1m\x07\u202e\u2066\r"


def test_what_is_printed_begins_no_line(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A text keeps its lines; names in other scripts stay as they are."""
    names, escaped = ["Küche", "厨房", "מטבח", "🤖"], "\\x1b[2Jname\\u009b1m\\x07\\u202e\\u2066\\r"
    line("A\nB\tstands", EVIL, 3)
    line(*names)
    echo(f"a\tb\n{EVIL}", err=True)
    printed = capsys.readouterr()
    assert printed.out == f"A\\nB\\tstands\t{escaped}\t3\n" + "\t".join(names) + "\n"
    assert printed.err == f"a\tb\n{escaped}\n"
    value = {"name": EVIL + "\x7f\x85\u2028"}
    echo(json.dumps(value, ensure_ascii=False))
    printed = capsys.readouterr().out
    assert json.loads(printed) == value
    assert printed[:-1].isprintable()
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", stream)
    line("Küche")
    assert stream.buffer.getvalue() == b"K\\xfcche\n"  # type: ignore[attr-defined]


def test_tables_keep_their_own_styles_only() -> None:
    table = Table("robot")
    table.add_row(EVIL, style="bold")
    out = io.StringIO()
    Console(file=out, force_terminal=True, width=60, color_system="standard", legacy_windows=False).print(table)
    printed = out.getvalue()
    assert "\\x1b[2Jname\\u009b1m" in printed and "\x1b[1m" in printed
    assert not {"\x1b[2J", "\x9b", "\x07", "\u202e"} & {printed[i : i + n] for i in range(len(printed)) for n in (1, 4)}

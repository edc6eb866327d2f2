"""Decoding into types: in one thread, and for the first time in several at once."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.decoding import convert, decode_json, decode_msgpack, read_text
from robocorba.errors.files import LimitExceeded
from robocorba.settings import RoleNaming

#: Threads that decode types of many nested ones for the first time, all at once. With msgspec's own functions, this
#: process crashed in each of five runs.
_THREADS = """
import sys, threading
import msgspec
from robocorba.decoding import convert, decode_json, decode_msgpack, read_text
from robocorba.errors.files import LimitExceeded
from robocorba.settings import RoleNaming

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


def test_each_form_gives_the_type() -> None:
    assert decode_json('{"x": 1}', Point) == Point(1.0)
    assert decode_msgpack(msgspec.msgpack.encode([{"x": 1}]), list[Point]) == [Point(1.0)]
    assert convert({"a": {"x": 1, "y": 2}}, dict[str, Point]) == {"a": Point(1.0, 2.0)}


def test_what_is_wrong_is_named() -> None:
    with pytest.raises(msgspec.ValidationError, match=r"\$\.x"):
        decode_json(b'{"x": "1"}', Point)
    with pytest.raises(msgspec.ValidationError, match=r"\$\[0\]\.x"):
        convert([{"x": None}], list[Point])
    with pytest.raises(msgspec.DecodeError):
        decode_msgpack(b"", Point)


class Anything(msgspec.Struct):
    x: Any = None


@pytest.mark.parametrize("depth", [10_000, 1_000_000])
def test_what_is_nested_too_deeply_is_invalid(depth: int) -> None:
    with pytest.raises(msgspec.DecodeError, match="nested too deeply"):
        decode_json(b'{"x": ' + b"[" * depth + b"]" * depth + b"}", Anything)
    with pytest.raises(msgspec.DecodeError, match="nested too deeply"):
        decode_msgpack(b"\x81\xa1x" + b"\x91" * depth + b"\x90", Anything)


@given(data=st.binary(max_size=200))
def test_any_bytes_are_decoded_or_invalid(data: bytes) -> None:
    for decode in (decode_json, decode_msgpack):
        with contextlib.suppress(msgspec.DecodeError, ValueError):
            decode(data, Anything)
        with contextlib.suppress(msgspec.DecodeError, ValueError):
            decode(b"\x81\xa1x" + data, Anything)


def test_a_file_without_an_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LimitExceeded, match=r"/dev/zero has more than 65536 bytes, at most 65536 are read"):
        read_text(Path("/dev/zero"))
    with pytest.raises(LimitExceeded, match="/dev/zero"):
        RoleNaming.read(Path("/dev/zero"))
    (tmp_path / "a").write_text("é")
    assert read_text(tmp_path / "a") == "é"

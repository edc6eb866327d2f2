"""Recordings of strangers: bombs are refused by what they declare and by what they hold, with file, limit and size."""

from __future__ import annotations

import gzip
import struct
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from robocorba.console.recordings import Recordings
from robocorba.errors.files import WorkEnded
from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor import native
from robocorba.map_editor.model import Building, Floor, FloorMap
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.simulation.recording import (
    MAP_ATTACHMENT,
    MAX_CHUNK_BYTES,
    MAX_DURATION_S,
    MAX_FLOORS,
    MAX_MAP_BYTES,
    PROFILE,
    Recording,
    dumps,
)
from robocorba.system.decoding import Work

SMALL = Building("b", {"L1": FloorMap(Floor(name="L1", level=1, elevation=0.0))})
BEGAN_NS = 1_700_000_000_000_000_000
#: Peak memory of a process that refuses all bombs [MiB]; the imports alone take some 110.
MAX_MEMORY_MIB = 450


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(content: str) -> bytes:
    return struct.pack("<I", len(content.encode())) + content.encode()


def channel(number: int, topic: str) -> bytes:
    return record(Opcode.CHANNEL, struct.pack("<HH", number, 0) + text(topic) + text("msgpack") + struct.pack("<I", 0))


def message(number: int, data: bytes, after_ns: int = 0) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, 0, BEGAN_NS + after_ns, 0) + data)


def chunk(content: bytes, declared: int | None = None, compression: str = "zstd", packed: bytes | None = None) -> bytes:
    """content: its records, with their size unless another one is declared. packed: the compressed data."""
    if packed is None:
        packed = zstandard.ZstdCompressor().compress(content) if compression else content
    head = struct.pack("<QQQI", 0, 0, len(content) if declared is None else declared, 0)
    return record(Opcode.CHUNK, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


def attachment(data: bytes) -> bytes:
    head = struct.pack("<QQ", 0, 0) + text(MAP_ATTACHMENT) + text("application/gzip")
    return record(Opcode.ATTACHMENT, head + struct.pack("<Q", len(data)) + data + struct.pack("<I", 0))


MAP = attachment(gzip.compress(native.dumps(SMALL).encode(), mtime=0))


def mcap(*records: bytes) -> bytes:
    return MCAP0_MAGIC + record(Opcode.HEADER, text(PROFILE) + text("test")) + b"".join(records)


def update(version: int, count: int = 1, since: int | None = None, name: str = "A") -> bytes:
    """The floor L1 with the bodies number*version ... that came."""
    first = version * count
    came = [Body(first + i, BodyKind.ROBOT, name, 0.4, (), 1.0) for i in range(count)]
    before = version - 1 if since is None else since
    return dumps(FloorUpdate("L1", before, version, 0.0, 1, came, [], np.zeros(0, MOTION), {}))


FIRST = channel(1, "floor/L1") + message(1, update(1))


def endless(size: int) -> bytes:
    """A zstd frame of many zeros whose head does not say how many."""
    compressor = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    return b"".join(compressor.compress(bytes(2**20)) for _ in range(size // 2**20)) + compressor.flush()


def filling() -> bytes:
    """Updates that each add 2,000 bodies with long names, in chunks of their own: 6 MB a chunk of a few kB."""
    chunks = (chunk(message(1, update(version, 2_000, name="A" * 3_000))) for version in range(1, 16))
    return b"".join((chunk(channel(1, "floor/L1")), *chunks))


TWO = 2 * 10**9
#: What each bomb holds, by records or how to make them, and what its error says.
BOMBS: dict[str, tuple[Callable[[], tuple[bytes, ...]], str]] = {
    "a chunk that declares its size": (
        lambda: (MAP, chunk(bytes(MAX_CHUNK_BYTES + 1))),
        f"a chunk has {MAX_CHUNK_BYTES + 1} bytes after decompression, at most {MAX_CHUNK_BYTES} are read",
    ),
    "a chunk that declares less than it has": (
        lambda: (MAP, chunk(b"", 100, packed=endless(2**29))),
        "a chunk does not have the 100 bytes that it declares",
    ),
    "a frame that declares more than its chunk": (
        lambda: (MAP, chunk(b"", 100, packed=zstandard.ZstdCompressor().compress(bytes(2**28)))),
        "does not have the 100 bytes|window|memory",
    ),
    "another compression": (lambda: (MAP, chunk(b"x", compression="lz4", packed=b"")), "'lz4', not zstd"),
    "a chunk without compression": (
        lambda: (MAP, chunk(bytes(MAX_CHUNK_BYTES + 1), compression="")),
        f"a chunk has {MAX_CHUNK_BYTES + 1} bytes, at most",
    ),
    "a map": (
        lambda: (attachment(gzip.compress(bytes(3 * MAX_MAP_BYTES), 1)),),
        f"its map has more than {MAX_MAP_BYTES} bytes after decompression",
    ),
    "a record": (
        lambda: (MAP, record(Opcode.CHUNK, bytes(3 * MAX_CHUNK_BYTES))),
        f"a record has {3 * MAX_CHUNK_BYTES} bytes, at most {2 * MAX_CHUNK_BYTES} are read",
    ),
    "floors": (
        lambda: (MAP, chunk(b"".join(channel(1, f"floor/{i}") + message(1, b"") for i in range(MAX_FLOORS + 1)))),
        f"it has {MAX_FLOORS + 1} floors, at most {MAX_FLOORS}",
    ),
    "a topic": (lambda: (MAP, chunk(channel(1, "floor/" + "x" * 2**20) + message(1, b""))), "a topic has more than"),
    "a long time": (
        lambda: (MAP, chunk(FIRST + message(1, update(2), TWO * 10**9))),
        f"its duration has {TWO} s, at most {MAX_DURATION_S:.0f}",
    ),
    "bodies": (lambda: (MAP, filling()), "the state of its floors has .* bytes, at most"),
}


@pytest.fixture(scope="module")
def bombs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Their files by name."""
    folder = tmp_path_factory.mktemp("bombs")
    files = {name: folder / f"{number}.mcap" for number, name in enumerate(BOMBS)}
    for name, (made, _) in BOMBS.items():
        files[name].write_bytes(mcap(*made()))
    return files


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_with_file_limit_and_size(name: str, bombs: dict[str, Path]) -> None:
    file, reason = bombs[name], BOMBS[name][1]
    with pytest.raises(InvalidRecording, match=reason) as caught:
        Recordings().open(file, "a")
    assert str(file) in str(caught.value)


def test_what_bombs_take_of_memory_is_bounded(bombs: dict[str, Path]) -> None:
    """A recording of 131 kB took 4.3 GiB."""
    program = """
import re, sys
from pathlib import Path
from robocorba.console.recordings import Recordings
from robocorba.errors.simulation import InvalidRecording
for name in sys.argv[1:]:
    try:
        Recordings().open(Path(name), "a")
    except InvalidRecording:
        continue
    raise SystemExit(name)
print(int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, bombs.values())], capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < MAX_MEMORY_MIB


def test_the_reading_of_a_recording_ends_when_nobody_waits_for_it_and_a_gap_takes_no_time(tmp_path: Path) -> None:
    """A film steps through it, but what is kept to scrub in has only what changed."""
    file = tmp_path / "a.mcap"
    year_ns = int(MAX_DURATION_S - 1) * 10**9
    file.write_bytes(mcap(MAP, chunk(FIRST + message(1, update(2), year_ns))))
    work, recordings = Work(60.0), Recordings()
    work.cancel()
    with pytest.raises(WorkEnded):
        recordings.open(file, "a", work)
    opened = recordings.open(file, "a")  # another one can be opened
    assert opened.row()["floors"] == ["L1"]
    assert opened.history.span()[1] == pytest.approx(1.7e9 + MAX_DURATION_S - 1)


def test_one_moment_has_a_limit(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    file.write_bytes(
        mcap(MAP, chunk(channel(1, "floor/L1")), *[chunk(message(1, update(1, 60, 0, "A" * 100_000)))] * 12)
    )
    with pytest.raises(InvalidRecording, match=r"one moment has .* bytes, at most"):
        list(Recording(file).changes())


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=40)
@given(draw=st.data())
def test_any_change_of_what_a_chunk_holds_is_read_or_reported(tmp_path: Path, draw: st.DataObject) -> None:
    """Behind the compression and without a checksum, where damage reaches the decoders."""
    content = bytearray(channel(1, "floor/L1") + channel(2, "scans") + channel(3, "missions") + channel(4, "postures"))
    for version in range(1, 4):
        content += message(1, update(version, 2), version * 10**9)
        for number in (2, 3, 4):
            content += message(number, msgspec.msgpack.encode({"robot": "A", "time": 1.0}), version * 10**9)
    for place in draw.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=6)):
        content[place] = draw.draw(st.integers(0, 255))
    file = tmp_path / "a.mcap"
    file.write_bytes(mcap(MAP, chunk(bytes(content))))
    try:
        found = Recording(file)
        deque(found.sampled(MAX_DURATION_S / 10), 0)
        deque(found.changes(), 0)
    except InvalidRecording:
        return
    assert found.building == SMALL

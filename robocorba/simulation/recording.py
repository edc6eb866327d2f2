"""Recordings of the simulated building: compact MCAP files with the map, floor updates, postures, scans and missions.

A file has an attachment with the map (a native map file, gzipped), one topic for each floor with messages as in SCHEMA,
the topics `postures`, `scans` and `missions`, see `recorded_entries`, `happenings` of a console, and chunks compressed
with zstd. `log_time` is the time of recording, `publish_time` the simulated time, both in ns. A chunk is written every
second; written chunks are readable during recording and after the recorder was killed.
"""

from __future__ import annotations

import contextlib
import gzip
import itertools
import math
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from io import SEEK_CUR, BufferedWriter, BytesIO, FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Message
from mcap.writer import MCAP0_MAGIC, Writer

from robocorba import __version__
from robocorba.errors.files import LimitExceeded, WorkEnded
from robocorba.errors.maps import MapFileError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidRecording, UpdateMismatch
from robocorba.map_editor import native
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.floor_format import dumps, loads
from robocorba.map_editor.spatial.floor_update import FloorUpdate, FloorView, memory_of
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.mission_record import MissionContent
from robocorba.simulation.recorded_entries import (
    POSTURE_SCHEMA,
    SCAN_SCHEMA,
    dump_mission,
    dump_posture,
    dump_scan,
    load_mission,
    load_posture,
    load_scan,
)
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_changes import SystemChanges
from robocorba.system.decoding import decompress_gzip, decompress_zstd

#: MCAP profile of a recording.
PROFILE = "x-robocorba"
#: Name of the attachment with the map.
MAP_ATTACHMENT = "building.yaml.gz"
#: A topic is this and the floor's name.
TOPIC_PREFIX = "floor/"
#: The other topics.
POSTURES, SCANS, MISSIONS, HAPPENINGS = "postures", "scans", "missions", "happenings"
#: Interval between chunks [s]: a killed recorder loses no more than this.
CHUNK_S = 1.0
#: Nanoseconds per second.
NS_PER_S = 1_000_000_000
#: Maximum size of a map, and of a chunk with its messages, decompressed [bytes]. The recorder writes chunks of 1 MiB,
#: and larger ones only for a single message: a whole floor with 1,000 bodies has 0.1 MiB.
MAX_MAP_BYTES, MAX_CHUNK_BYTES = 64 * 2**20, 16 * 2**20
#: Maximum number of floors. Maximum memory of the bodies and elevators of all floors at one time [bytes]: those of
#: 1,000 robots take 0.3 MiB.
MAX_FLOORS, MAX_STATE_BYTES = 1000, 64 * 2**20
#: Maximum time from the first update to any other one [s]: a year. Players step through it.
MAX_DURATION_S = 366 * 86400.0

SCHEMA = b"""// RoboCorba::FloorUpdate of omni_database.idl in msgpack: a struct is a map from the names of its members,
// an enumerator its number, counted from 0.

enum BodyKind { ROBOT_BODY, OBJECT_BODY };
struct XY { double x; double y; };
struct Body {
  unsigned long number;
  BodyKind kind;
  string name;
  double radius;
  sequence<XY> outline;
  double mass;
};

enum DoorPhase { CLOSED, DOORS_OPENING, OPEN, DOORS_CLOSING };
struct ElevatorState {
  string name;
  string cabin;
  double height;
  DoorPhase doors;
  double opening;
  sequence<string> riders;
  sequence<string> queue;
};

struct FloorUpdate {
  string floorName;
  unsigned long long since;
  unsigned long long current;
  double time;
  unsigned long long mapVersion;
  sequence<Body> came;
  sequence<unsigned long> went;
  // 40 bytes a body that moved, little-endian: unsigned long number; float vx, vy, turn; double x, y, heading
  sequence<octet> motions;
  sequence<ElevatorState> elevators;
};
"""

#: Errors that the parsers raise on damaged files.
_DAMAGE: tuple[Any, ...] = (McapError, struct.error, zlib.error, zstandard.ZstdError, msgspec.MsgspecError)
_DAMAGE += (ValueError, KeyError, EOFError, OverflowError, MemoryError, RuntimeError, MapFileError, UpdateMismatch)
#: Head of an MCAP record: opcode, and length of its content [bytes].
_RECORD_HEAD = struct.Struct("<BQ")


#: Records that are read, and their maximum sizes in the file [bytes]; others are skipped. One that can't be compressed
#: is a little longer than its content.
_MAX_RECORDS = {Opcode.HEADER: MAX_CHUNK_BYTES, Opcode.ATTACHMENT: 2 * MAX_MAP_BYTES, Opcode.CHUNK: 2 * MAX_CHUNK_BYTES}


class _RecordedMessage(NamedTuple):
    """An encoded message; an update if it has a floor. log_time: POSIX time of the recording [ns]."""

    topic: str
    floor: str
    log_time: int
    data: bytes


class Recorder:
    """Context manager that writes a recording; an existing file is kept unless `overwrite`.

    Raises InvalidRecording if the file can't be written."""

    def __init__(self, path: Path, building: Building, overwrite: bool = False) -> None:
        self.path = path
        #: Number of recorded updates.
        self.count = 0
        #: Size of the file so far [bytes].
        self.size = 0
        self._flushed_at = 0.0
        #: POSIX time of the last update of each floor [s].
        self._written_at: dict[str, float] = {}
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        document = gzip.compress(native.dumps(building).encode(), mtime=0)
        with _translating_write_errors(path):
            self._file = BufferedWriter(FileIO(path, "wb" if overwrite else "xb"))
            self._writer = Writer(self._file)
            self._writer.start(PROFILE, f"robocorba {__version__}")
            self._writer.add_attachment(0, 0, MAP_ATTACHMENT, "application/gzip", document)
            self._register_schema("RoboCorba/FloorUpdate", SCHEMA)
        self.flush()

    def write(self, update: FloorUpdate, at_s: float) -> None:
        """Add an update that was received at POSIX time `at_s` [s]. Raises InvalidRecording."""
        topic = f"{TOPIC_PREFIX}{update.floor}"
        self._add(topic, "RoboCorba/FloorUpdate", SCHEMA, dumps(update), at_s, update.time, self.count)
        self.count += 1
        if not 0.0 <= at_s - self._flushed_at < CHUNK_S:
            self._flushed_at = at_s
            self.flush()

    def write_changes(self, changes: SystemChanges, at_s: float) -> None:
        """Add what was received at POSIX time `at_s` [s]. Raises InvalidRecording."""
        for update in changes.updates:
            # Unchanged floors are recorded each second, to record the passing of time. POSIX times are rounded.
            if update.version != update.since or at_s - self._written_at.get(update.floor, 0.0) > 1.0 - 0.01:
                self.write(update, at_s)
                self._written_at[update.floor] = at_s
        for posture in changes.postures:
            self.write_posture(posture, at_s)
        for scan in changes.scans:
            self.write_scan(scan, at_s)
        time_s = max((update.time for update in changes.updates), default=0.0)
        for mission in changes.missions:
            self.write_mission(mission.name, mission.content, at_s, time_s)

    def write_posture(self, posture: Posture, at_s: float) -> None:
        """Add a posture that was received at POSIX time `at_s` [s]. Raises InvalidRecording."""
        self._add(POSTURES, "RoboCorba/Posture", POSTURE_SCHEMA, dump_posture(posture), at_s, posture.time)

    def write_scan(self, scan: RobotScan, at_s: float) -> None:
        """Add a scan that was received at POSIX time `at_s` [s]. Raises InvalidRecording."""
        self._add(SCANS, "RoboCorba/RobotScan", SCAN_SCHEMA, dump_scan(scan), at_s, scan.time)

    def write_mission(self, name: str, content: MissionContent, at_s: float, time_s: float) -> None:
        """Add the state of a mission that was received at POSIX time `at_s` and simulated time `time_s` [s]. Raises
        InvalidRecording."""
        self._add(MISSIONS, "", b"", dump_mission(name, content), at_s, time_s)

    def write_happening(self, json: bytes, at_s: float) -> None:
        """Add what a console has noted at POSIX time `at_s` [s]. Raises InvalidRecording."""
        self._add(HAPPENINGS, "", b"", json, at_s, 0.0)

    def _add(
        self, topic: str, schema: str, text: bytes, data: bytes, at_s: float, time_s: float, number: int = 0
    ) -> None:
        """schema, text: name and content of the schema of msgpack; without a name the data is JSON."""
        with _translating_write_errors(self.path):
            if topic not in self._channels:
                schema_id = self._register_schema(schema, text) if schema else 0
                self._channels[topic] = self._writer.register_channel(topic, "msgpack" if schema else "json", schema_id)
            log_time, publish_time = round(at_s * NS_PER_S), round(time_s * NS_PER_S)
            self._writer.add_message(self._channels[topic], log_time, data, publish_time, number)

    def _register_schema(self, name: str, text: bytes) -> int:
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, "omgidl", text)
        return self._schemas[name]

    def flush(self) -> None:
        """Write the current chunk, which then survives a kill of this process. Raises InvalidRecording."""
        with _translating_write_errors(self.path):
            self._writer.flush()
        self.size = self._file.tell()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with _translating_write_errors(self.path), self._file:
            if not isinstance(error, InvalidRecording):  # readers find nothing after a truncated chunk
                self._writer.finish()
            self.size = self._file.tell()


@contextlib.contextmanager
def _translating_write_errors(path: Path) -> Iterator[None]:
    """Raise InvalidRecording for an OSError."""
    try:
        yield
    except OSError as error:
        raise InvalidRecording(path, error.strerror or str(error)) from None


class Recording:
    """A recording as far as it was written when this object was created.

    check: called often during reading; what it raises ends that. cut: take what is before damage, if there is any.
    Raises InvalidRecording."""

    def __init__(self, path: Path, check: Callable[[], None] = lambda: None, cut: bool = False) -> None:
        self.path, self._check, self._ignored = path, check, _DAMAGE if cut else ()
        #: Names of the recorded floors.
        self.floors: list[str] = []
        #: Number of updates.
        self.count = 0
        #: POSIX time of the first update [s], and time from the first update to the last one [s].
        self.began = self.duration_s = 0.0
        #: Whether the recorder finished the file.
        self.is_complete = False
        document = None
        with self._translating_read_errors():
            self._size = path.stat().st_size
            if not self._size:
                raise InvalidRecording(path, "empty, nothing has been recorded yet")
            for record in self._records():
                if isinstance(record, Attachment) and record.name == MAP_ATTACHMENT:
                    document = decompress_gzip(record.data, MAX_MAP_BYTES, "its map")
                elif isinstance(record, _RecordedMessage) and record.floor:
                    self._count_update(record)
            if document is None:
                raise InvalidRecording(path, "contains no map")
            self.building = native.loads(document, MAP_ATTACHMENT)

    def updates(self, floors: Collection[str] = ()) -> Iterator[tuple[float, FloorUpdate]]:
        """Updates of the given floors, by default all, in recorded order, each with its time after `began` [s].

        Raises UnknownFloor, InvalidRecording."""
        for floor in floors:
            if floor not in self.floors:
                raise UnknownFloor("recording", floor, self.floors)
        with self._translating_read_errors():
            for record in self._records():
                if isinstance(record, _RecordedMessage) and record.floor and (not floors or record.floor in floors):
                    yield record.log_time / NS_PER_S - self.began, loads(record.data)

    def changes(self) -> Iterator[SystemChanges]:
        """Everything, in recorded order, what was received at the same time together. Raises InvalidRecording."""
        with self._translating_read_errors():
            messages = (record for record in self._records() if isinstance(record, _RecordedMessage))
            for _, recorded in itertools.groupby(messages, key=lambda message: message.log_time):
                changes, size = SystemChanges([], [], [], []), 0
                for message in recorded:
                    size += len(message.data)
                    if size > MAX_STATE_BYTES:
                        raise LimitExceeded("one moment", size, MAX_STATE_BYTES, "bytes")
                    if message.floor:
                        changes.updates.append(loads(message.data))
                    elif message.topic == POSTURES:
                        changes.postures.append(load_posture(message.data))
                    elif message.topic == SCANS:
                        changes.scans.append(load_scan(message.data))
                    elif message.topic == MISSIONS:
                        changes.missions.append(load_mission(message.data))
                yield changes

    def scans(self, floor: str) -> Iterator[tuple[float, RobotScan]]:
        """Scans on a floor in recorded order, each with its time after `began` [s]. Raises InvalidRecording."""
        with self._translating_read_errors():
            for record in self._records():
                if isinstance(record, _RecordedMessage) and record.topic == SCANS:
                    scan = load_scan(record.data)
                    if scan.at.floor == floor:
                        yield record.log_time / NS_PER_S - self.began, scan

    def sampled(
        self, every_s: float, floors: Collection[str] = (), only_changed: bool = False
    ) -> Iterator[tuple[float, dict[str, FloorView]]]:
        """Times [s] and floors by name, every `every_s` seconds and at the end; with `only_changed` without those that
        are the same as before. Raises UnknownFloor, InvalidRecording.

        Yields the same views each time; the next iteration changes them."""
        views, memory = self._views(floors), Counter[str]()
        count = 0
        for at_s, update in self.updates(floors):
            while count * every_s < at_s:
                yield count * every_s, views
                count = math.ceil(at_s / every_s) if only_changed else count + 1
                self._check()
            self._apply(update, views, memory)
        yield self.duration_s, views

    def at(self, at_s: float, floors: Collection[str] = ()) -> dict[str, FloorView]:
        """Floors by name at a time after `began` [s]. Raises UnknownFloor, InvalidRecording."""
        views, memory = self._views(floors), Counter[str]()
        for updated_at_s, update in self.updates(floors):
            if updated_at_s > at_s:
                break
            self._apply(update, views, memory)
        return views

    def _views(self, floors: Collection[str]) -> dict[str, FloorView]:
        return {floor: FloorView(floor) for floor in floors or self.floors}

    def _apply(self, update: FloorUpdate, views: dict[str, FloorView], memory: Counter[str]) -> None:
        """memory: of each floor so far [bytes]."""
        with self._translating_read_errors():
            view = views[update.floor]
            view.apply(update)
            if update.came or update.elevators:
                memory[update.floor] = memory_of(view.bodies.values(), view.elevators)
                if memory.total() > MAX_STATE_BYTES:
                    raise LimitExceeded("the state of its floors", memory.total(), MAX_STATE_BYTES, "bytes")

    def _count_update(self, update: _RecordedMessage) -> None:
        at_s = update.log_time / NS_PER_S
        if not self.count:
            self.began = at_s
        if update.floor not in self.floors:
            self.floors.append(update.floor)
            if len(self.floors) > MAX_FLOORS:
                raise LimitExceeded("it", len(self.floors), MAX_FLOORS, "floors")
        self.count += 1
        self.duration_s = at_s - self.began
        if abs(self.duration_s) > MAX_DURATION_S:
            raise LimitExceeded("its duration", f"{abs(self.duration_s):.0f}", f"{MAX_DURATION_S:.0f}", "s")

    def happenings(self) -> Iterator[tuple[float, bytes]]:
        """What a console has noted, each with its POSIX time [s] as JSON. Raises InvalidRecording."""
        with self._translating_read_errors():
            for record in self._records():
                if isinstance(record, _RecordedMessage) and record.topic == HAPPENINGS:
                    yield record.log_time / NS_PER_S, record.data

    def _records(self) -> Iterator[Attachment | _RecordedMessage]:
        with contextlib.suppress(*self._ignored):
            yield from self._all_records()

    def _all_records(self) -> Iterator[Attachment | _RecordedMessage]:
        topics: dict[int, str] = {}
        for opcode, stream in self._pieces():
            if opcode == Opcode.HEADER and Header.read(stream).profile != PROFILE:
                raise InvalidRecording(self.path, "not a recording of RoboCorba, but another MCAP file")
            if opcode == Opcode.ATTACHMENT:
                yield Attachment.read(stream)
            if opcode == Opcode.CHUNK:
                for record in _records_of(Chunk.read(stream)):
                    self._check()
                    if isinstance(record, Channel):
                        topics[record.id] = record.topic[:201]
                    else:
                        topic = topics[record.channel_id]
                        if len(topic) > 200:  # names of floors have 80
                            raise LimitExceeded("a topic", "more than 200", 200, "characters")
                        floor = topic.removeprefix(TOPIC_PREFIX) if topic.startswith(TOPIC_PREFIX) else ""
                        if floor or topic in (POSTURES, SCANS, MISSIONS, HAPPENINGS):
                            yield _RecordedMessage(topic, floor, record.log_time, record.data)

    def _pieces(self) -> Iterator[tuple[int, ReadDataStream]]:
        """Opcode and content of each record, up to the end of the data or the last complete record."""
        with open(self.path, "rb") as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise InvalidRecording(self.path, "not an MCAP file")
            while self._size - file.tell() >= _RECORD_HEAD.size:
                opcode, length = _RECORD_HEAD.unpack(file.read(_RECORD_HEAD.size))
                if opcode == Opcode.DATA_END:
                    self.is_complete = True
                    return
                if length > self._size - file.tell():
                    break
                self._check()
                limit = _MAX_RECORDS.get(opcode)
                if limit is None:
                    file.seek(length, SEEK_CUR)
                elif length > limit:
                    raise LimitExceeded("a record", length, limit, "bytes")
                else:
                    yield opcode, ReadDataStream(BytesIO(file.read(length)))
            file.seek(self._size - len(MCAP0_MAGIC))
            if file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
                raise InvalidRecording(
                    str(self.path), "damaged: the file has an end mark, but its records do not reach it"
                )

    @contextlib.contextmanager
    def _translating_read_errors(self) -> Iterator[None]:
        """Raise InvalidRecording for an OSError and for damaged content."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
        except LimitExceeded as error:
            reason = str(error)
        except WorkEnded:
            raise
        except _DAMAGE as error:
            reason = f"damaged ({error or type(error).__name__})"
        else:
            return
        raise InvalidRecording(self.path, reason) from None


def _records_of(chunk: Chunk) -> Iterator[Channel | Message]:
    """Channels and messages of a chunk. Raises LimitExceeded, and what _DAMAGE lists."""
    if chunk.compression == "zstd":
        data = decompress_zstd(chunk.data, chunk.uncompressed_size, MAX_CHUNK_BYTES, "a chunk")
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ValueError(f"a chunk is compressed with {chunk.compression[:20]!r}, not zstd")
    if len(data) > MAX_CHUNK_BYTES:
        raise LimitExceeded("a chunk", len(data), MAX_CHUNK_BYTES, "bytes")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk does not fit")
    stream = ReadDataStream(BytesIO(data))
    while stream.count < len(data):
        opcode, length = stream.read1(), stream.read8()
        if opcode == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif opcode == Opcode.MESSAGE:
            yield Message.read(stream, length)
        else:
            stream.read(length)

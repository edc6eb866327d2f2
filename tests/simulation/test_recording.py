"""Recordings: written updates are read again, also while they are recorded and after damage to the file."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from robocorba.commands.replay import scans_at
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.model import Building, Floor, FloorMap
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.recorded_entries import dump_scan, load_scan
from robocorba.simulation.recording import MAP_ATTACHMENT, PROFILE, SCHEMA, Recorder, Recording
from robocorba.simulation.robot_scans import from_sensor
from testkit.buildings import two_floors
from tests.simulation.places import scan

BEGAN = 1.7e9
SMALL = Building("b", {"L1": FloorMap(Floor(name="L1", level=1, elevation=0.0))})

versions = st.integers(0, 2**63)
numbers = st.integers(0, 2**32 - 1)
floats = st.floats(allow_nan=False)
names = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
bodies = st.builds(
    Body, numbers, st.sampled_from(BodyKind), names, floats, st.lists(st.tuples(floats, floats)).map(tuple), floats
)
moments = st.builds(
    ElevatorState, floats, names, st.sampled_from(Doors), floats, st.lists(names).map(tuple), st.lists(names).map(tuple)
)
motions = st.binary(max_size=200).map(lambda data: np.frombuffer(data[: len(data) // 40 * 40], MOTION))
updates = st.builds(
    FloorUpdate,
    st.sampled_from(["L1", "L2", "一階/b"]),
    versions,
    versions,
    st.floats(0, 1e9),
    versions,
    st.lists(bodies, max_size=3),
    st.lists(numbers),
    motions,
    st.dictionaries(names, moments, max_size=3),
)


def same(one: FloorUpdate, other: FloorUpdate) -> bool:
    return one._replace(motions=one.motions.tobytes()) == other._replace(motions=other.motions.tobytes())  # type: ignore[arg-type]


def moved(floor: str, version: int, x: float) -> FloorUpdate:
    """An update that adds (version 1) or moves the robot A of a floor."""
    came = [Body(1, BodyKind.ROBOT, "A", 0.4, (), 127.0)] if version == 1 else []
    rows = np.array([(1, 1.0, 0.0, 0.0, x, 2.0, 0.0)], MOTION)
    return FloorUpdate(floor, version - 1, version, 0.05 * version, 1, came, [], rows, {})


def record(path: Path, count: int = 100, building: Building | None = None, every_s: float = 0.05) -> list[FloorUpdate]:
    """Record a robot that moves on each floor; return the updates."""
    building = building or two_floors()
    written = [moved(floor, version, 0.1 * version) for version in range(1, count + 1) for floor in building.floors]
    with Recorder(path, building) as recorder:
        for update in written:
            recorder.write(update, BEGAN + every_s * update.version)
    return written


def assert_prefix(path: Path, written: Sequence[FloorUpdate]) -> Recording:
    """Check that a file holds the written updates in order, perhaps without the last ones."""
    found = Recording(path)
    read = [update for _, update in found.updates()]
    assert len(read) == found.count <= len(written)
    assert all(map(same, read, written))
    return found


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=12)
@given(steps=st.lists(st.tuples(updates, st.floats(0.0, 3.0)), max_size=10))
def test_a_recording_is_read_as_it_was_written(tmp_path: Path, steps: list[tuple[FloorUpdate, float]]) -> None:
    file = tmp_path / "a.mcap"
    times = (BEGAN + np.cumsum([pause_s for _, pause_s in steps])).tolist()
    written = [update for update, _ in steps]
    with Recorder(file, two_floors(), overwrite=True) as recorder:
        for update, at_s in zip(written, times, strict=True):
            recorder.write(update, at_s)
        assert recorder.count == len(steps)
    found = assert_prefix(file, written)
    assert found.is_complete and found.count == len(steps)
    assert found.building == two_floors()
    assert found.floors == list(dict.fromkeys(update.floor for update in written))
    read = list(found.updates())
    assert [at for at, _ in read] == pytest.approx([at - found.began for at in times], abs=1e-6)
    if steps:
        assert found.duration_s == pytest.approx(times[-1] - times[0], abs=1e-6)


def test_scans_are_read_with_what_no_map_has(tmp_path: Path) -> None:
    marks = np.array([False, True, False, True, False])
    own = scan("A", 1.0, distances=np.full(5, 2.5), hits=marks, is_virtual=False, unmapped=marks)
    written = [scan("B"), own, own._replace(time=1.5), scan("A", floor="L2")]
    with Recorder(tmp_path / "a.mcap", two_floors()) as recorder:
        recorder.write(moved("L1", 1, 0.0), BEGAN)
        for number, each in enumerate(written):
            recorder.write_scan(each, BEGAN + number)
    found = list(Recording(tmp_path / "a.mcap").scans("L1"))
    read = [(at_s, seen.robot, seen.time, seen.is_virtual, seen.unmapped.tolist()) for at_s, seen in found]
    assert read[0] == (0.0, "B", 1.0, True, [])
    assert read[1:] == [(1.0, "A", 1.0, False, marks.tolist()), (2.0, "A", 1.5, False, marks.tolist())]
    drawn = scans_at(Recording(tmp_path / "a.mcap"), "L1")
    shown = ["".join(each.robot for each in drawn(at_s)) for at_s in (0.0, 1.0, 1.5, 2.9, 3.1)]
    assert shown == ["B", "BA", "A", "A", ""]
    before = msgspec.msgpack.decode(dump_scan(own))
    del before["isVirtual"], before["unmapped"]  # of an earlier release
    seen = load_scan(msgspec.msgpack.encode(before))
    assert (seen.is_virtual, len(seen.unmapped)) == (True, 0)
    with pytest.raises(ValueError, match="8 hits, 0 marks of 9 rays"):
        load_scan(msgspec.msgpack.encode({**before, "distances": bytes(36)}))


def test_a_scan_is_drawn_from_its_sensor() -> None:
    at = Pose("L1", 1.0, 2.0, math.pi / 2)
    drawn = from_sensor(scan("A", rim_m=0.4, distances=np.full(5, 2.5))._replace(at=at, mount=(0.2, 0.1, 0.3)))
    assert drawn.at == pytest.approx(("L1", 0.9, 2.2, math.pi / 2 + 0.3))
    assert (drawn.distances.tolist(), drawn.first_rad, drawn.step_rad) == ([2.9] * 5, -1.0, 0.5)
    hits = np.array([True, False, True, False, False])
    lost = from_sensor(scan("A", distances=np.array([2.0, 8.0, 3.0, 8.0, 8.0]), hits=hits))
    assert lost.distances.tolist() == [2.0, 2.0, 3.0, 8.0, 8.0]
    assert len(from_sensor(scan("A", distances=np.full(1, 2.0), hits=np.ones(1, bool))).distances) == 1


def test_any_mcap_tool_can_read_it(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", 40)
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == PROFILE
        (attachment,) = reader.iter_attachments()
        assert (attachment.name, attachment.media_type) == (MAP_ATTACHMENT, "application/gzip")
        messages = list(reader.iter_messages(topics=["floor/L2"]))
    assert len(messages) == 40
    schema, channel, message = messages[1]
    assert schema is not None
    assert (schema.name, schema.encoding, schema.data) == ("RoboCorba/FloorUpdate", "omgidl", SCHEMA)
    assert channel.message_encoding == "msgpack"
    assert (message.log_time, message.publish_time) == (pytest.approx(1.7e18 + 1e8, abs=1e3), 1e8)
    assert msgspec.msgpack.decode(message.data) == {
        **{"floorName": "L2", "since": 1, "current": 2, "time": 0.1, "mapVersion": 1, "came": [], "went": []},
        **{"motions": moved("L2", 2, 0.2).motions.tobytes(), "elevators": []},
    }


def test_floors_are_chosen_and_followed(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap")
    found = Recording(tmp_path / "a.mcap")
    assert {update.floor for _, update in found.updates(["L2"])} == {"L2"}
    times = []
    for at_s, views in found.sampled(0.5):
        times.append(at_s)
        for view in views.values():
            assert view.motion(1)["x"] == pytest.approx(0.1 * view.version)
            assert view.version == 1 + int(at_s / 0.05 + 1e-3)
    assert times == pytest.approx([*(0.5 * i for i in range(10)), 4.95], abs=1e-6)
    for at_s, floors, version in ((0.51, (), 11), (99.0, ["L2"], 100), (-1.0, ["L2"], 0)):
        views = found.at(at_s, floors)
        assert {floor: view.version for floor, view in views.items()} == dict.fromkeys(floors or ["L1", "L2"], version)
    with pytest.raises(UnknownFloor, match="L3"):
        next(found.updates(["L1", "L3"]))


def test_a_file_that_can_not_be_written_is_reported(tmp_path: Path) -> None:
    written = record(tmp_path / "a.mcap", 3)
    for path, overwrite, reason in (
        (tmp_path / "a.mcap", False, "File exists"),
        (tmp_path / "no" / "a.mcap", False, "No such file"),
        (tmp_path, True, "Is a directory"),
        (Path("/dev/full"), True, "No space left"),
    ):
        with pytest.raises(InvalidRecording, match=reason), Recorder(path, Building("b"), overwrite=overwrite):
            pass
    assert_prefix(tmp_path / "a.mcap", written)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[FloorUpdate]]:
    """The bytes of a recording of a few chunks, and what it holds."""
    path = tmp_path_factory.mktemp("recorded") / "a.mcap"
    written = record(path, 12, SMALL, 0.3)
    return path.read_bytes(), written


def test_a_truncated_file_is_read_up_to_its_end(recorded: tuple[bytes, list[FloorUpdate]], tmp_path: Path) -> None:
    data, written = recorded
    file = tmp_path / "a.mcap"
    file.write_bytes(data)
    counts = []
    for length in reversed(range(0, len(data), 9)):
        os.truncate(file, length)
        try:
            counts.append(assert_prefix(file, written).count)
        except InvalidRecording:
            break
    assert counts == sorted(counts, reverse=True)
    assert len(set(counts)) >= 4
    assert (counts[0], counts[-1]) == (12, 0)
    for shorter in range(0, length, 9):
        os.truncate(file, shorter)
        with pytest.raises(InvalidRecording):
            Recording(file)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=50)
@given(draw=st.data())
def test_a_damaged_byte_is_reported(
    recorded: tuple[bytes, list[FloorUpdate]], tmp_path: Path, draw: st.DataObject
) -> None:
    data, written = recorded
    damaged = bytearray(data)
    for place in draw.draw(st.lists(st.integers(0, len(data) - 1), min_size=1, max_size=3)):
        damaged[place] ^= draw.draw(st.integers(1, 255))
    (tmp_path / "a.mcap").write_bytes(damaged)
    try:
        found = Recording(tmp_path / "a.mcap")
        read = list(found.updates())
        views = list(found.sampled(0.05))
    except InvalidRecording:
        return
    assert found.building == SMALL
    assert views
    assert all(map(same, (update for _, update in read), written))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=30)
@given(data=st.binary(), magic=st.sampled_from([b"", b"\x89MCAP0\r\n"]))
def test_any_other_file_is_refused(tmp_path: Path, data: bytes, magic: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(magic + data)
    with pytest.raises(InvalidRecording):
        Recording(tmp_path / "a.mcap")


def test_the_error_names_what_is_wrong_with_a_file(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"

    def write_mcap(profile: str) -> None:
        writer = Writer(str(file))
        writer.start(profile)
        writer.finish()

    for path, make, reason in (
        (file, lambda: None, "No such file"),
        (tmp_path, lambda: None, "Is a directory"),
        (file, file.touch, "empty, nothing has been recorded yet"),  # its recorder has only just begun
        (file, lambda: file.write_text("robocorba: 1"), "not an MCAP file"),
        (file, lambda: write_mcap("ros2"), "not a recording"),
        (file, lambda: write_mcap(PROFILE), "no map"),
    ):
        make()
        with pytest.raises(InvalidRecording, match=reason):
            Recording(path)
    for strange in (moved("L1", 3, 1.0), moved("L1", 2, 1.0)._replace(since=0)):
        with Recorder(file, two_floors(), overwrite=True) as recorder:
            recorder.write(strange, BEGAN)
        with pytest.raises(InvalidRecording, match="damaged"):
            Recording(file).at(0.0)

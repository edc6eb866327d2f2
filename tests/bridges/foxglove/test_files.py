"""MCAP files with Foxglove's messages, read by the readers of others."""

from __future__ import annotations

import contextlib
import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.display import Display, DisplayKind
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState, PhaseRecord
from robocorba.simulation.recorded_entries import dump_mission
from robocorba.simulation.recording import Recorder, Recording
from tests.simulation.places import POSTURE, SCAN, recorded_drive, tower

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
decoders = pytest.importorskip("mcap_protobuf.decoder", reason="mcap-protobuf-support is not installed")

from robocorba.bridges.foxglove.files import FoxgloveFile, convert  # noqa: E402

MISSION = MissionContent(kind="move_table", about="T1", leader="A", begun=1.0, phases=(PhaseRecord("asking", 1.0),))
Messages = dict[str, list[Any]]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    def report(recorder: Recorder, agent: ManagementAgent, at_s: float) -> None:
        recorder.write_posture(POSTURE, at_s)
        recorder.write_scan(SCAN, at_s)
        recorder.write_mission("m1", MISSION, at_s, 0.5)

    def end_mission(recorder: Recorder, agent: ManagementAgent, at_s: float) -> None:
        recorder.write_mission("m1", MISSION.ended_as(MissionResult.FAILED, "no way", 9.0), at_s, 0.6)

    def move_table(recorder: Recorder, agent: ManagementAgent, at_s: float) -> None:
        agent.place("T1", Pose("L1", 6.0, 2.0, 1.0))

    happenings = {10: report, 12: end_mission, 30: move_table}
    return recorded_drive(tmp_path_factory.mktemp("recording"), "B", (0.4, 0.0, 0.1), happenings)


@pytest.fixture(scope="module")
def messages(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Messages:
    path = tmp_path_factory.mktemp("converted") / "b.mcap"
    convert(recording, path)
    return read(path)


def read(path: Path) -> Messages:
    """By topic, all messages, each with its time, checked to be in order."""
    found: Messages = defaultdict(list)
    before = 0
    factory = decoders.DecoderFactory()
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            assert message.log_time >= before
            before = message.log_time
            assert schema is not None and schema.name.startswith(("foxglove.", "robocorba."))
            decode = json.loads
            if channel.message_encoding != "json":
                decode = factory.decoder_for(channel.message_encoding, schema)
            found[channel.topic].append((message.log_time, decode(message.data)))
    return found


def frames(messages: Messages) -> dict[str, Any]:
    """The last transform of each frame."""
    return {each.child_frame_id: each for _, message in messages["/tf"] for each in message.transforms}


def test_the_scene_has_the_building_and_all_bodies(messages: Messages) -> None:
    scene: dict[str, Any] = {}
    deleted: set[str] = set()
    for _, message in messages["/scene"]:
        scene.update((entity.id, entity) for entity in message.entities)
        deleted |= {each.id for each in message.deletions}
    things = {"floor/L1", "floor/L2", "elevator/E1", "object/T1"}
    assert things < scene.keys()
    assert {name for name in scene if name.endswith("/base_link")} == {"A/base_link", "B/base_link", "C/base_link"}
    assert deleted == {name for name in scene if name.startswith("B/")} and len(deleted) > 8
    known = frames(messages)
    for name, entity in scene.items():
        assert entity.frame_locked
        assert entity.frame_id == "map" if name.startswith("floor/") else entity.frame_id in known
    ground = scene["floor/L1"].triangles[0].points
    corners = [(point.x, point.y) for point in ground]
    parts = [corners[start : start + 3] for start in range(0, len(corners), 3)]
    areas = [abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2 for (ax, ay), (bx, by), (cx, cy) in parts]
    assert sum(areas) == pytest.approx(100.0 - 4.0)  # without the shaft
    wall = max(scene["floor/L1"].cubes, key=lambda cube: cube.size.z)
    assert (wall.pose.position.x, wall.pose.position.y, wall.size.z) == pytest.approx((3.0, 1.5, 2.5))


def test_frames_are_where_robots_and_objects_are(recording: Recording, messages: Messages) -> None:
    known = frames(messages)
    for floor, view in recording.at(math.inf).items():
        for body in view.bodies.values():
            found = known[f"{body.name}/base_link" if body.radius_m and not body.outline else f"object/{body.name}"]
            row, z = view.motion(body.number), {"L1": 0.0, "L2": 4.0}[floor]
            at, turn = found.translation, found.rotation
            assert (at.x, at.y, at.z) == pytest.approx((row["x"], row["y"], z))
            assert math.remainder(2 * math.atan2(turn.z, turn.w) - row["heading"], math.tau) == pytest.approx(0.0)
            assert found.parent_frame_id == "map"
    assert (known["object/T1"].translation.x, known["object/T1"].translation.y) == (6.0, 2.0)
    assert known["A/trunk"].parent_frame_id == "A/base_link"
    assert 0.3 < known["A/trunk"].translation.z < 1.2
    poses = [message.pose.position.x for _, message in messages["/A/pose"]]
    assert len(poses) > 30 and poses == sorted(poses) and poses[-1] > 1.5


def test_robots_are_a_document(messages: Messages) -> None:
    first, *_, last = (message for _, message in messages["/robots"])
    assert [robot["name"] for robot in first["robots"]] == ["A", "B", "C"]
    assert [robot["floor"] for robot in last["robots"]] == ["L1", "L2"]
    assert last["robots"][0]["speed"] == pytest.approx(0.4, abs=0.01)
    log = [(message.name, message.message) for _, message in messages["/log"]]
    robots = [("A", "A is on L1"), ("B", "B is on L1"), ("C", "C is on L2"), ("B", "B is gone")]
    assert log == [*robots[:3], ("m1", "asking"), ("m1", "failed: no way"), robots[3]]


def test_scans_joints_and_missions(messages: Messages) -> None:
    ((_, found),) = messages["/A/scan"]
    assert (found.timestamp.nanos, found.frame_id, found.pose.position.x) == (500_000_000, "A/base_link", 0.1)
    assert list(found.ranges) == [1.25, 2.5, math.inf, 3.0, math.inf]
    assert (found.start_angle, found.end_angle) == (-1.0, 1.0)
    ((_, joints),) = messages["/A/joint_states"]
    assert {joint.name: joint.position for joint in joints.joints} == dict(zip(JOINTS, POSTURE.joints, strict=True))
    moved = frames(messages)
    for link, (at_m, attitude) in SmartPalBody().links(np.array(POSTURE.joints)).items():
        if link != "base":
            transform = moved[f"A/{link}"]
            where, turn = transform.translation, transform.rotation
            assert (where.x, where.y, where.z) == pytest.approx(tuple(at_m))
            assert (turn.w, turn.x, turn.y, turn.z) == pytest.approx(tuple(attitude))
    (_, nothing), (_, before), (_, after) = messages["/missions"]
    assert nothing == {"missions": []}
    assert (before["missions"][0]["name"], before["missions"][0]["phase"]) == ("m1", "asking")
    assert (after["missions"][0]["result"], after["missions"][0]["reason"]) == ("failed", "no way")


def test_a_recording_has_what_was_written(recording: Recording) -> None:
    moments = list(recording.changes())
    (posture,) = (posture for moment in moments for posture in moment.postures)
    (seen,) = (scan for moment in moments for scan in moment.scans)
    begun, ended = (mission for moment in moments for mission in moment.missions)
    assert (posture, seen.mount, seen.distances.tolist()) == (POSTURE, SCAN.mount, SCAN.distances.tolist())
    assert begun == MissionState("m1", 0, MISSION)
    assert b'"attempts"' not in dump_mission("m1", MISSION)  # mission control's states don't have it
    assert ended.content.reason == "no way"
    assert recording.count == sum(len(moment.updates) for moment in moments)


def test_what_an_edit_of_the_map_removes_is_deleted(recording: Recording, tmp_path: Path) -> None:
    with contextlib.closing(FoxgloveFile(tmp_path / "a.mcap", tower())) as file:
        first = [update for at_s, update in recording.updates() if at_s == 0.0]
        file.publisher.update_floors(first)
        file.publisher.set_building(Building("tower", {"L1": tower().floors["L1"]}))
        file.publisher.update_floors([])
    messages = read(tmp_path / "a.mcap")
    deleted = {each.id for _, message in messages["/scene"] for each in message.deletions}
    assert {"floor/L2", "elevator/E1", "C/base_link", "C/trunk"} < deleted
    assert not deleted & {"floor/L1", "A/base_link", "object/T1"}
    assert [robot["name"] for robot in messages["/robots"][-1][1]["robots"]] == ["A", "B"]
    poses = messages["/A/pose"]
    assert len(poses) == 2, "a pose is published once with each whole scene, for those who have just subscribed"


def test_an_existing_file_is_kept(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "kept.mcap"
    path.write_text("mine")
    with pytest.raises(InvalidRecording, match="File exists"):
        convert(recording, path)
    assert path.read_text() == "mine"
    convert(recording, path, overwrite=True)
    assert read(path)["/tf"]
    with pytest.raises(InvalidRecording, match="No such file"):
        convert(recording, tmp_path / "nowhere" / "b.mcap")


def test_robots_are_shown_with_what_their_panels_show_if_that_is_known(recording: Recording, tmp_path: Path) -> None:
    with contextlib.closing(FoxgloveFile(tmp_path / "live.mcap", recording.building)) as file:
        file.publisher.displays = {"A": Display(DisplayKind.WAITING, "waiting for B"), "B": None}
        for changes in recording.changes():
            file.publisher.publish(changes)
    rows = {robot["name"]: robot for robot in read(tmp_path / "live.mcap")["/robots"][0][1]["robots"]}
    shown = {name: (robot["display"], robot["shows"]) for name, robot in rows.items()}
    assert shown == {"A": ("waiting", "waiting for B"), "B": ("", ""), "C": ("", "")}

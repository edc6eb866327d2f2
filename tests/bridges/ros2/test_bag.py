"""Bags of ROS 2 out of recordings, read by the library of others."""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from robocorba.bridges.ros2.bag import convert
from robocorba.bridges.ros2.frames import Frames
from robocorba.errors.simulation import InvalidRecording
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.recording import Recorder, Recording
from tests.simulation.places import POSTURE, SCAN, recorded_drive, tower

#: Messages by topic.
Messages = dict[str, list[Any]]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    def report(recorder: Recorder, agent: ManagementAgent, at_s: float) -> None:
        recorder.write_posture(POSTURE, at_s)
        recorder.write_scan(SCAN, at_s)

    return recorded_drive(tmp_path_factory.mktemp("recording"), "2-B", (0.4, 0.1, 0.2), {10: report})


def read(folder: Path) -> Messages:
    found: Messages = defaultdict(list)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(folder) as reader:
        for connection, _, data in reader.messages():
            found[connection.topic].append(store.deserialize_cdr(data, connection.msgtype))
    return found


@pytest.fixture(scope="module")
def messages(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Messages:
    folder = tmp_path_factory.mktemp("bags") / "bag"
    convert(recording, folder)
    return read(folder)


def seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


def transforms(messages: Messages, topic: str = "/tf") -> dict[str, list[Any]]:
    """Transforms by child frame."""
    found: dict[str, list[Any]] = defaultdict(list)
    for message in messages[topic]:
        for each in message.transforms:
            found[each.child_frame_id].append(each)
    return found


def test_topics_of_robots(messages: Messages) -> None:
    robots = {topic for topic in messages if topic.startswith(("/A/", "/_2_B/", "/C/"))}
    always = {"odom", "joint_states", "robot_description", "floor"}
    assert robots == {f"/{name}/{each}" for name in ("A", "_2_B", "C") for each in always} | {"/A/scan"}
    assert [message.data for message in messages["/C/floor"]] == ["L2"]
    assert len(messages["/_2_B/odom"]) < len(messages["/A/odom"])


def test_odometry_is_the_pose_and_the_velocity_in_the_robots_frame(messages: Messages) -> None:
    first, last = messages["/A/odom"][0], messages["/A/odom"][-1]
    assert (last.header.frame_id, last.child_frame_id) == ("A/odom", "A/base_link")
    twist = last.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == pytest.approx((0.4, 0.1, 0.2), abs=0.02)
    clock = [seconds(message.clock) for message in messages["/clock"]]  # of the simulation
    assert clock == sorted(clock) and 0.0 <= clock[0] < clock[-1] < 3.0
    assert seconds(last.header.stamp) == clock[-1]
    passed_s = clock[-1] - seconds(first.header.stamp)
    assert passed_s > 1.4
    at = last.pose.pose.position
    assert at.x - first.pose.pose.position.x == pytest.approx(0.4 * passed_s, abs=0.15)
    assert at.z == 0.0
    (found,) = messages["/A/scan"]
    assert (found.header.frame_id, seconds(found.header.stamp)) == ("A/laser", SCAN.time)
    assert found.ranges.tolist() == pytest.approx(np.where(SCAN.hits, SCAN.rim_m + SCAN.distances, math.inf).tolist())
    assert found.angle_max == pytest.approx(SCAN.first_rad + 4 * SCAN.step_rad)


def test_frames_lead_from_the_map_to_the_hands(messages: Messages) -> None:
    found = transforms(messages)
    parents = {child: each[-1].header.frame_id for child, each in found.items()}
    frame, passed = "A/left_finger", []
    while frame != "map":
        passed.append(frame)
        frame = parents[frame]
    assert passed[-2:] == ["A/base_link", "A/odom"]
    assert found["C/odom"][-1].transform.translation.z == tower().floors["L2"].floor.elevation
    static = transforms(messages, "/tf_static")
    assert static["floor/L2"][-1].header.frame_id == "map"
    assert static["A/laser"][-1].header.frame_id == "A/base_link"
    assert static["A/laser"][-1].transform.translation.x == pytest.approx(SCAN.mount[0])


def test_links_are_where_the_kinematics_have_them(messages: Messages) -> None:
    found = transforms(messages)
    bodies = SmartPalBody().links(np.array(POSTURE.joints))
    for link in ("left_hand", "right_forearm", "head"):
        at, turn, frame = np.zeros(3), Rotation.identity(), f"A/{link}"
        while frame != "A/base_link":
            each = found[frame][-1]
            t, q = each.transform.translation, each.transform.rotation
            outer = Rotation.from_quat((q.x, q.y, q.z, q.w))
            at = outer.apply(at) + np.array((t.x, t.y, t.z))
            turn, frame = outer * turn, each.header.frame_id
        position, (w, x, y, z) = bodies[link]
        assert at == pytest.approx(position, abs=1e-6), link
        assert turn.as_matrix() == pytest.approx(Rotation.from_quat((x, y, z, w)).as_matrix(), abs=1e-6), link


def test_the_description_has_the_frames_of_the_robot(messages: Messages) -> None:
    root = ElementTree.fromstring(messages["/A/robot_description"][0].data)
    links = {link.get("name") for link in root.iter("link")}
    frames = {frame for frame in transforms(messages) if frame.startswith("A/")}
    assert links - {"A/base_link"} == frames - {"A/base_link", "A/odom"}
    joints = {joint.get("name") for joint in root.iter("joint") if joint.get("type") == "revolute"}
    first, last = messages["/A/joint_states"][0], messages["/A/joint_states"][-1]
    assert joints == set(first.name)
    assert first.position.tolist() == [0.0] * len(JOINTS)
    assert [last.position[[*last.name].index(name)] for name in JOINTS] == pytest.approx(POSTURE.joints)


def test_maps_have_what_does_not_move(messages: Messages) -> None:
    (ground,), (upper,), (default,) = (messages[topic] for topic in ("/floors/L1/map", "/floors/L2/map", "/map"))
    assert default.data.tolist() == ground.data.tolist()
    assert upper.info.origin.position.z == tower().floors["L2"].floor.elevation
    assert {-1, 0, 100} >= set(ground.data.tolist()) >= {0, 100}
    assert (cell(ground, 2.8, 2.9), cell(ground, 8.0, 8.0)) == (0, 100)
    assert 100 in {cell(ground, x, 2.9) for x in (2.98, 3.02)}, "the wall is missing"
    table = tower().floors["L1"].geometrical.objects["T1"]
    assert cell(ground, *table.at) == 0, "a movable object is on the map"


def cell(grid: Any, x: float, y: float) -> int:
    column = int((x - grid.info.origin.position.x) / grid.info.resolution)
    row = int((y - grid.info.origin.position.y) / grid.info.resolution)
    return int(grid.data[row * grid.info.width + column])


def test_one_robot_with_plain_frames(recording: Recording, tmp_path: Path) -> None:
    convert(recording, tmp_path / "bag", {"A"}, Frames(is_namespaced=True))
    messages = read(tmp_path / "bag")
    assert not {topic for topic in messages if topic.startswith(("/C/", "/_2_B/"))}
    assert {"odom", "base_link", "left_hand"} < transforms(messages, "/A/tf").keys()
    assert messages["/A/odom"][-1].child_frame_id == "base_link"
    assert "/tf" not in messages


def test_an_existing_folder_is_kept_unless_it_is_overwritten(recording: Recording, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("mine")
    convert(recording, tmp_path / "bag", {"A"})
    for folder, overwrite in (("bag", False), ("other", True)):
        with pytest.raises(InvalidRecording, match="exists"):
            convert(recording, tmp_path / folder, overwrite=overwrite)
    convert(recording, tmp_path / "bag", {"B"}, overwrite=True)
    assert "/A/odom" not in read(tmp_path / "bag")
    assert (tmp_path / "other" / "mine.txt").exists()

"""robocorba watch, record and replay beside a running simulation, whose server is killed meanwhile."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import av
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from omniORB import CORBA

from robocorba.errors.simulation import InvalidRecording
from robocorba.map_editor.corba import maps
from robocorba.map_editor.model import Wall
from robocorba.map_editor.spatial.floor_update import WHOLE
from robocorba.orb.orb import Orb
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.recording import Recording
from robocorba.stubs import RoboCorba
from testkit.buildings import two_floors
from testkit.processes import ROBOCORBA, Running, eventually, refusal
from testkit.simulation import about

pytestmark = [pytest.mark.system, pytest.mark.usefixtures("robots")]

PATIENCE_S = 120.0
POSTURE = [0.1] * len(JOINTS)
Robocorba = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture(scope="module")
def robots(system: Running, system_orb: Orb) -> Iterator[None]:
    """A on L1 and B on L2 drive in circles."""
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    sessions = [server.registerRobot(about(name, 5.0, 4.0, floor=floor)) for name, floor in (("A", "L1"), ("B", "L2"))]
    ended = threading.Event()

    def drive() -> None:
        while not ended.wait(0.3):
            for session in sessions:
                with contextlib.suppress(CORBA.SystemException):  # the server is killed now and then
                    session.command(RoboCorba.Velocity(0.5, 0.0, 0.5), 2.0)
                    session.reportPosture(POSTURE)

    driver = threading.Thread(target=drive)
    driver.start()
    try:
        eventually(lambda: all(session.state().moving.ahead > 0.0 for session in sessions), PATIENCE_S, "moving robots")
        yield
    finally:
        ended.set()
        driver.join()
    for session in sessions:
        session.deregister()


def done(process: subprocess.Popen[str]) -> str:
    """What a command printed that had nothing to complain about."""
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, err) == (0, "")
    return out


def pictures(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def updates_in(path: Path) -> int:
    """Updates recorded so far; 0 before the recorder has written the head of its file."""
    try:
        return Recording(path).count
    except InvalidRecording:
        return 0


def test_it_is_live_on_a_terminal(system: Running) -> None:
    ours, its = pty.openpty()
    environment = {**os.environ, "ROBOCORBA_NAMING": str(system.naming), "TERM": "xterm", "COLUMNS": "150"}
    with subprocess.Popen([ROBOCORBA, "watch"], stdin=its, stdout=its, stderr=its, env=environment) as process:
        os.close(its)
        shown = ""
        with contextlib.suppress(OSError):  # so ends a terminal
            while data := os.read(ours, 65536).decode(errors="replace"):
                shown += data
                if shown.count("heading") >= 3 and process.poll() is None:
                    process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    os.close(ours)
    assert "Traceback" not in shown
    assert shown.count("\x1b[2K") > 10


@contextlib.contextmanager
def stopped(pid: int) -> Iterator[None]:
    """A process is held inside the `with`."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def test_all_go_on_when_the_server_was_killed(robocorba: Robocorba, system: Running, tmp_path: Path) -> None:
    file, lost = tmp_path / "a.mcap", tmp_path / "lost.mcap"
    recorder, killed = robocorba("record", "a.mcap"), robocorba("record", "lost.mcap", "--floor", "L2", "--no-scans")
    watcher, film = robocorba("watch"), robocorba("watch", "--video", "a.mp4", "--fps", "20", "--width", "300")
    (tmp_path / "there.mcap").touch()
    assert refusal(robocorba("record", "there.mcap")) == "robocorba record: there.mcap: File exists"
    assert watcher.stdout is not None
    assert [watcher.stdout.readline().split("\t")[0] for _ in range(2)] == ["robots", "2"]
    for path in (file, lost):
        eventually(lambda path=path: updates_in(path) > 20, PATIENCE_S, "updates")
    eventually((tmp_path / "a.mp4").exists, PATIENCE_S, "the video")

    killed.kill()
    assert watcher.stderr is not None
    with stopped(system.process.pid):  # else the next server is there before anybody notices
        os.kill(system.pid("simulation"), signal.SIGKILL)
        noticed = watcher.stderr.readline()
    assert noticed.startswith("robocorba watch: ") and noticed.endswith("; waiting\n")
    killed.wait(PATIENCE_S)
    cut_off = Recording(lost)
    assert not cut_off.is_complete
    assert cut_off.floors == ["L2"]

    def loaded() -> int:
        """How often the first floor came as a whole."""
        return sum(update.since == WHOLE for _, update in Recording(file).updates(["L1"]))

    eventually(lambda: loaded() == 2, PATIENCE_S, "the floor of the next server")
    assert any(line.startswith("2\t") for line in iter(watcher.stdout.readline, ""))
    for process, number in ((recorder, signal.SIGTERM), (watcher, signal.SIGINT), (film, signal.SIGINT)):
        process.send_signal(number)
    assert done(recorder).startswith("wrote a.mcap: ")
    _, err = watcher.communicate(timeout=PATIENCE_S)
    assert (watcher.returncode, err) == (0, "")
    said = done(film)
    assert pictures(tmp_path / "a.mp4") == int(said.split(" s, ")[1].split()[0]) > 0

    found = Recording(file)
    assert (found.is_complete, found.building, found.floors) == (True, two_floors(), ["L1", "L2"])
    ways: dict[str, set[float]] = {"A": set(), "B": set()}
    for _, views in found.sampled(0.2):
        for view in views.values():
            for body in view.bodies.values():
                if body.name in ways:
                    ways[body.name].add(float(view.motion(body.number)["x"]))
    assert all(len(way) > 3 for way in ways.values())
    postures = [posture for changes in found.changes() for posture in changes.postures]
    assert {(posture.robot, posture.joints) for posture in postures} == {(name, tuple(POSTURE)) for name in "AB"}
    times = [posture.time for posture in postures if posture.robot == "A"]
    assert len(set(times)) == len(times) > 3


def poses(file: Path) -> int:
    """How many of A are in a recording for Foxglove before the chunk that is being written, whose length is not there
    yet."""
    topics: dict[int, str] = {}
    count = 0
    with contextlib.suppress(OSError, McapError), file.open("rb") as opened:
        for record in StreamReader(opened).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            count += isinstance(record, Message) and topics[record.channel_id] == "/A/pose"
    return count


def test_recordings_for_foxglove(robocorba: Robocorba, tmp_path: Path) -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
    killed = robocorba("record", "killed.mcap", "--foxglove")
    done(robocorba("record", "live.mcap", "--foxglove", "--seconds", "3"))
    done(robocorba("record", "compact.mcap", "--seconds", "3"))
    assert done(robocorba("convert", "compact.mcap", "converted.mcap")).startswith("wrote converted.mcap: ")
    for file in ("live.mcap", "converted.mcap"):
        with open(tmp_path / file, "rb") as opened:
            summary = make_reader(opened, validate_crcs=True).get_summary()
        assert summary is not None and summary.statistics is not None
        counts = summary.statistics.channel_message_counts
        found = {channel.topic: counts[number] for number, channel in summary.channels.items()}
        assert min(found[f"/{robot}/{topic}"] for robot in "AB" for topic in ("pose", "joint_states")) > 3
        assert found["/tf"] > 3 and found["/robots"] > 0
    assert refusal(robocorba("convert", "live.mcap", "again.mcap")) == (
        "robocorba convert: live.mcap: not a recording of RoboCorba, but another MCAP file"
    )
    eventually(lambda: poses(tmp_path / "killed.mcap") > 20, PATIENCE_S, "poses in the file")
    killed.kill()
    killed.wait(PATIENCE_S)
    assert poses(tmp_path / "killed.mcap") > 20


def test_it_is_live_in_foxglove(robocorba: Robocorba, system: Running, system_orb: Orb) -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
    client_module = pytest.importorskip("testkit.foxglove_client", reason="websockets is not installed")
    server = robocorba("foxglove", "--port", "0", "--steer", "--state", str(system.state))
    assert server.stdout is not None
    url = server.stdout.readline().strip()
    assert url, server.communicate(timeout=PATIENCE_S)[1]
    with client_module.FoxgloveClient(url) as client:
        topics = {"/scene", "/tf", "/robots", "/A/pose", "/B/pose", "/A/joint_states", "/B/joint_states"}
        client.until(lambda: all(len(client.messages.get(topic, ())) for topic in topics))
        client.until(lambda: len(client.messages["/A/pose"]) > 5)
        assert client.channels["/tf"]["schemaName"] == "foxglove.FrameTransforms"
        assert client.info["capabilities"] == ["time", "playbackControl"]
        client.until(lambda: len(set(client.times)) > 3)
        assert client.times == sorted(client.times)

        for speed, request, is_paused in ((1.0, "stop", True), (0.5, "slow", False), (1.0, "on", False)):
            client.play(speed, request, pause=is_paused)
            client.until(lambda said=(is_paused, speed, request): client.playback and client.playback[-1] == said)
        client.play(1e9, "too fast")
        client.until(lambda: client.playback[-1] == (False, 1.0, "too fast"))
    with client_module.FoxgloveClient(url) as client:  # a later one sees the whole scene, too
        client.until(lambda: "/scene" in client.messages)
        assert b"floor/L1" in client.messages["/scene"][0][1] + client.messages["/scene"][-1][1]
        editor = system_orb.resolve("MapEditor", RoboCorba.MapEditor)
        scenes = len(client.messages["/scene"])
        version = editor.create("L1", maps.element(Wall("new", (0.5, 0.5), (1.0, 0.5))))
        client.until(lambda: any(b"floor/L1" in data for _, data in client.messages["/scene"][scenes:]))
        editor.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L1", "new"), version)

        with stopped(system.process.pid):  # else the next server is there before anybody notices
            os.kill(system.pid("simulation"), signal.SIGKILL)
            client.until(lambda: client.status)
        poses = len(client.messages["/A/pose"])
        client.until(lambda: len(client.messages["/A/pose"]) > poses + 3)
    server.send_signal(signal.SIGINT)
    assert done(server) == ""

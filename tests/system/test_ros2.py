"""robocorba ros2 beside a running system: a foreign node sees two robots, and gives orders to one.

Without ROS 2 it is skipped; `make ros2` makes a Python that has it."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from robocorba.claimed_ports import claimed_ports
from robocorba.control.agent_state import AgentCondition, ProgramResult
from robocorba.corba.conversion import maps
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.maps.model import Wall
from robocorba.programs import program
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.stubs import RoboCorba
from robocorba.testing.json_process import Process
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, eventually
from robocorba.testing.ros2_environment import python_path, ros2_python

pytestmark = [pytest.mark.system, pytest.mark.full]

PATIENCE_S = 60.0
PYTHON = ros2_python()
if not PYTHON:
    pytest.skip("ROS 2 is not installed; see make ros2", allow_module_level=True)
HAS_TF2 = bool(ros2_python("tf2_msgs.msg"))
WAITING = ProgramBuilder("waiting").wait(60.0).program()


class Ros:
    """A foreign node."""

    def __init__(self, folder: Path, domain: int) -> None:
        environment = {"PYTHONPATH": python_path(), "ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder)}
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._process = Process(
            (PYTHON, "-m", "robocorba.testing.ros2_listener"), folder / "listener.log", (), environment
        )
        self._process.receive(PATIENCE_S)

    def __getattr__(self, command: str) -> Callable[..., Any]:
        return lambda **arguments: self._process.ask({"do": command, **arguments}, PATIENCE_S)

    def last(self, topic: str) -> Any:
        """The last message of a topic; None before the first."""
        found = self.messages(topic=topic)
        return found[0][1] if found else None

    def wait(self, topic: str, is_there: Callable[[Any], bool] = lambda message: True) -> Any:
        """The next message for which `is_there` holds."""
        before = self.counts().get(topic, 0)

        def look() -> Any:
            found = self.last(topic) if self.counts().get(topic, 0) > before else None
            return found if found and is_there(found) else None

        return eventually(look, PATIENCE_S, topic)

    def close(self) -> None:
        self._process.kill()


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A ROS domain whose ports nobody else has: there are 0 to 232, of 250 ports each from 7400 on."""
    with claimed_ports() as port:
        yield 100 + port % 100


@pytest.fixture(scope="module")
def agents(
    system: Running, system_orb: Orb, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, RemoteAgent]]:
    """A on L1 and B on L2."""
    with Launcher(tmp_path_factory.mktemp("robots")) as launch:
        for name, floor in (("A", "L1"), ("B", "L2")):
            launch(
                *(ROBOCORBA, "robot", name, "--floor", floor, "--at", "5,4", "--state", str(system.state)),
                ROBOCORBA_NAMING=str(system.naming),
            )
        yield {name: RemoteAgent(system_orb, name, PATIENCE_S) for name in "AB"}


@pytest.fixture(scope="module")
def start(
    system: Running, domain: int, agents: Mapping[str, RemoteAgent], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., Any]]:
    """Starts `robocorba ros2` with arguments."""
    folder = tmp_path_factory.mktemp("bridge")
    with Launcher(folder) as launch:

        def start(*arguments: str) -> Any:
            process = launch(
                *(PYTHON, "-m", "robocorba", "ros2", "--domain", str(domain), *arguments),
                PYTHONPATH=python_path(),
                ROBOCORBA_NAMING=str(system.naming),
                ROS_LOG_DIR=str(folder),
            )
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith(f"ROS domain {domain}: A"), line or process.communicate(timeout=PATIENCE_S)[1]
            return process

        yield start


@pytest.fixture(scope="module")
def bridge(start: Callable[..., Any]) -> list[Any]:
    """The running bridge, the last one of the list."""
    return [start()]


@pytest.fixture(scope="module")
def ros(domain: int, bridge: list[Any], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros]:
    ros = Ros(tmp_path_factory.mktemp("listener"), domain)
    for name in "AB":
        ros.subscribe(topic=f"/{name}/odom", type="nav_msgs/msg/Odometry")
        ros.subscribe(topic=f"/{name}/scan", type="sensor_msgs/msg/LaserScan", best_effort=True)
        ros.subscribe(topic=f"/{name}/joint_states", type="sensor_msgs/msg/JointState")
        ros.subscribe(topic=f"/{name}/robot_description", type="std_msgs/msg/String", latched=True)
        ros.subscribe(topic=f"/{name}/floor", type="std_msgs/msg/String", latched=True)
    for topic in ("/map", "/floors/L2/map"):
        ros.subscribe(topic=topic, type="nav_msgs/msg/OccupancyGrid", latched=True)
    ros.subscribe(topic="/clock", type="rosgraph_msgs/msg/Clock", best_effort=True)
    ros.subscribe(topic="/diagnostics", type="diagnostic_msgs/msg/DiagnosticArray")
    if HAS_TF2:
        ros.subscribe(topic="/tf", type="tf2_msgs/msg/TFMessage")
        ros.subscribe(topic="/tf_static", type="tf2_msgs/msg/TFMessage", latched=True)
    yield ros
    ros.close()


def seconds(stamp: Any) -> float:
    return float(stamp["sec"] + stamp["nanosec"] * 1e-9)


def position(odometry: Any) -> tuple[float, float]:
    at = odometry["pose"]["pose"]["position"]
    return at["x"], at["y"]


def is_idle(agent: RemoteAgent) -> bool:
    return agent.state().condition is AgentCondition.IDLE


def status(ros: Ros, name: str) -> Any:
    found = ros.last("/diagnostics")
    return next((each for each in found["status"] if each["name"] == name), None) if found else None


def test_two_robots_are_seen(ros: Ros) -> None:
    for name, floor in (("A", "L1"), ("B", "L2")):
        odometry = ros.wait(f"/{name}/odom")
        assert position(odometry) == pytest.approx((5.0, 4.0), abs=0.01)
        assert (odometry["header"]["frame_id"], odometry["child_frame_id"]) == (f"{name}/odom", f"{name}/base_link")
        scan = ros.wait(f"/{name}/scan")
        assert len(scan["ranges"]) == 181
        # On L1 there are the outline to the right, and the table to the left; L2 is empty and unbounded.
        right, left = scan["ranges"][0], scan["ranges"][180]
        assert (right, left) == (pytest.approx((4.0, 3.5), abs=0.01) if name == "A" else ("inf", "inf"))
        assert seconds(scan["header"]["stamp"]) > 0.0
        assert len(ros.wait(f"/{name}/joint_states")["name"]) == 18
        eventually(lambda name=name: ros.last(f"/{name}/robot_description"), PATIENCE_S, "description")
        assert f"{name}/base_link" in ros.last(f"/{name}/robot_description")["data"]
        assert ros.last(f"/{name}/floor")["data"] == floor
    clock = seconds(ros.wait("/clock")["clock"])
    assert seconds(ros.wait("/clock")["clock"]) > clock
    eventually(lambda: ros.last("/map") and ros.last("/floors/L2/map"), PATIENCE_S, "maps")
    assert {-1, 0, 100} >= set(ros.last("/map")["data"]) >= {0, 100}
    assert ros.last("/floors/L2/map")["info"]["origin"]["position"]["z"] == 4.0
    eventually(lambda: (status(ros, "A") or {}).get("message") == "idle", PATIENCE_S, "diagnostics")


def test_the_map_follows_edits(ros: Ros, system_orb: Orb) -> None:
    def occupied() -> int:
        return int(ros.last("/map")["data"].count(100))

    eventually(lambda: ros.last("/map"), PATIENCE_S, "map")
    before = occupied()
    editor = system_orb.resolve("MapEditor", RoboCorba.MapEditor, PATIENCE_S)
    version = editor.create("L1", maps.element(Wall("new", (1.0, 1.0), (3.0, 1.0))))
    eventually(lambda: occupied() > before + 30, PATIENCE_S, "a map with the wall")
    editor.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L1", "new"), version)
    eventually(lambda: occupied() == before, PATIENCE_S, "a map without it")


@pytest.mark.skipif(not HAS_TF2, reason="tf2_msgs is not installed")
def test_frames_connect_the_map_with_robots(ros: Ros) -> None:
    # Links are published once a second, so one message does not have all.
    def parents() -> dict[str, str]:
        messages = [each for _, each in ros.messages(topic="/tf", last=60)] + [ros.last("/tf_static")]
        return {
            each["child_frame_id"]: each["header"]["frame_id"]
            for message in filter(None, messages)
            for each in message["transforms"]
        }

    wanted = {
        **{
            f"{name}/{child}": f"{name}/{parent}"
            for name in "AB"
            for child, parent in (("base_link", "odom"), ("laser", "base_link"))
        },
        **{f"{name}/odom": "map" for name in "AB"},
        "floor/L2": "map",
    }
    eventually(lambda: wanted.items() <= parents().items(), PATIENCE_S, "frames")
    eventually(lambda: {"A/left_hand", "B/right_finger", "A/head"} <= parents().keys(), PATIENCE_S, "links")


def test_a_robot_is_driven_by_cmd_vel_and_stops_without(ros: Ros, agents: Mapping[str, RemoteAgent]) -> None:
    agent = agents["A"]
    eventually(lambda: ros.subscribers(topic="/A/cmd_vel"), PATIENCE_S, "subscription")
    x, y = position(ros.wait("/A/odom"))
    twist = {"linear.x": 0.2, "angular.z": 0.0}

    def has_driven() -> bool:
        ros.publish(topic="/A/cmd_vel", type="geometry_msgs/msg/Twist", message=twist)
        return math.dist(position(ros.wait("/A/odom")), (x, y)) > 0.1

    eventually(has_driven, PATIENCE_S, "driven")
    assert agent.state().program.name == "teleoperation"
    ros.wait("/A/odom", lambda message: abs(message["twist"]["twist"]["linear"]["x"]) < 0.01)  # nobody publishes now
    eventually(lambda: is_idle(agent), PATIENCE_S, "end of teleoperation")
    at = position(ros.wait("/A/odom"))
    assert at[0] > x
    assert at[1] == pytest.approx(y, abs=0.02)
    assert position(ros.wait("/B/odom")) == pytest.approx((5.0, 4.0), abs=0.01)


def test_a_goal_is_driven_to_and_a_new_one_replaces_it(ros: Ros, agents: Mapping[str, RemoteAgent]) -> None:
    agent = agents["A"]
    eventually(lambda: is_idle(agent), PATIENCE_S, "rest")
    eventually(lambda: ros.subscribers(topic="/A/goal_pose"), PATIENCE_S, "subscription")

    def go(frame: str, x: float, y: float) -> None:
        goal = {"header.frame_id": frame, "pose.position.x": x, "pose.position.y": y, "pose.orientation.w": 1.0}
        ros.publish(topic="/A/goal_pose", type="geometry_msgs/msg/PoseStamped", message=goal)

    go("map", 2.0, 2.0)
    eventually(lambda: agent.state().program.name == "goal_pose", PATIENCE_S, "drive")
    go("floor/L1", 5.0, 4.0)
    eventually(
        lambda: (
            (state := agent.state()).program.result is ProgramResult.DONE
            and math.dist((state.at.x, state.at.y), (5.0, 4.0)) < 0.01
        ),
        PATIENCE_S,
        "second goal",
    )
    go("nowhere", 1.0, 1.0)
    go("A/base_link", 0.5, 0.0)
    eventually(lambda: agent.state().at.x > 5.49 and is_idle(agent), PATIENCE_S, "goal ahead of the robot")


def test_programs_are_loaded_run_paused_and_aborted(ros: Ros, agents: Mapping[str, RemoteAgent]) -> None:
    agent = agents["B"]
    done, reason = ros.set_parameter(node="robocorba", name="B.program", text="{")
    assert not done and "not JSON" in reason
    done, reason = ros.set_parameter(node="robocorba", name="B.program", text=json.dumps({"name": "x", "icons": [{}]}))
    assert not done and "icons[0]" in reason
    assert ros.trigger(service="/B/run_program") == [False, "can't run a program: the robot has none loaded"]
    assert ros.set_parameter(node="robocorba", name="B.program", text=program.dumps(WAITING)) == [True, ""]
    assert ros.trigger(service="/B/run_program") == [True, ""]
    assert agent.state().condition is AgentCondition.RUNNING
    ros.publish(
        topic="/B/cmd_vel", type="geometry_msgs/msg/Twist", message={"linear.x": 0.2}
    )  # refused, with a warning
    assert ros.trigger(service="/B/pause") == [True, ""]
    assert agent.state().condition is AgentCondition.PAUSED
    assert ros.trigger(service="/B/resume") == [True, ""]
    eventually(lambda: status(ros, "B")["message"] == "running: waiting", PATIENCE_S, "diagnostics")
    assert ros.trigger(service="/B/stop") == [True, ""]
    eventually(lambda: status(ros, "B")["message"] == "stopped: emergency stop", PATIENCE_S, "diagnostics")
    assert status(ros, "B")["level"] == [2]
    assert ros.trigger(service="/B/reset_stop") == [True, ""]
    assert ros.trigger(service="/B/abort") == [True, ""]
    eventually(lambda: is_idle(agent), PATIENCE_S, "end")


def test_it_survives_a_killed_server(ros: Ros, system: Running) -> None:
    killed = system.pid("simulation")
    os.kill(killed, signal.SIGKILL)
    eventually(lambda: system.pid("simulation") not in (0, killed), PATIENCE_S, "restart")
    for name in "AB":
        ros.wait(f"/{name}/odom")
        ros.wait(f"/{name}/scan")


def test_a_node_regains_a_bridge_that_was_killed(
    ros: Ros, bridge: list[Any], start: Callable[..., Any], agents: Mapping[str, RemoteAgent]
) -> None:
    agent = agents["A"]
    ros.publish(topic="/A/cmd_vel", type="geometry_msgs/msg/Twist", message={"angular.z": 0.2})
    bridge.pop().kill()
    eventually(lambda: is_idle(agent), PATIENCE_S, "a robot stands whose driver is gone")
    descriptions, count = ros.counts()["/A/robot_description"], ros.counts()["/A/odom"]
    bridge.append(start("--robots", "A"))
    eventually(lambda: ros.counts()["/A/odom"] > count + 5, PATIENCE_S, "odometry")
    eventually(lambda: ros.counts()["/A/robot_description"] > descriptions, PATIENCE_S, "latched description")
    eventually(lambda: ros.subscribers(topic="/A/cmd_vel"), PATIENCE_S, "subscription")
    last = bridge[-1]
    last.send_signal(signal.SIGINT)
    out, err = last.communicate(timeout=PATIENCE_S)
    assert (last.returncode, out) == (0, "")
    assert "Traceback" not in err


def test_it_does_as_its_options_say(
    start: Callable[..., Any], agents: Mapping[str, RemoteAgent], domain: int, tmp_path: Path
) -> None:
    process = start("--robots", "A", "--stamped", "--namespaced-tf", "--floor", "L2", "--resolution", "0.1")
    ros = Ros(tmp_path, domain)  # another node: in each process a topic has one type
    ros.subscribe(topic="/map", type="nav_msgs/msg/OccupancyGrid", latched=True)
    info = eventually(lambda: ros.last("/map"), PATIENCE_S, "map")["info"]
    assert (info["origin"]["position"]["z"], info["resolution"]) == (4.0, pytest.approx(0.1))
    if HAS_TF2:
        ros.subscribe(topic="/A/tf", type="tf2_msgs/msg/TFMessage")
        frames = [(each["header"]["frame_id"], each["child_frame_id"]) for each in ros.wait("/A/tf")["transforms"]]
        assert frames[:2] == [("map", "odom"), ("odom", "base_link")]

    def turns() -> bool:
        twist = {"twist.angular.z": 0.2}
        ros.publish(topic="/A/cmd_vel", type="geometry_msgs/msg/TwistStamped", message=twist)
        return agents["A"].state().actor.velocity[2] == pytest.approx(0.2, abs=0.01)

    eventually(turns, PATIENCE_S, "turn")
    ros.close()
    process.terminate()

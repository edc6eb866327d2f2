"""robocorba ros2 beside a running system: a foreign node sees two robots, and gives orders to one.

Without ROS 2 it is skipped; `make ros2` makes a Python that has it."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robocorba.map_editor.corba import maps
from robocorba.map_editor.model import Wall
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition, ProgramReport, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.programs import program
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.stubs import RoboCorba
from testkit.json_process import Process
from testkit.processes import Launcher, Running, eventually
from testkit.ros2_disc import Disc
from testkit.ros2_environment import python_path, ros2_python
from testkit.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.full]

PATIENCE_S = 120.0
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
        self._process = Process((PYTHON, "-m", "testkit.ros2_listener"), folder / "listener.log", (), environment)
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


@pytest.fixture
def agents(system_orb: Orb, tmp_path: Path) -> Iterator[tuple[RemoteAgent, RemoteAgent]]:
    """A on L1 and B on L2."""
    with (
        robot_process(tmp_path, system_orb, "A", "--floor", "L1", "--at", "5,4") as a,
        robot_process(tmp_path, system_orb, "B", "--floor", "L2", "--at", "5,4") as b,
    ):
        yield a.agent, b.agent


@pytest.fixture
def start(system: Running, domain: int, launch: Launcher, tmp_path: Path) -> Callable[..., Any]:
    """Starts `robocorba ros2` with arguments."""

    def start(*arguments: str) -> Any:
        command = (PYTHON, "-m", "robocorba", "ros2", "--domain", str(domain), *arguments)
        places = {"ROBOCORBA_NAMING": str(system.naming), "ROS_LOG_DIR": str(tmp_path)}
        process = launch(*command, PYTHONPATH=python_path(), **places)
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith(f"ROS domain {domain}: A"), line or process.communicate(timeout=PATIENCE_S)[1]
        return process

    return start


def subscribe(ros: Ros) -> None:
    """To all topics of both robots."""
    for name in "AB":
        ros.subscribe(topic=f"/{name}/odom", type="nav_msgs/msg/Odometry")
        ros.subscribe(topic=f"/{name}/scan", type="sensor_msgs/msg/LaserScan", best_effort=True)
        ros.subscribe(topic=f"/{name}/joint_states", type="sensor_msgs/msg/JointState")
        for topic in ("robot_description", "floor"):
            ros.subscribe(topic=f"/{name}/{topic}", type="std_msgs/msg/String", latched=True)
    for topic in ("/map", "/floors/L2/map"):
        ros.subscribe(topic=topic, type="nav_msgs/msg/OccupancyGrid", latched=True)
    ros.subscribe(topic="/clock", type="rosgraph_msgs/msg/Clock", best_effort=True)
    ros.subscribe(topic="/diagnostics", type="diagnostic_msgs/msg/DiagnosticArray")
    if HAS_TF2:
        ros.subscribe(topic="/tf", type="tf2_msgs/msg/TFMessage")
        ros.subscribe(topic="/tf_static", type="tf2_msgs/msg/TFMessage", latched=True)


def test_a_foreign_node_sees_two_robots_and_gives_orders(
    start: Callable[..., Any],
    domain: int,
    agents: tuple[RemoteAgent, RemoteAgent],
    system: Running,
    system_orb: Orb,
    tmp_path: Path,
) -> None:
    a, b = agents
    bridge = start()
    with contextlib.closing(Ros(tmp_path, domain)) as ros:
        subscribe(ros)
        see_robots(ros)
        see_edits(ros, system_orb)
        if HAS_TF2:
            see_frames(ros)
        drive_by_cmd_vel(ros, a)
        drive_to_goals(ros, a)
        run_programs(ros, b)
        killed = system.pid("simulation")
        os.kill(killed, signal.SIGKILL)
        eventually(lambda: system.pid("simulation") not in (0, killed), PATIENCE_S, "restart")
        for name in "AB":
            ros.wait(f"/{name}/odom")
            ros.wait(f"/{name}/scan")
        ros.publish(topic="/A/cmd_vel", type="geometry_msgs/msg/Twist", message={"angular.z": 0.2})
        bridge.kill()
        eventually(lambda: is_idle(a), PATIENCE_S, "a robot stands whose driver is gone")
        descriptions, count = ros.counts()["/A/robot_description"], ros.counts()["/A/odom"]
        again = start("--robots", "A", "--stamped", "--namespaced-tf", "--floor", "L2", "--resolution", "0.1")
        eventually(lambda: ros.counts()["/A/odom"] > count + 5, PATIENCE_S, "odometry")
        eventually(lambda: ros.counts()["/A/robot_description"] > descriptions, PATIENCE_S, "latched description")
        eventually(lambda: ros.subscribers(topic="/A/cmd_vel"), PATIENCE_S, "subscription")
        with contextlib.closing(Ros(tmp_path, domain)) as other:
            see_options(other, a)
        again.send_signal(signal.SIGINT)
        out, err = again.communicate(timeout=PATIENCE_S)
        assert (again.returncode, out) == (0, "")
        assert "Traceback" not in err


def run(agent: RemoteAgent, builder: ProgramBuilder) -> ProgramReport:
    """The report of a program."""
    agent.load(program.dumps(builder.program()))
    agent.run()
    is_done = lambda: agent.state().program.result is not ProgramResult.NO_RESULT  # noqa: E731
    eventually(is_done, PATIENCE_S, "the end of the program")
    return agent.state().program


@pytest.fixture
def start_agent(system: Running, launch: Launcher, tmp_path: Path) -> Callable[..., Any]:
    """Starts the agent C of a disc at L1:3,2."""

    def start(disc: Disc) -> Any:
        process = launch(
            *(PYTHON, "-m", "robocorba", "robot", "C", "--floor", "L1", "--at", "3,2,0"),
            *("--adaptor", Disc.ADAPTOR[0], "--", *Disc.ADAPTOR[1:]),
            **{**disc.environment, "ROBOCORBA_NAMING": str(system.naming), "ROBOCORBA_STATE": str(tmp_path / "state")},
        )
        assert process.stdout and process.stdout.readline() == "ready\n", process.communicate(timeout=PATIENCE_S)[1]
        return process

    return start


#: Nodes that end while callbacks run; it prints a line where one of their threads ended the process.
MANY_NODES = """
import sys, time
from std_msgs.msg import String
from robocorba.bridges.ros2 import node, ros_node
node.end_process = print
for _ in range(60):
    each = ros_node(int(sys.argv[1]), "short_lived")
    publisher = each.node.create_publisher(String, "text", 10)
    each.node.create_subscription(String, "text", lambda message: None, 10)
    each.node.create_timer(0.001, lambda: publisher.publish(String(data="x")))
    each.start()
    time.sleep(0.02)
    each.close()
"""


def test_nodes_end_while_callbacks_run(domain: int, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": python_path(), "ROS_LOG_DIR": str(tmp_path)}
    command = (PYTHON, "-c", MANY_NODES, str(domain))
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=PATIENCE_S)
    assert (ran.returncode, ran.stdout) == (0, ""), ran.stderr


def test_programs_drive_a_robot_that_speaks_ros_2(
    start_agent: Callable[..., Any], system_orb: Orb, domain: int, launch: Launcher, tmp_path: Path
) -> None:
    """By its odometry, up to a wall that only its own laser sees; and it is stopped once it is silent."""
    disc = Disc(launch, PYTHON, tmp_path, domain, "3.0")
    process, agent, where = start_agent(disc), RemoteAgent(system_orb, "C"), disc.where
    assert run(agent, ProgramBuilder("there and back").mbase_by(ahead=1.0).mbase_path("L1", 4.0, 3.0)).reason == ""
    eventually(lambda: where[-1][:2] == pytest.approx((1.0, 1.0), abs=0.02), PATIENCE_S, "where it says it is")
    run(agent, ProgramBuilder("turn").mbase_path("L1", 3.0, 2.0).mbase_to(3.0, 2.0, 0.0))
    report = run(agent, ProgramBuilder("too far").mbase_by(ahead=4.0))
    assert report.result is ProgramResult.FAILED and "laser sees something" in report.reason
    assert 0.05 <= 3.0 - RADIUS_M - max(x for x, _, _ in where) < 0.3
    disc.process.send_signal(signal.SIGSTOP)
    eventually(lambda: agent.state().condition is AgentCondition.STOPPED, PATIENCE_S, "it is lost")
    assert "its odometry has been silent" in agent.state().reason
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0


def seconds(stamp: Any) -> float:
    return float(stamp["sec"] + stamp["nanosec"] * 1e-9)


def position(odometry: Any) -> tuple[float, float]:
    at = odometry["pose"]["pose"]["position"]
    return at["x"], at["y"]


def is_idle(agent: RemoteAgent) -> bool:
    return agent.state().condition is AgentCondition.IDLE


def wait_status(ros: Ros, name: str, message: str) -> Any:
    """The diagnostics of a robot once they say something."""

    def found() -> Any:
        rows = (ros.last("/diagnostics") or {"status": []})["status"]
        return next((row for row in rows if (row["name"], row["message"]) == (name, message)), None)

    return eventually(found, PATIENCE_S, f"{name} {message}")


def see_robots(ros: Ros) -> None:
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
    wait_status(ros, "A", "waiting for an order")


def see_edits(ros: Ros, system_orb: Orb) -> None:
    def occupied() -> int:
        return int(ros.last("/map")["data"].count(100))

    before = occupied()
    editor = system_orb.resolve("MapEditor", RoboCorba.MapEditor, PATIENCE_S)
    version = editor.create("L1", maps.element(Wall("new", (1.0, 1.0), (3.0, 1.0))))
    eventually(lambda: occupied() > before + 30, PATIENCE_S, "a map with the wall")
    editor.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L1", "new"), version)
    eventually(lambda: occupied() == before, PATIENCE_S, "a map without it")


def see_frames(ros: Ros) -> None:
    """From the map to robots. Links are published once a second, so one message does not have all."""

    def frames() -> set[tuple[str, str]]:
        messages = [each for _, each in ros.messages(topic="/tf", last=60)] + [ros.last("/tf_static")]
        found = [each for message in filter(None, messages) for each in message["transforms"]]
        return {(each["header"]["frame_id"], each["child_frame_id"]) for each in found}

    wanted = {("map", "floor/L2"), ("map", "A/odom"), ("map", "B/odom"), ("A/odom", "A/base_link")}
    eventually(lambda: wanted <= frames(), PATIENCE_S, "frames")
    eventually(lambda: {"A/left_hand", "B/right_finger", "A/laser"} <= {child for _, child in frames()}, PATIENCE_S)


def drive_by_cmd_vel(ros: Ros, agent: RemoteAgent) -> None:
    """It stops without."""
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


def drive_to_goals(ros: Ros, agent: RemoteAgent) -> None:
    """A new one replaces the one before."""
    eventually(lambda: ros.subscribers(topic="/A/goal_pose"), PATIENCE_S, "subscription")

    def go(frame: str, x: float, y: float, up: float = 1.0) -> None:
        goal = {"header.frame_id": frame, "pose.position.x": x, "pose.position.y": y, "pose.orientation.w": up}
        ros.publish(topic="/A/goal_pose", type="geometry_msgs/msg/PoseStamped", message=goal)

    def wait_log(text: str) -> None:
        def is_said() -> bool:
            return any(text in message["msg"] for _, message in ros.messages(topic="/rosout", last=60))

        eventually(is_said, PATIENCE_S, text)

    ros.subscribe(topic="/rosout", type="rcl_interfaces/msg/Log")
    go("map", 2.0, 2.0, up=0.0)
    wait_log("the orientation (0, 0, 0, 0) is no rotation")
    go("map", 2.0, 2.0)
    eventually(lambda: agent.state().program.name == "goal_pose", PATIENCE_S, "drive")
    agent.abort()
    wait_log("goal L1:2.00,2.00 was not reached: aborted")
    go("map", 2.0, 2.0)
    eventually(lambda: not is_idle(agent), PATIENCE_S, "drive")
    go("floor/L1", 5.0, 4.0)
    eventually(
        lambda: (
            (state := agent.state()).program.result is ProgramResult.DONE
            and math.dist((state.at.x, state.at.y), (5.0, 4.0)) < 0.01
        ),
        PATIENCE_S,
        "second goal",
    )
    go("A/base_link", 0.5, 0.0)
    eventually(lambda: agent.state().at.x > 5.49 and is_idle(agent), PATIENCE_S, "goal ahead of the robot")


def run_programs(ros: Ros, agent: RemoteAgent) -> None:
    """They are loaded, run, paused and aborted."""
    for text, why in (("{", "not JSON"), ('{"name": "x", "icons": [{}]}', "icons[0]")):
        done, reason = ros.set_parameter(node="robocorba", name="B.program", text=text)
        assert not done and why in reason
    assert ros.trigger(service="/B/run_program") == [False, "can't run a program: the robot has none loaded"]
    assert ros.set_parameter(node="robocorba", name="B.program", text=program.dumps(WAITING)) == [True, ""]
    assert ros.trigger(service="/B/run_program") == [True, ""]
    assert agent.state().condition is AgentCondition.RUNNING
    twist = {"linear.x": 0.2}
    ros.publish(topic="/B/cmd_vel", type="geometry_msgs/msg/Twist", message=twist)  # refused, with a warning
    assert ros.trigger(service="/B/pause") == [True, ""]
    assert agent.state().condition is AgentCondition.PAUSED
    assert ros.trigger(service="/B/resume") == [True, ""]
    wait_status(ros, "B", "waiting for 60 s")
    assert ros.trigger(service="/B/stop") == [True, ""]
    assert wait_status(ros, "B", "stopped: emergency stop")["level"] == [2]
    assert ros.trigger(service="/B/reset_stop") == [True, ""]
    assert ros.trigger(service="/B/abort") == [True, ""]
    eventually(lambda: is_idle(agent), PATIENCE_S, "end")


def see_options(ros: Ros, agent: RemoteAgent) -> None:
    """Of the second bridge: frames in namespaces, another floor and resolution, and velocities with a stamp."""
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
        return bool(agent.state().actor.velocity[2] == pytest.approx(0.2, abs=0.01))

    eventually(turns, PATIENCE_S, "turn")

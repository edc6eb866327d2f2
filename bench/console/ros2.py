"""ROS 2 beside many driving robots: rates, ages and processor time of the bridge; orders beside direct calls.

    python -m bench.console.ros2 [--seconds 20] [--robots 20] [--orders-each 20]

A crowd of robots drives in the simulation, and one robot process stands. A foreign node of ROS subscribes to odometry
and scans of all of them. The age of a message is the time from the moment of its simulated time, as a sampling client
of the simulation has it, until the node has it; beside it the age of what a client of the Omni database gets that asks
as often. Eight robots scan themselves ten times a second; sensors report these scans ten times a second too, and of
each robot the last one, so that some are not seen. An order's latency is the time from the call or the publication
until the robot's own state shows that its base turns. Without ROS 2 it measures nothing; `make ros2` makes a
Python that has it."""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.common.harness import NotMeasured, progress, run
from bench.console.crowd import FLOOR, Clock, crowded_system
from robocorba.orb.naming import Address
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.simulation.corba.remote_database import RemoteFloors
from robocorba.system.plain_names import plain_name
from testkit.generated_buildings import office
from testkit.generated_buildings import robots as robots_in
from testkit.json_process import Cpu, Process
from testkit.processes import ROBOCORBA
from testkit.report import at_least, at_most, bars, summarize
from testkit.ros2_environment import python_path, ros2_python

NAME = "console_ros2"
#: The robot that gets orders, the ROS domain of this bench, and the velocity of its turns [rad/s].
ROBOT, DOMAIN, TURN = "Z", 97, 0.3
#: Time before each measurement, between orders, and at most until an order is executed [s].
SETTLE_S, REST_S, ORDER_LIMIT_S = 3.0, 1.0, 5.0
START_LIMIT_S = 120.0


@contextlib.contextmanager
def bridge(naming: Address, python: str, folder: Path) -> Iterator[tuple[int, Process]]:
    """A running bridge: its process id, and a foreign node."""
    environment = {"PYTHONPATH": python_path(), "ROS_DOMAIN_ID": str(DOMAIN), "ROS_LOG_DIR": str(folder)}
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    command = (python, "-m", "robocorba", "ros2", "--naming", str(naming))
    with contextlib.ExitStack() as closing:
        process = Process(command, folder / "bridge.log", (), environment)
        closing.callback(process.kill)
        process.read_line(START_LIMIT_S)
        node = Process((python, "-m", "testkit.ros2_listener"), folder / "node.log", (), environment)
        closing.callback(node.kill)
        node.receive(START_LIMIT_S)
        yield process.pid, node


@contextlib.contextmanager
def robot(naming: Address, folder: Path) -> Iterator[None]:
    """A robot process, on a floor without the crowd."""
    at = next(about.pose for about in robots_in(office(), 100) if about.pose.floor != FLOOR)
    place = ["--floor", at.floor, "--at", f"{at.x},{at.y}"]
    command = [ROBOCORBA, "robot", ROBOT, *place, "--naming", str(naming), "--state", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.terminate()


def ages(found: list[list[float]], clock: Clock) -> np.ndarray:
    """Ages [s] of messages, given their times of arrival and simulated times."""
    arrived, stamps = np.array(found).T
    return arrived - clock.at(stamps)


def direct_ages(orb: Orb, clock: Clock, seconds: float) -> np.ndarray:
    """Ages [s] of what a client of the Omni database gets that asks 20 times a second."""
    floors, found = RemoteFloors(orb, [FLOOR]), []
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        for update in floors.follow(1.0):
            found.append([time.time(), update.time])
        time.sleep(0.05)
    time.sleep(0.5)  # the clock has samples from before and after
    return ages(found, clock)


def latency(agent: RemoteAgent, give: Callable[[float], float]) -> float:
    """Time [s] from an order until the base turns. give: orders a turn [rad/s], returns when."""
    while abs(agent.state().actor.velocity[2]) > 0.01:
        time.sleep(0.05)
    time.sleep(REST_S)
    turned_at: list[float] = []

    def watch() -> None:
        until = time.monotonic() + ORDER_LIMIT_S
        while not turned_at and time.monotonic() < until:
            if abs(agent.state().actor.velocity[2]) > 0.01:
                turned_at.append(time.time())

    watcher = threading.Thread(target=watch)
    watcher.start()
    began = give(TURN)
    watcher.join()
    give(0.0)
    return turned_at[0] - began if turned_at else ORDER_LIMIT_S


def orders(orb: Orb, node: Process, count: int) -> dict[str, list[float]]:
    """Latencies [s] of orders by ROS and by direct calls, in turns."""
    agent = RemoteAgent(orb, ROBOT, START_LIMIT_S)

    def call(turn: float) -> float:
        at_s = time.time()
        agent.drive((0.0, 0.0, turn), 0.5)
        return at_s

    def publish(turn: float) -> float:
        asked = {"do": "publish", "topic": f"/{ROBOT}/cmd_vel", "type": "geometry_msgs/msg/Twist"}
        return float(node.ask({**asked, "message": {"angular.z": turn}}))

    found: dict[str, list[float]] = {"cmd_vel": [], "direct call": []}
    publish(0.0)
    time.sleep(SETTLE_S)  # both have found each other
    for _ in progress(range(count), "orders"):
        found["cmd_vel"].append(latency(agent, publish))
        found["direct call"].append(latency(agent, call))
    return found


def measure(seconds: float = 20.0, robots: int = 20, orders_each: int = 20) -> bool:
    python = ros2_python()
    if not python:
        raise NotMeasured("ROS 2 is not installed; see make ros2")
    with contextlib.ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-bench-")))
        naming, clock, orb = closing.enter_context(crowded_system(folder, robots))
        closing.enter_context(robot(naming, folder / "robot"))
        RemoteAgent(orb, ROBOT, START_LIMIT_S)
        since = len(clock.samples) - 1
        directly_s = direct_ages(orb, clock, seconds)
        alone = clock.pace(since)
        pid, node = closing.enter_context(bridge(naming, python, folder))
        for topic, kind in (("odom", "nav_msgs/msg/Odometry"), ("scan", "sensor_msgs/msg/LaserScan")):
            for name in [*_names(orb), ROBOT]:
                node.ask({"do": "subscribe", "topic": f"/{plain_name(name)}/{topic}", "type": kind})
        time.sleep(SETTLE_S)
        before, cpu, since = node.ask({"do": "counts"}), Cpu([pid]), len(clock.samples) - 1
        time.sleep(seconds)
        after, cores = node.ask({"do": "counts"}), cpu.spent_s()[0] / seconds
        pace = clock.pace(since)
        odometry_s = ages(node.ask({"do": "arrivals", "topic": f"/{ROBOT}/odom"}), clock)
        found = orders(orb, node, orders_each)
    rates = {topic: (after[topic] - before.get(topic, 0)) / seconds for topic in after}
    odom, scan = ([rate for topic, rate in rates.items() if topic.endswith(each)] for each in ("/odom", "/scan"))
    medians = {what: float(np.median(each)) for what, each in found.items()}
    rows = [
        {"what": "odometry of a robot, 1/s", "median": float(np.median(odom)), "least": min(odom)},
        {"what": "scans of a robot, 1/s", "median": float(np.median(scan)), "least": min(scan)},
        {"what": "age of odometry, ms", "median": float(np.median(odometry_s)) * 1e3, "most": max(odometry_s) * 1e3},
        {
            "what": "age of direct reads, ms",
            "median": float(np.median(directly_s)) * 1e3,
            "most": max(directly_s) * 1e3,
        },
        *(
            {"what": f"{what} to motion, ms", "median": medians[what] * 1e3, "most": max(found[what]) * 1e3}
            for what in found
        ),
        {"what": "bridge, share of a core", "median": cores},
    ]
    marks = [
        at_least("odometry of a robot each second", min(odom), 15.0),
        at_least("scans of a robot each second, median", float(np.median(scan)), 9.0),
        at_least("scans of a robot each second, least", min(scan), 7.0),
        at_most(
            "cmd_vel to motion beside a direct call, ms more", (medians["cmd_vel"] - medians["direct call"]) * 1e3, 20.0
        ),
        at_least("pace beside that without ROS", pace / alone, 0.98),
    ]
    columns = list(dict.fromkeys(column for row in rows for column in row))
    table = [{column: row.get(column) for column in columns} for row in rows]
    picture = bars({what: median * 1e3 for what, median in medians.items()}, "order to motion, ms")
    return summarize(NAME, f"ROS 2 beside {robots} driving robots", table, marks, picture)


def _names(orb: Orb) -> list[str]:
    """The robots on the floor."""
    (update,) = RemoteFloors(orb, [FLOOR]).follow(START_LIMIT_S)
    return [body.name for body in update.came if body.name != ROBOT and not body.outline]


if __name__ == "__main__":
    run(measure, seconds="of each measurement", robots="that drive on one floor", orders_each="by ROS, and directly")

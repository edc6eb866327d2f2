"""ROS 2 beside many driving robots: rates, ages and processor time of the bridge; orders beside direct calls.

    python -m bench.console.ros2 [--seconds 10] [--robots 20] [--orders-each 10]

A crowd of robots drives in the simulation, and one robot process stands. A foreign node of ROS subscribes to odometry
and scans of all of them. The age of a message is the time from the moment of its simulated time, as a sampling client
of the simulation has it, until the node has it; beside it the age of what a client of the Omni database gets that asks
as often. Eight robots scan themselves ten times a second; sensors report these scans ten times a second too, and of
each robot the last one, so that some are not seen. An order's latency is the time from the call or the publication
until the robot's own state shows that its base turns. Without ROS 2 it measures nothing; `make ros2` makes a
Python that has it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

import numpy as np

from bench.common.harness import NotMeasured, System, progress, run, sampled
from bench.console.crowd import FLOOR, Crowd, crowded_system
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.simulation.corba.remote_database import RemoteFloors
from robocorba.system.plain_names import plain_name
from testkit.generated_buildings import office
from testkit.generated_buildings import robots as robots_in
from testkit.json_process import Process
from testkit.processes import ROBOCORBA, drain, eventually
from testkit.report import at_least, at_most, summarize, summary
from testkit.ros2_environment import python_path, ros2_python

#: The robot that gets orders, the ROS domain of this bench, and the velocity of its turns [rad/s].
ROBOT, DOMAIN, TURN = "Z", 97, 0.3
#: Time before each measurement, between orders, and at most until an order is executed [s].
SETTLE_S, REST_S, ORDER_LIMIT_S = 3.0, 1.0, 5.0
START_LIMIT_S = 120.0


@contextlib.contextmanager
def bridge(place: System, python: str) -> Iterator[tuple[int, Process]]:
    """A running bridge: its process id, and a foreign node."""
    folder = place.folder
    environment = {"PYTHONPATH": python_path(), "ROS_DOMAIN_ID": str(DOMAIN), "ROS_LOG_DIR": str(folder)}
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    command = (python, "-m", "robocorba", "ros2", "--naming", str(place.orb.naming))
    with contextlib.ExitStack() as closing:
        process = Process(command, folder / "bridge.log", (), environment)
        closing.callback(process.kill)
        process.read_line(START_LIMIT_S)
        node = Process((python, "-m", "testkit.ros2_listener"), folder / "node.log", (), environment)
        closing.callback(node.kill)
        node.receive(START_LIMIT_S)
        yield process.pid, node


def start_robot(crowd: Crowd) -> RemoteAgent:
    """A robot process, on a floor without the crowd."""
    at = next(about.pose for about in robots_in(office(), 100) if about.pose.floor != FLOOR)
    where = ("--floor", at.floor, "--at", f"{at.x},{at.y}", "--naming", str(crowd.place.orb.naming))
    drain(crowd.place.launch(ROBOCORBA, "robot", ROBOT, *where, "--state", str(crowd.place.folder / "robot")))
    return RemoteAgent(crowd.place.orb, ROBOT, START_LIMIT_S)


def ages_ms(found: list[list[float]], crowd: Crowd) -> list[float]:
    """Ages [ms] of messages, given their times of arrival and simulated times."""
    arrived, stamps = np.array(found).T
    return list(1e3 * (arrived - crowd.at(stamps)))


def direct_ages_ms(crowd: Crowd, seconds: float) -> list[float]:
    """Ages [ms] of what a client of the Omni database gets that asks 20 times a second."""
    floors, found = RemoteFloors(crowd.place.orb, [FLOOR]), []
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        for update in floors.follow(1.0):
            found.append([time.time(), update.time])
        time.sleep(0.05)
    time.sleep(0.5)  # the clock has samples from before and after
    return ages_ms(found, crowd)


def latency_ms(agent: RemoteAgent, give: Callable[[float], float]) -> float:
    """Time [ms] from an order until the base turns. give: orders a turn [rad/s], returns when."""

    def is_turning() -> bool:
        return abs(agent.state().actor.velocity[2]) > 0.01

    eventually(lambda: not is_turning(), ORDER_LIMIT_S, "a base that stands")
    time.sleep(REST_S)
    with sampled(is_turning, 0.0) as samples:
        began = give(TURN)
        eventually(lambda: any(turns for _, turns in list(samples)), ORDER_LIMIT_S, "a base that turns")
    give(0.0)
    turned_at = next(at for at, turns in samples if turns)
    return 1e3 * (turned_at - began)


def orders(crowd: Crowd, agent: RemoteAgent, node: Process, count: int) -> dict[str, list[float]]:
    """Latencies [ms] of orders by ROS and by direct calls, in turns."""

    def call(turn: float) -> float:
        at_s = time.monotonic()
        agent.drive((0.0, 0.0, turn), 0.5)
        return at_s

    def publish(turn: float) -> float:
        asked = {"do": "publish", "topic": f"/{ROBOT}/cmd_vel", "type": "geometry_msgs/msg/Twist"}
        return float(node.ask({**asked, "message": {"angular.z": turn}})) - time.time() + time.monotonic()

    found: dict[str, list[float]] = {"cmd_vel": [], "direct call": []}
    publish(0.0)
    time.sleep(SETTLE_S)  # both have found each other
    for _ in progress(range(count), "orders"):
        found["cmd_vel"].append(latency_ms(agent, publish))
        found["direct call"].append(latency_ms(agent, call))
    return found


def measure(seconds: float = 10.0, robots: int = 20, orders_each: int = 10) -> bool:
    python = ros2_python()
    if not python:
        raise NotMeasured("ROS 2 is not installed; see make ros2")
    with crowded_system(robots) as crowd, contextlib.ExitStack() as closing:
        agent = start_robot(crowd)
        alone = crowd.measured(seconds)
        direct_ms = direct_ages_ms(crowd, seconds)
        pid, node = closing.enter_context(bridge(crowd.place, python))
        for topic, kind in (("odom", "nav_msgs/msg/Odometry"), ("scan", "sensor_msgs/msg/LaserScan")):
            for name in [*_names(crowd.place.orb), ROBOT]:
                node.ask({"do": "subscribe", "topic": f"/{plain_name(name)}/{topic}", "type": kind})
        time.sleep(SETTLE_S)
        before = node.ask({"do": "counts"})
        bridged = crowd.measured(seconds, pid)
        after = node.ask({"do": "counts"})
        odometry_ms = ages_ms(node.ask({"do": "arrivals", "topic": f"/{ROBOT}/odom"}), crowd)
        found = orders(crowd, agent, node, orders_each)
    rates = {topic: (after[topic] - before.get(topic, 0)) / seconds for topic in after}
    odom, scan = ([rate for topic, rate in rates.items() if topic.endswith(each)] for each in ("/odom", "/scan"))
    samples = {"odometry of a robot, 1/s": odom, "scans of a robot, 1/s": scan, "age of odometry, ms": odometry_ms}
    samples |= {"age of direct reads, ms": direct_ms, "bridge, share of a core": [bridged["cores"]]}
    samples |= {f"{what} to motion, ms": each for what, each in found.items()}
    rows = [
        {"what": what, **summary(each, "median", worst="most"), "least": min(each)} for what, each in samples.items()
    ]
    medians = {what: float(np.median(each)) for what, each in found.items()}
    more_ms = medians["cmd_vel"] - medians["direct call"]
    marks = [
        at_least("odometry of a robot each second", min(odom), 15.0),
        at_least("scans of a robot each second, median", float(np.median(scan)), 9.0),
        at_least("scans of a robot each second, least", min(scan), 7.0),
        at_most("cmd_vel to motion beside a direct call, ms more", more_ms, 20.0),
        at_least("pace beside that without ROS", bridged["pace"] / alone["pace"], 0.98),
    ]
    return summarize("console_ros2", f"ROS 2 beside {robots} driving robots", rows, marks, samples)


def _names(orb: Orb) -> list[str]:
    """The robots on the floor."""
    (update,) = RemoteFloors(orb, [FLOOR]).follow(START_LIMIT_S)
    return [body.name for body in update.came if body.name != ROBOT and not body.outline]


if __name__ == "__main__":
    run(measure, seconds="of each measurement", robots="that drive on one floor", orders_each="by ROS, and directly")

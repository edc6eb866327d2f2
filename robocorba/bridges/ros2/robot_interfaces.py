"""The interfaces of all robots in ROS, and their diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

from robocorba.bridges.ros2.diagnostics import lost_status, robot_status, system_status
from robocorba.bridges.ros2.frames import Frames
from robocorba.bridges.ros2.goals import goal_in_building
from robocorba.bridges.ros2.messages import Messages
from robocorba.bridges.ros2.node import RosNode, RosTopics
from robocorba.bridges.ros2.publisher import RosPublisher
from robocorba.bridges.ros2.robot_interface import RobotInterface
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import RemoteAgent, robots
from robocorba.robot.corba.robot_orders import RobotOrders
from robocorba.system.repeating import Repeating


class RobotInterfaces:
    """Makes interfaces of robots that come, closes those of robots that leave, and publishes `/diagnostics`, until
    `close`."""

    def __init__(self, orb: Orb, node: RosNode, publisher: RosPublisher, frames: Frames, is_stamped: bool) -> None:
        self._orb, self._node, self._publisher = orb, node, publisher
        self._frames, self._is_stamped = frames, is_stamped
        self._robots: dict[str, tuple[RobotOrders, RobotInterface]] = {}
        #: Why the system can't be followed at present.
        self._problem = ""
        self._topics = RosTopics(node)  # the publisher's are for its own thread
        self._messages = Messages(self._topics)
        self._diagnostics = Repeating("diagnostics", self._diagnose, 1.0).start()

    def close(self) -> None:
        self._diagnostics.close()
        self.update(())

    def update(self, names: Collection[str]) -> None:
        """These robots are there now."""
        for name in self._robots.keys() - set(names):
            _, interface = self._robots.pop(name)
            interface.close()
        for name in names:
            if name not in self._robots:
                orders = RobotOrders(name, partial(RemoteAgent, self._orb, name, 1.0), self._node.warn)
                robot = self._publisher.names[name]
                interface = RobotInterface(self._node, robot, orders, self._goal_of(name, robot), self._is_stamped)
                self._robots = {**self._robots, name: (orders, interface)}  # for the other thread

    def note(self, problem: str) -> None:
        """Show why the system can't be followed, empty if it can; say so when that changes."""
        if problem != self._problem:
            self._problem = problem
            self._node.warn(problem) if problem else self._node.info("the system answers again")

    def _goal_of(self, name: str, robot: str) -> Callable[[str, float, float, float], Pose]:
        def goal(frame: str, x: float, y: float, heading: float) -> Pose:
            place = self._publisher.places[1].get(name)
            if place is None:
                raise RobotError(f"{name} is not there")
            return goal_in_building(frame, x, y, heading, place, self._frames, robot, self._publisher.floor_frames)

        return goal

    def _diagnose(self) -> None:
        statuses = [system_status(self._messages, self._problem)]
        try:
            agents = set(robots(self._orb))
        except NotReachable:
            agents = set()
        for name, (orders, _) in self._robots.items():
            if name not in agents:
                statuses.append(lost_status(self._messages, name, "no control agent is bound"))
                continue
            try:
                statuses.append(robot_status(self._messages, *orders.look()))
            except RoboCorbaError as error:
                statuses.append(lost_status(self._messages, name, str(error)))
        message = self._messages.statuses(self._publisher.time_s, statuses)
        self._topics.publish("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", message, self._publisher.time_s)

"""What a robot takes from ROS: velocities, goals, and services for its program.

| name | type | |
|---|---|---|
| `/ROBOT/cmd_vel` | geometry_msgs/msg/Twist, or TwistStamped | drive at a velocity for 0.5 s |
| `/ROBOT/goal_pose` | geometry_msgs/msg/PoseStamped | drive to a pose by the path planning agent |
| `/ROBOT/run_program` | std_srvs/srv/Trigger | run the loaded program |
| `/ROBOT/pause`, `/ROBOT/resume`, `/ROBOT/abort` | std_srvs/srv/Trigger | the running program |
| `/ROBOT/stop`, `/ROBOT/reset_stop` | std_srvs/srv/Trigger | emergency stop, and its end |
| parameter `ROBOT.program` | string | a program in JSON, which is checked and loaded |"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from robocorba.bridges.ros2.messages import heading_of
from robocorba.bridges.ros2.node import RosNode, message_type
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.corba.robot_orders import RobotOrders

#: Services without arguments, and what they order.
SERVICES: dict[str, Callable[[RobotOrders], None]] = {
    "run_program": RobotOrders.run,
    "pause": lambda orders: orders.order(RemoteAgent.pause),
    "resume": lambda orders: orders.order(RemoteAgent.resume),
    "abort": lambda orders: orders.order(RemoteAgent.abort),
    "stop": lambda orders: orders.order(RemoteAgent.stop),
    "reset_stop": lambda orders: orders.order(RemoteAgent.reset_stop),
}
#: A pose x, y [m], heading [rad] in a frame, as one in the building; raises RobotError.
Goal = Callable[[str, float, float, float], Pose]


class RobotInterface:
    """Subscriptions and services of one robot until `close`. name: the robot's in ROS. is_stamped: whether velocities
    are TwistStamped."""

    def __init__(self, node: RosNode, name: str, orders: RobotOrders, goal: Goal, is_stamped: bool) -> None:
        self._node, self._name, self._orders, self._goal, self._is_stamped = node, name, orders, goal, is_stamped
        topics, services = MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()
        newest = QoSProfile(depth=1)
        velocity = message_type(f"geometry_msgs/msg/{'TwistStamped' if is_stamped else 'Twist'}")
        target = message_type("geometry_msgs/msg/PoseStamped")
        trigger = message_type("std_srvs/srv/Trigger")
        ros = node.node
        self._subscriptions = [
            ros.create_subscription(velocity, f"/{name}/cmd_vel", self._drive, newest, callback_group=topics),
            ros.create_subscription(target, f"/{name}/goal_pose", self._drive_to, newest, callback_group=topics),
        ]
        self._services = [
            ros.create_service(trigger, f"/{name}/{service}", self._answering(order), callback_group=services)
            for service, order in SERVICES.items()
        ]
        ros.declare_parameter(f"{name}.program", "")
        ros.add_on_set_parameters_callback(self._load)

    def close(self) -> None:
        ros = self._node.node
        ros.remove_on_set_parameters_callback(self._load)
        for subscription in self._subscriptions:
            ros.destroy_subscription(subscription)
        for service in self._services:
            ros.destroy_service(service)
        ros.undeclare_parameter(f"{self._name}.program")
        self._orders.close()

    def _drive(self, message: Any) -> None:
        twist = message.twist if self._is_stamped else message
        self._orders.drive((twist.linear.x, twist.linear.y, twist.angular.z))

    def _drive_to(self, message: Any) -> None:
        at, turn = message.pose.position, message.pose.orientation
        try:
            heading = heading_of(turn.x, turn.y, turn.z, turn.w)
            self._orders.drive_to(self._goal(message.header.frame_id, at.x, at.y, heading))
        except RoboCorbaError as error:
            self._node.warn(f"{self._orders.name}: goal_pose: {error}")

    def _answering(self, order: Callable[[RobotOrders], None]) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                order(self._orders)
                response.success, response.message = True, ""
            except RoboCorbaError as error:
                response.success, response.message = False, str(error)
            return response

        return answer

    def _load(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == f"{self._name}.program" and parameter.value:
                try:
                    self._orders.load(str(parameter.value))
                except RoboCorbaError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

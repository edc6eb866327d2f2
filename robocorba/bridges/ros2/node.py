"""A node of ROS 2, by rclpy of the installed ROS: Jazzy and later."""

from __future__ import annotations

import array
import threading
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from robocorba.errors.services import ServiceError
from robocorba.system.background import Background, end_process
from robocorba.system.settings import limit_ros_discovery

#: Timeout for the end of the node's thread [s].
END_TIMEOUT_S = 5.0


class RosNode:
    """A node on the network from its construction until `close`: of this machine only, unless the environment has
    another ROS_AUTOMATIC_DISCOVERY_RANGE.

    domain: None for the environment's ROS_DOMAIN_ID. Raises ServiceError."""

    def __init__(self, domain: int | None, name: str) -> None:
        limit_ros_discovery()
        self.context = rclpy.Context()
        try:
            rclpy.init(context=self.context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
            self.node = Node(name, context=self.context)
        except Exception as error:  # rclpy passes on what its layers raise
            raise ServiceError(f"ROS 2 can't be started: {error}") from None
        # Threads for orders and services, which may wait for robots for seconds.
        self._executor = MultiThreadedExecutor(16, context=self.context)
        self._executor.add_node(self.node)
        self._is_closed = threading.Event()
        self._thread = Background("ROS 2", self._spin, end_process)

    @property
    def domain(self) -> int:
        """The ROS domain."""
        return int(self.context.get_domain_id())

    def start(self) -> None:
        """Begin with subscriptions and services."""
        self._thread.start()

    def close(self) -> None:
        """Leave the network."""
        self._is_closed.set()
        if self._thread.ident is not None:
            self._executor.create_task(lambda: None)  # wakes it
            self._thread.join(END_TIMEOUT_S)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _spin(self) -> None:
        """Until `close`. `shutdown` of an executor is left out: a callback that ends after it raises, and a spin that
        it overtakes (ros2/rclpy#968)."""
        while not self._is_closed.is_set():
            self._executor.spin_once()

    def warn(self, text: str) -> None:
        self.node.get_logger().warning(text)

    def info(self, text: str) -> None:
        self.node.get_logger().info(text)


@cache
def message_type(name: str) -> Any:
    """The class of a type such as std_msgs/msg/String. Raises ImportError if its package is not installed."""
    package, kind, message = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), message)


class RosTopics:
    """Topics of a node (robocorba.bridges.ros2.messages.Topics). Not thread-safe. Messages whose package is not
    installed are None; their topics are left out, with a warning."""

    def __init__(self, node: RosNode) -> None:
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._left_out: set[str] = set()

    def make(self, name: str, /, **fields: Any) -> Any:
        try:
            return message_type(name)(**fields)
        except ImportError:
            return None

    def array(self, values: np.ndarray) -> Any:
        found = array.array(values.dtype.char)
        found.frombytes(values.tobytes())
        return found

    def publish(self, topic: str, type: str, message: Any, time_s: float, is_latched: bool = False) -> None:
        if message is None:
            if topic not in self._left_out:
                self._left_out.add(topic)
                self._node.warn(f"{topic} is left out: {type.partition('/')[0]} is not installed")
            return
        if topic not in self._publishers:
            qos = QoSProfile(depth=1 if is_latched else 10)  # messages that are kept for slow subscribers
            if is_latched:
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            self._publishers[topic] = self._node.node.create_publisher(message_type(type), topic, qos)
        self._publishers[topic].publish(message)

    def close(self, topic: str) -> None:
        if publisher := self._publishers.pop(topic, None):
            self._node.node.destroy_publisher(publisher)

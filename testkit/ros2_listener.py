"""A node of ROS 2 that knows nothing of RoboCorba, in a process of its own: it answers lines of JSON.

    python -m testkit.ros2_listener

It runs in a Python with ROS 2, see ros2_environment."""

from __future__ import annotations

import array
import threading
import time
from collections import defaultdict, deque
from importlib import import_module
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from testkit.json_process import answer_commands

#: Messages that are kept for each topic.
KEPT = 2000
#: Time limit for an answer of a service [s].
ANSWER_LIMIT_S = 45.0


class Listener:
    """Commands of the process."""

    def __init__(self) -> None:
        rclpy.init()
        self._node = rclpy.create_node("listener")
        self._messages: dict[str, deque[tuple[float, Any]]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._counts: dict[str, int] = defaultdict(int)
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        threading.Thread(target=self._executor.spin, daemon=True).start()

    def subscribe(self, topic: str, type: str, latched: bool = False, best_effort: bool = False) -> None:
        qos = QoSProfile(depth=100)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        if best_effort:
            qos.reliability = ReliabilityPolicy.BEST_EFFORT

        def keep(message: Any) -> None:
            self._messages[topic].append((time.time(), message))
            self._counts[topic] += 1

        self._node.create_subscription(_type(type), topic, keep, qos)

    def counts(self) -> dict[str, int]:
        """Messages received, by topic."""
        return dict(self._counts)

    def messages(self, topic: str, last: int = 1) -> list[Any]:
        """The last messages, each with the time of its arrival [s]."""
        return [[at_s, _plain(message)] for at_s, message in list(self._messages[topic])[-last:]]

    def arrivals(self, topic: str) -> list[list[float]]:
        """Times of arrival [s] of the kept messages, each with the time in its header [s]."""
        return [[at_s, _seconds(message.header.stamp)] for at_s, message in list(self._messages[topic])]

    def publish(self, topic: str, type: str, message: dict[str, Any]) -> float:
        """Returns the time just before [s]."""
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(_type(type), topic, 1)
        made, at_s = _message(type, message), time.time()
        self._publishers[topic].publish(made)
        return at_s

    def subscribers(self, topic: str) -> int:
        """Subscriptions to a topic that this node has found."""
        return int(self._node.count_subscribers(topic))

    def topics(self) -> dict[str, list[str]]:
        """The types of all topics."""
        return dict(self._node.get_topic_names_and_types())

    def trigger(self, service: str) -> list[Any]:
        """Call a std_srvs/srv/Trigger: success and message."""
        trigger = import_module("std_srvs.srv").Trigger
        response = self._call(service, trigger, trigger.Request())
        return [response.success, response.message]

    def set_parameter(self, node: str, name: str, text: str) -> list[Any]:
        """Set a text: success and reason."""
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)
        kind = import_module("rcl_interfaces.srv").SetParameters
        request = kind.Request(parameters=[Parameter(name=name, value=value)])
        (result,) = self._call(f"/{node}/set_parameters", kind, request).results
        return [result.successful, result.reason]

    def _call(self, name: str, kind: Any, request: Any) -> Any:
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self._node.create_client(kind, name)
        assert client.wait_for_service(ANSWER_LIMIT_S), f"there is no service {name}"
        future = client.call_async(request)
        answered = threading.Event()
        future.add_done_callback(lambda _: answered.set())
        assert answered.wait(ANSWER_LIMIT_S), f"{name} does not answer"
        return future.result()


def _type(name: str) -> Any:
    package, kind, message = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), message)


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


def _message(type: str, fields: dict[str, Any]) -> Any:
    """A message with these fields, others as they are by default; fields of fields by dots."""
    message = _type(type)()
    for path, value in fields.items():
        *parents, name = path.split(".")
        target = message
        for parent in parents:
            target = getattr(target, parent)
        setattr(target, name, value)
    return message


def _plain(value: Any) -> Any:
    """A message as values of JSON; infinite numbers as texts."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, array.array | np.ndarray | list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value


if __name__ == "__main__":
    listener = Listener()
    answer_commands(
        *(listener.subscribe, listener.counts, listener.messages, listener.arrivals, listener.publish),
        *(listener.subscribers, listener.topics, listener.trigger, listener.set_parameter),
    )

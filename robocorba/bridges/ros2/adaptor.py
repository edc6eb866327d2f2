"""An actual robot that speaks ROS 2, as an adaptor: odometry and scans in, velocities out.

It runs in a Python that has rclpy, as `robocorba ros2` does."""

from __future__ import annotations

import argparse
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from robocorba.bridges.ros2 import ros_node
from robocorba.bridges.ros2.lasers import Lasers, seconds_of
from robocorba.errors.robots import AdaptorFailed, RobotLost
from robocorba.errors.services import ServiceError
from robocorba.map_editor.spatial.frames import Frame, out_of, turned
from robocorba.robot.adaptor import ArgumentParser, RobotAdaptor, frame_argument, was_reset
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, ActorCommand, RobotState, Velocity
from robocorba.robot.scans import PoseTrack
from robocorba.simulation.sensing.scan import Mount
from robocorba.system.background import Background
from robocorba.system.backoff import Backoff

if TYPE_CHECKING:
    from robocorba.bridges.ros2.node import RosNode

_log = logging.getLogger(__name__)

#: Time without odometry after which the robot is lost [s].
SILENT_S = 0.5


def adaptor(context: AdaptorContext) -> RobotAdaptor:
    """The entry point `ros2` of the adaptors."""

    def body_pose() -> Frame:
        at = context.session.latest.at
        return at.x, at.y, at.heading

    return Ros2Adaptor(context.name, body_pose, context.last_pose and context.last_pose[1:])


class Ros2Adaptor(RobotAdaptor):
    """body_pose: of the robot's body in the building. last_pose: where a former process of this robot's agent has left
    it, or None. start_limit_s: for the first message of each topic [s].

    `start` takes `[--namespace NS] [--odom TOPIC] [--cmd-vel TOPIC] [--stamped] [--scan TOPIC[@AHEAD,LEFT,HEADING] ...]
    [--localization TOPIC] [--domain N] [--pose=X,Y,HEADING]`. The pose [m, rad] is the robot's at the first start, by
    default that of its body; from there its odometry goes on, corrected by each pose of the localization, a
    PoseWithCovarianceStamped in the frame of the building's map, such as AMCL's."""

    waits_for = "the ROS 2 robot"

    def __init__(
        self, name: str, body_pose: Callable[[], Frame], last_pose: Frame | None = None, start_limit_s: float = 10.0
    ) -> None:
        self._name, self._body_pose, self._pose = name, body_pose, last_pose
        self._start_limit_s = start_limit_s
        self._is_first = True
        self._node: RosNode | None = None
        #: Pose of the odometry's frame in the building.
        self._origin: Frame = (0.0, 0.0, 0.0)
        self._track = PoseTrack()
        #: The latest odometry, in its own frame, and when it arrived [s].
        self._odometry: tuple[RobotState, float] | None = None
        #: Of the velocity: nothing is published after that of `stop`.
        self._lock = threading.Lock()
        self._velocity, self._valid_until = ZERO_VELOCITY, 0.0

    # ---- the paper's four methods ----

    def start(self, argv: Sequence[str]) -> bool:
        if self._node is not None:
            return False
        given = _parse(argv)
        self._odometry, self._track = None, PoseTrack()
        try:
            node = ros_node(given.domain, f"robocorba_{''.join(c if c.isalnum() else '_' for c in self._name)}")
        except ServiceError as error:
            raise AdaptorFailed(str(error)) from None
        try:
            where = given.namespace.rstrip("/") + "/" if given.namespace else ""
            _subscribe(node, where + given.odom, "nav_msgs/msg/Odometry", self._note_odometry)
            lasers = Lasers(dict(given.scan))
            for topic, take in lasers.receivers().items():
                _subscribe(node, where + topic, "sensor_msgs/msg/LaserScan", take)
            self._publish, self._wait = _velocities(node, where + given.cmd_vel, given.stamped)
            node.node.create_timer(0.02, self._end_old_velocity)
            node.start()
            missing: list[str] = []

            def is_there() -> bool:
                missing[:] = lasers.missing if self._odometry else [given.odom, *lasers.missing]
                return not missing

            if not Backoff(0.02, 0.1).poll(is_there, self._start_limit_s):
                place = f"in domain {node.domain}, namespace {given.namespace or '/'}"
                raise RobotLost(f"nothing came on {', '.join(missing)} within {self._start_limit_s:g} s {place}")
            self._set_origin(given.pose)
            if given.localization:
                pose_type = "geometry_msgs/msg/PoseWithCovarianceStamped"
                _subscribe(node, where + given.localization, pose_type, self._correct)
        except BaseException:
            node.close()
            raise
        self.senses, self._is_first, self._node = lasers if given.scan else None, False, node
        return True

    def stop(self) -> bool:
        with self._lock:
            node, self._node = self._node, None
            if node is None:
                return False
            self._velocity = ZERO_VELOCITY
            self._publish(self._velocity)
        self._wait()
        closing = Background("end of ROS 2", node.close, _log.warning)
        closing.start()
        closing.wait_for_end(0.5)
        return True

    def read(self, state: RobotState) -> bool:
        if self._node is None or self._odometry is None:
            return False
        odometry, arrived_at = self._odometry
        if (silent_s := time.monotonic() - arrived_at) > SILENT_S:
            raise RobotLost(f"its odometry has been silent for {silent_s:.1f} s")
        self._pose = state.x, state.y, state.heading = _out_of(_pose(odometry), self._origin)
        state.time, state.velocity = odometry.time, odometry.velocity
        return True

    def write(self, command: ActorCommand) -> bool:
        with self._lock:
            if self._node is None:
                return False
            before, self._velocity = self._velocity, command.velocity
            self._valid_until = time.monotonic() + command.valid_s
            if any(before) or any(command.velocity):  # a robot that stands is left to others
                self._publish(command.velocity)
            return True

    # ---- in the thread of the node ----

    def _note_odometry(self, message: Any) -> None:
        moving = message.twist.twist
        state = RobotState(seconds_of(message.header.stamp), *_frame_of(message.pose.pose))
        state.velocity = moving.linear.x, moving.linear.y, moving.angular.z
        if all(map(math.isfinite, (*_pose(state), *state.velocity))):
            self._track.observe(state)
            self._odometry = state, time.monotonic()

    def _correct(self, message: Any) -> None:
        pose, odometry = _frame_of(message.pose.pose), self._track.at(seconds_of(message.header.stamp))
        if odometry and all(map(math.isfinite, pose)):
            self._origin = _origin(pose, odometry)

    def _end_old_velocity(self) -> None:
        """What a robot does with velocities that are not repeated is its own affair."""
        with self._lock:
            if any(self._velocity) and time.monotonic() > self._valid_until:
                self._velocity = ZERO_VELOCITY
                self._publish(self._velocity)

    def _set_origin(self, first_pose: Frame | None) -> None:
        """At the first start, and after the odometry was reset."""
        assert self._odometry is not None
        odometry = _pose(self._odometry[0])
        expected = (first_pose if self._is_first else None) or self._pose or self._body_pose()
        if self._is_first or was_reset(_out_of(odometry, self._origin), expected):
            self._origin = _origin(expected, odometry)


def _subscribe(node: Any, topic: str, type: str, take: Callable[[Any], None]) -> None:
    from rclpy.qos import qos_profile_sensor_data

    from robocorba.bridges.ros2.node import message_type

    node.node.create_subscription(message_type(type), topic, take, qos_profile_sensor_data)


def _velocities(node: Any, topic: str, is_stamped: bool) -> tuple[Callable[[Velocity], None], Callable[[], object]]:
    """Publishes velocities; and waits a moment until the last one has arrived."""
    from rclpy.duration import Duration

    from robocorba.bridges.ros2.node import message_type

    twist, stamped = message_type("geometry_msgs/msg/Twist"), message_type("geometry_msgs/msg/TwistStamped")
    made = node.node.create_publisher(stamped if is_stamped else twist, topic, 1)

    def publish(velocity: Velocity) -> None:
        moving = twist()
        moving.linear.x, moving.linear.y, moving.angular.z = map(float, velocity)
        if is_stamped:
            message = stamped(twist=moving)
            message.header.stamp, message.header.frame_id = node.node.get_clock().now().to_msg(), "base_link"
        made.publish(message if is_stamped else moving)

    return publish, lambda: made.wait_for_all_acked(Duration(seconds=0.3))


def _pose(state: RobotState) -> Frame:
    return state.x, state.y, state.heading


def _frame_of(pose: Any) -> Frame:
    """Of a geometry_msgs/Pose: the place, and the turn about the vertical axis."""
    x, y, z, w = (getattr(pose.orientation, axis) for axis in "xyzw")
    heading = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return pose.position.x, pose.position.y, heading


def _out_of(pose: Frame, frame: Frame) -> Frame:
    """A pose in a frame, on the floor."""
    return *out_of(pose[0], pose[1], frame), math.remainder(frame[2] + pose[2], math.tau)


def _origin(pose: Frame, odometry: Frame) -> Frame:
    """The frame in which `odometry` is where `pose` is on the floor."""
    heading = pose[2] - odometry[2]
    x, y = turned(odometry[0], odometry[1], heading)
    return pose[0] - x, pose[1] - y, heading


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = ArgumentParser()
    for option, default in (("--namespace", ""), ("--odom", "odom"), ("--cmd-vel", "cmd_vel"), ("--localization", "")):
        parser.add_argument(option, default=default)
    parser.add_argument("--stamped", action="store_true")
    parser.add_argument("--scan", action="append", default=[], type=_scan, metavar="TOPIC[@AHEAD,LEFT,HEADING]")
    parser.add_argument("--domain", type=int)
    parser.add_argument("--pose", type=frame_argument, metavar="X,Y,HEADING")
    given = parser.parse_args(list(argv))
    topics = [topic for topic, _ in given.scan]
    if len(set(topics)) < len(topics):
        parser.error(f"--scan: twice the same topic of {', '.join(topics)}")
    return given


def _scan(text: str) -> tuple[str, Mount]:
    topic, _, mount = text.partition("@")
    return topic, Mount(*frame_argument(mount)) if mount else Mount()

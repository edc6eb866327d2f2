"""Messages of ROS 2, as REP 103 and 105 describe frames and units, from poses and times of RoboCorba."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from robocorba.errors.robots import RobotError
from robocorba.map_editor.formats.grid import FREE, OCCUPIED, UNKNOWN, Canvas
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_view import RobotPlace

NS_PER_S = 1_000_000_000

#: A quaternion x, y, z, w.
Quaternion = tuple[float, float, float, float]


class Topics(Protocol):
    """Where messages go, with their classes: of ROS itself, or of a library that writes bags."""

    def make(self, name: str, /, **fields: Any) -> Any:
        """A message of a type such as std_msgs/msg/String; all its fields must be given."""

    def array(self, values: np.ndarray) -> Any:
        """The value of a field that is a sequence of numbers, as the class wants it."""

    def publish(self, topic: str, type: str, message: Any, time_s: float, is_latched: bool = False) -> None:
        """Publish a message of a simulated time [s]. is_latched: later subscribers get the last one."""

    def close(self, topic: str) -> None:
        """Nothing more is published on a topic, if anything was."""


def nanoseconds(time_s: float) -> int:
    """A simulated time [s] in ns."""
    return round(time_s * NS_PER_S)


def yaw(heading: float) -> Quaternion:
    """A turn about the vertical axis [rad]."""
    return 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)


def heading_of(x: float, y: float, z: float, w: float) -> float:
    """The turn about the vertical axis [rad] of a quaternion, which need not have the length 1. Raises RobotError for
    one that is no rotation, or whose axis is not vertical."""
    length = math.hypot(x, y, z, w)
    if not 1e-6 < length < math.inf:
        raise RobotError(f"the orientation ({x:g}, {y:g}, {z:g}, {w:g}) is no rotation")
    tilt_rad = 2.0 * math.asin(min(1.0, math.hypot(x, y) / length))
    if tilt_rad > 0.1:
        raise RobotError(f"the orientation is tilted by {math.degrees(tilt_rad):.0f} degrees; a base stands upright")
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


class Messages:
    """Makes messages. Times are simulated [s], lengths m, angles rad."""

    def __init__(self, topics: Topics) -> None:
        self._make, self._array = topics.make, topics.array
        covariance = np.zeros((6, 6))
        np.fill_diagonal(covariance, 1e-9)  # simulated poses and velocities are exact, but filters can't invert zeros
        self._covariance = covariance.ravel()

    def clock(self, time_s: float) -> Any:
        return self._make("rosgraph_msgs/msg/Clock", clock=self._time(time_s))

    def text(self, text: str) -> Any:
        return self._make("std_msgs/msg/String", data=text)

    def transform(
        self, time_s: float, parent: str, child: str, at: Sequence[float], rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    ) -> Any:
        """Where the frame `child` is in the frame `parent`."""
        transform = self._make(
            "geometry_msgs/msg/Transform", translation=self._vector(at), rotation=self._quaternion(rotation)
        )
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(time_s, parent),
            child_frame_id=child,
            transform=transform,
        )

    def transforms(self, transforms: Sequence[Any]) -> Any:
        return self._make("tf2_msgs/msg/TFMessage", transforms=list(transforms))

    def odometry(self, time_s: float, parent: str, child: str, place: RobotPlace) -> Any:
        """The pose of a robot's base in the frame `parent`, at height zero, and its velocity in its own frame."""
        ahead, left, turn = place.velocity
        twist = self._make(
            "geometry_msgs/msg/Twist", linear=self._vector((ahead, left, 0.0)), angular=self._vector((0.0, 0.0, turn))
        )
        pose = self._pose((place.x, place.y, 0.0), yaw(place.heading))
        return self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(time_s, parent),
            child_frame_id=child,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=self._covariance),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=self._covariance),
        )

    def scan(self, scan: RobotScan, frame: str, period_s: float) -> Any:
        """A scan in the frame of its sensor, `period_s` after the one before. Rays without a hit are infinite, as in
        REP 117."""
        ranges = np.where(scan.hits, scan.rim_m + scan.distances, np.inf).astype(np.float32)
        return self._make(
            "sensor_msgs/msg/LaserScan",
            header=self._header(scan.time, frame),
            angle_min=scan.first_rad,
            angle_max=scan.first_rad + scan.step_rad * (len(ranges) - 1),
            angle_increment=scan.step_rad,
            time_increment=0.0,
            scan_time=period_s,
            range_min=scan.rim_m,
            range_max=scan.rim_m + scan.range_m,
            ranges=self._array(ranges),
            intensities=self._array(np.empty(0, np.float32)),
        )

    def joints(self, time_s: float, names: Sequence[str], positions: Floats) -> Any:
        empty = np.empty(0)
        return self._make(
            "sensor_msgs/msg/JointState",
            header=self._header(time_s, ""),
            name=list(names),
            position=self._array(np.asarray(positions, float)),
            velocity=self._array(empty),
            effort=self._array(empty),
        )

    def grid(self, time_s: float, frame: str, canvas: Canvas, height_m: float) -> Any:
        """A floor's grid in a frame. height_m: of the floor in it."""
        rows, columns = canvas.cells.shape
        values = np.zeros(3, np.int8)
        values[[FREE, OCCUPIED, UNKNOWN]] = 0, 100, -1  # as nav_msgs/OccupancyGrid has them
        info = self._make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self._time(time_s),
            resolution=canvas.cell_m,
            width=columns,
            height=rows,
            origin=self._pose((*canvas.origin, height_m), yaw(0.0)),
        )
        return self._make(
            "nav_msgs/msg/OccupancyGrid",
            header=self._header(time_s, frame),
            info=info,
            data=self._array(values[canvas.cells[::-1]].ravel()),
        )

    def status(self, level: bytes, name: str, text: str, values: Mapping[str, str]) -> Any:
        """The state of something for /diagnostics."""
        pairs = [self._make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()]
        return self._make(
            "diagnostic_msgs/msg/DiagnosticStatus", level=level, name=name, message=text, hardware_id=name, values=pairs
        )

    def statuses(self, time_s: float, statuses: Sequence[Any]) -> Any:
        return self._make("diagnostic_msgs/msg/DiagnosticArray", header=self._header(time_s, ""), status=list(statuses))

    def _header(self, time_s: float, frame: str) -> Any:
        return self._make("std_msgs/msg/Header", stamp=self._time(time_s), frame_id=frame)

    def _time(self, time_s: float) -> Any:
        seconds, rest = divmod(nanoseconds(time_s), NS_PER_S)
        return self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)

    def _pose(self, at: Sequence[float], rotation: Quaternion) -> Any:
        x, y, z = at
        point = self._make("geometry_msgs/msg/Point", x=x, y=y, z=z)
        return self._make("geometry_msgs/msg/Pose", position=point, orientation=self._quaternion(rotation))

    def _vector(self, xyz: Sequence[float]) -> Any:
        x, y, z = xyz
        return self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _quaternion(self, xyzw: Quaternion) -> Any:
        x, y, z, w = xyzw
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

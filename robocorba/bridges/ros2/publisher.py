"""Publishes the system as topics of ROS 2: on the network, and into a bag.

| topic | type |
|---|---|
| `/clock` | rosgraph_msgs/msg/Clock: simulated time |
| `/tf`, `/tf_static` | tf2_msgs/msg/TFMessage, see `frames.py` |
| `/map`, `/floors/FLOOR/map` | nav_msgs/msg/OccupancyGrid, without movable objects |
| `/ROBOT/odom` | nav_msgs/msg/Odometry |
| `/ROBOT/scan`, `/ROBOT/scan_2`, ... | sensor_msgs/msg/LaserScan, for each sensor of the robot |
| `/ROBOT/joint_states` | sensor_msgs/msg/JointState |
| `/ROBOT/robot_description`, `/ROBOT/floor` | std_msgs/msg/String: the URDF, and the floor on which the robot is |

Times of messages are simulated; those of a robot are of the last update of its floor."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from functools import partial
from typing import Any

import numpy as np

from robocorba.bridges.ros2.frames import BASE, LASER, MAP, ODOM, Frames, floor_frame
from robocorba.bridges.ros2.links import description, link_poses
from robocorba.bridges.ros2.messages import Messages, Topics, yaw
from robocorba.map_editor.formats.floor_grid import DEFAULT_RESOLUTION_M, floor_grid
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import movables
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.posture import Posture
from robocorba.robot.kinematics.model import LASER_M
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_changes import SystemChanges
from robocorba.simulation.system_view import BACKWARD_S, RobotPlace, SystemView
from robocorba.system.plain_names import PlainNames

#: Simulated time after which joints of a robot that does not move are published again [s].
JOINTS_S = 1.0


class RosPublisher:
    """Publishes what it is given. Not thread-safe.

    building: as it is served. robots: names of those that are published; None for all. floor: the one on `/map`; empty
    for the building's first one. resolution_m: side of the cells of maps."""

    def __init__(
        self,
        topics: Topics,
        building: Building,
        robots: Collection[str] | None = None,
        floor: str = "",
        frames: Frames = Frames(),  # noqa: B008
        resolution_m: float = DEFAULT_RESOLUTION_M,
    ) -> None:
        self._topics, self._messages, self._frames = topics, Messages(topics), frames
        self._wanted, self._floor, self._resolution_m = robots, floor, resolution_m
        self.names, self._floor_names = PlainNames(), PlainNames()
        self._view = SystemView(building)
        #: Robots that were published last, with the floors that were published for them.
        self._floor_of: dict[str, str] = {}
        #: Simulated times of each robot's last messages [s].
        self._published_at_s: dict[str, float] = {}
        self._joints: dict[str, Floats] = {}
        #: When the joints of each robot were published last, simulated [s].
        self._joints_at_s: dict[str, float] = {}
        #: By robot, its sensors, each with its number and the simulated time of its last scan [s].
        self._sensors: dict[str, dict[tuple[object, ...], tuple[int, float]]] = {}
        #: Transforms of `/tf_static`, by topic and child frame: its last message has to have them all.
        self._static: dict[str, dict[str, Any]] = {}
        #: The floors whose maps are published, and whether they have to be published again.
        self._floors: set[str] = set()
        self._has_new_map = True
        #: A simulated time [s] and the robots that were there, by name; and floors by their frames. Other threads may
        #: read these: they are replaced by new ones, not changed.
        self.places: tuple[float, dict[str, RobotPlace]] = (0.0, {})
        self.floor_frames: dict[str, str] = {}

    def set_building(self, building: Building) -> None:
        """The map is this from now on."""
        self._view.building = building
        self._has_new_map = True

    @property
    def time_s(self) -> float:
        """Simulated time of the latest floor [s]."""
        return self._view.time_s

    def publish(self, changes: SystemChanges) -> None:
        """Publish what has changed, and where all robots are. Raises UpdateMismatch if an update does not continue the
        last one, and GridTooLarge."""
        before_s = self.time_s
        self._view.apply(changes.updates)
        if self._has_new_map and self._view.building.floors:
            self._has_new_map = False
            self._publish_maps()
        for posture in changes.postures:
            self._note(posture)
        if self.time_s != before_s:
            self._send("/clock", "rosgraph_msgs/msg/Clock", self._messages.clock(self.time_s))
        if changes.updates:
            self._publish_robots()
        for scan in changes.scans:
            self._publish_scan(scan)

    # ---- maps ----

    def _publish_maps(self) -> None:
        building = self._view.building
        moving = [(floor, item.name) for item, floor in movables(building).values()]
        for floor in self._floors - building.floors.keys():
            self._topics.close(self._map_topic(floor))
        self._floors = set(building.floors)
        default = self._floor if self._floor in building.floors else next(iter(building.floors))
        for name, entry in building.floors.items():
            without = {item for floor, item in moving if floor == name}
            canvas = floor_grid(building, name, self._resolution_m, without)
            grid = self._messages.grid(self.time_s, MAP, canvas, entry.floor.elevation)
            for topic in (self._map_topic(name), *(["/map"] if name == default else [])):
                self._send(topic, "nav_msgs/msg/OccupancyGrid", grid, is_latched=True)
            at = (0.0, 0.0, entry.floor.elevation)
            self._add_static("/tf_static", MAP, floor_frame(self._floor_names[name]), at, 0.0)
        self.floor_frames = {floor_frame(self._floor_names[name]): name for name in building.floors}

    def _map_topic(self, floor: str) -> str:
        return f"/floors/{self._floor_names[floor]}/map"

    # ---- robots ----

    def _publish_robots(self) -> None:
        transforms: dict[str, list[Any]] = {}
        places = {
            place.name: place for place in self._view.robots() if self._wanted is None or place.name in self._wanted
        }
        self.places = self.time_s, places
        for place in places.values():
            robot = self.names[place.name]
            odom, base = self._frames.of(robot, ODOM), self._frames.of(robot, BASE)
            if place.name not in self._floor_of:
                urdf = self._messages.text(description(partial(self._frames.of, robot)))
                self._send(f"/{robot}/robot_description", "std_msgs/msg/String", urdf, True)
            if self._floor_of.get(place.name) != place.floor:
                self._floor_of[place.name] = place.floor
                self._send(f"/{robot}/floor", "std_msgs/msg/String", self._messages.text(place.floor), True)
            time_s = place.time_s
            if 0.0 <= self._published_at_s.get(place.name, -math.inf) - time_s < BACKWARD_S:
                continue  # its floor has nothing new yet; tf takes no transform of a time twice
            self._published_at_s[place.name] = time_s
            message = self._messages.odometry(time_s, odom, base, place)
            self._topics.publish(f"/{robot}/odom", "nav_msgs/msg/Odometry", message, time_s)
            frames = transforms.setdefault(self._frames.topic(robot), [])
            frames.append(self._messages.transform(time_s, MAP, odom, (0.0, 0.0, place.z)))
            at = (place.x, place.y, 0.0)
            frames.append(self._messages.transform(time_s, odom, base, at, yaw(place.heading)))
            is_recent = 0.0 <= time_s - self._joints_at_s.get(place.name, -JOINTS_S) < JOINTS_S
            if any(place.velocity) or not is_recent:  # frames of one time, so that links are not behind the base
                frames += self._publish_joints(place.name, robot, time_s)
        for topic, each in transforms.items():
            self._send(topic, "tf2_msgs/msg/TFMessage", self._messages.transforms(each))
        for gone in self._floor_of.keys() - places.keys():
            self._close(gone)

    def _note(self, posture: Posture) -> None:
        """The joints of a posture are published next; none of a robot of another kind."""
        if len(posture.joints) == len(JOINTS):
            self._joints[posture.robot] = np.array(posture.joints)
            self._joints_at_s.pop(posture.robot, None)

    def _publish_joints(self, name: str, robot: str, time_s: float) -> Iterable[Any]:
        """Publishes a robot's joints; returns the transforms of its links."""
        joints = self._joints.get(name, np.zeros(len(JOINTS)))
        self._joints_at_s[name] = time_s
        message = self._messages.joints(time_s, JOINTS, joints)
        self._topics.publish(f"/{robot}/joint_states", "sensor_msgs/msg/JointState", message, time_s)
        for parent, child, at, rotation in link_poses(joints):
            parent, child = self._frames.of(robot, parent), self._frames.of(robot, child)
            yield self._messages.transform(time_s, parent, child, at, rotation)

    def _publish_scan(self, scan: RobotScan) -> None:
        if scan.robot not in self._floor_of:
            return
        robot, sensors = self.names[scan.robot], self._sensors.setdefault(scan.robot, {})
        is_new = scan.sensor not in sensors
        number, before_s = sensors.get(scan.sensor, (len(sensors), scan.time))
        sensors[scan.sensor] = number, scan.time
        suffix = _suffix(number)
        frame = self._frames.of(robot, LASER + suffix)
        if is_new:
            x, y, heading = scan.mount
            base = self._frames.of(robot, BASE)
            self._add_static(self._frames.topic(robot, is_static=True), base, frame, (x, y, LASER_M[2]), heading)
        message = self._messages.scan(scan, frame, max(0.0, scan.time - before_s))
        self._topics.publish(f"/{robot}/scan{suffix}", "sensor_msgs/msg/LaserScan", message, scan.time)

    def _close(self, name: str) -> None:
        """A robot has left."""
        robot = self.names[name]
        suffixes = [_suffix(number) for number, _ in self._sensors.pop(name, {}).values()]
        if suffixes:
            topic = self._frames.topic(robot, is_static=True)
            for suffix in suffixes:
                self._static[topic].pop(self._frames.of(robot, LASER + suffix))
            self._send_static(topic)
        for topic in ("odom", "joint_states", "robot_description", "floor", *(f"scan{suffix}" for suffix in suffixes)):
            self._topics.close(f"/{robot}/{topic}")
        for each in (self._floor_of, self._published_at_s, self._joints, self._joints_at_s):
            each.pop(name, None)

    # ---- messages ----

    def _add_static(self, topic: str, parent: str, child: str, at: tuple[float, float, float], heading: float) -> None:
        transform = self._messages.transform(self.time_s, parent, child, at, yaw(heading))
        self._static.setdefault(topic, {})[child] = transform
        self._send_static(topic)

    def _send_static(self, topic: str) -> None:
        """What a later subscriber gets."""
        message = self._messages.transforms([*self._static[topic].values()])
        self._send(topic, "tf2_msgs/msg/TFMessage", message, is_latched=True)

    def _send(self, topic: str, type: str, message: Any, is_latched: bool = False) -> None:
        self._topics.publish(topic, type, message, self.time_s, is_latched)


def _suffix(number: int) -> str:
    """What distinguishes the topics and frames of a robot's sensors. number: counts from 0."""
    return f"_{number + 1}" if number else ""

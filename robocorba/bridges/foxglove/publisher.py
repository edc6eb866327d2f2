"""Publishes the system as Foxglove's messages: on a live server, and into an MCAP file.

| topic | schema |
|---|---|
| `/scene` | foxglove.SceneUpdate: building, elevators, objects and robots, each entity in a frame of its own |
| `/tf` | foxglove.FrameTransforms: where these frames are |
| `/ROBOT/pose` | foxglove.PoseInFrame |
| `/ROBOT/scan`, `/ROBOT/scan_2`, ... | foxglove.LaserScan, for each sensor of the robot |
| `/ROBOT/joint_states` | foxglove.JointStates |
| `/robots`, `/missions` | JSON with schemas, see `documents.py` |
| `/log` | foxglove.Log: robots that come and go, phases and ends of missions |

Times of messages are simulated."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import foxglove
import numpy as np
from foxglove.channels import (
    FrameTransformsChannel,
    JointStatesChannel,
    LaserScanChannel,
    LogChannel,
    PoseInFrameChannel,
    SceneUpdateChannel,
)
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    JointState,
    JointStates,
    LaserScan,
    Log,
    LogLevel,
    PoseInFrame,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneUpdate,
    Vector3,
)

from robocorba.bridges.foxglove.documents import MISSIONS_SCHEMA, ROBOTS_SCHEMA, mission_as_json, robot_as_json
from robocorba.bridges.foxglove.scene import (
    MAP,
    body_entities,
    building_entities,
    elevator_entity,
    elevator_frame,
    entity_ids,
    floor_entity,
    frame_of,
    link_frame,
)
from robocorba.bridges.foxglove.shapes import nanoseconds, pose, timestamp, vector, yaw
from robocorba.errors.simulation import UpdateMismatch
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import movables
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.map_editor.spatial.floor_update import WHOLE, Body, BodyKind, FloorUpdate, FloorView
from robocorba.map_editor.spatial.posture import Posture
from robocorba.robot.display import Display
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.model import LASER_M
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.simulation.mission_record import MissionContent
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_changes import SystemChanges
from robocorba.simulation.system_view import BACKWARD_S

#: Simulated time between two messages on `/robots` [s].
ROBOTS_S = 1.0


class FoxglovePublisher:
    """Publishes what it is given to the sinks of a context. Not thread-safe. building: as it is served."""

    def __init__(self, context: foxglove.Context, building: Building) -> None:
        self._context = context
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._transforms = FrameTransformsChannel("/tf", context=context)
        self._log = LogChannel("/log", context=context)
        self._robots = foxglove.Channel("/robots", schema=ROBOTS_SCHEMA, context=context)
        self._missions = foxglove.Channel("/missions", schema=MISSIONS_SCHEMA, context=context)
        #: The channels of each robot, by the rest of their topics; and its sensors that have sent scans.
        self._channels: dict[str, dict[str, Any]] = {}
        self._sensors: dict[str, list[tuple[object, ...]]] = {}
        #: What robots show on their touch panels, as far as that is known: not in recordings.
        self.displays: Mapping[str, Display | None] = {}
        self._smartpal = SmartPalBody()
        self._building = building
        self._heights: dict[str, float] = {}
        self._views: dict[str, FloorView] = {}
        #: The floor on which each robot or object is, by its frame.
        self._floor_of: dict[str, str] = {}
        #: Joint angles of robots that have reported some, by name.
        self._postures: dict[str, Posture] = {}
        self._elevators: dict[str, ElevatorState] = {}
        #: The last missions, by name, the last change last.
        self._mission_states: dict[str, dict[str, Any]] = {}
        self.time_s, self._robots_at_s = 0.0, -ROBOTS_S
        #: Whether the next update publishes everything.
        self._is_whole = True
        #: Entities of floors and elevators that were published, and those that are to be deleted with the next update.
        self._fixed: set[str] = set()
        self._gone: list[str] = []
        self.set_building(building)

    def set_building(self, building: Building) -> None:
        """The map is this from now on."""
        self._building = building
        self._heights = {name: item.height for name, (item, _) in movables(building).items()}
        for floor in self._views.keys() - building.floors.keys():
            self._gone += [each for body in self._views.pop(floor).bodies.values() for each in self._left(body, floor)]
        for elevator in self._elevators.keys() - building.elevators.keys():
            del self._elevators[elevator]
        self.repeat()

    def repeat(self) -> None:
        """Publish the whole scene and all frames with the next update, for those who have just subscribed."""
        self._is_whole = True

    def _publish_all(self) -> None:
        entities = list(building_entities(self._building, self.time_s))
        fixed = {floor_entity(floor) for floor in self._building.floors}
        fixed |= {elevator_frame(elevator) for elevator in self._building.elevators}
        gone, self._fixed = sorted(self._fixed - fixed), fixed
        transforms: list[FrameTransform] = []
        for view, body in self._bodies():
            entities += self._entities(body)
            transforms += [self._base(view, body), *self._links(body)]
            if body.kind is BodyKind.ROBOT:
                self._publish_pose(view, body)
        for name, state in self._elevators.items():
            if elevator := self._building.elevators.get(name):
                entities.append(elevator_entity(elevator, state.doors is Doors.OPEN, self.time_s))
                transforms += self._cabin(name, state)
        self._publish(entities, gone, transforms)
        self.publish_robots()
        self._publish_missions()

    def _bodies(self) -> Iterator[tuple[FloorView, Body]]:
        """All robots and objects, each on the floor where it is."""
        for view in self._views.values():
            for body in view.bodies.values():
                if self._floor_of.get(frame_of(body)) == view.floor:
                    yield view, body

    def publish(self, changes: SystemChanges) -> None:
        """Publish what has changed. Raises UpdateMismatch if an update does not continue the last one."""
        self.update_floors(changes.updates)
        self.update_postures(changes.postures)
        self.update_scans(changes.scans)
        self.update_missions((state.name, state.content) for state in changes.missions)
        if abs(self.time_s - self._robots_at_s) >= ROBOTS_S:
            self._robots_at_s = self.time_s
            self.publish_robots()

    # ---- floors ----

    def update_floors(self, updates: Iterable[FloorUpdate]) -> None:
        """Publish what has changed on floors. Raises UpdateMismatch if an update does not continue the last one."""
        entities: list[SceneEntity] = []
        transforms: list[FrameTransform] = []
        left: list[tuple[Body, str]] = []
        for update in updates:
            left += self._update_floor(update, entities, transforms)
        gone = [each for body, floor in left for each in self._left(body, floor)]  # it may have entered another floor
        gone, self._gone = [*self._gone, *gone], []
        if self._is_whole:
            self._is_whole = False
            self._publish((), gone, ())
            self._publish_all()
        else:
            self._publish(entities, gone, transforms)

    def _update_floor(
        self, update: FloorUpdate, entities: list[SceneEntity], transforms: list[FrameTransform]
    ) -> list[tuple[Body, str]]:
        """Collect what has changed on a floor. Returns the bodies that have left it."""
        view = self._views.setdefault(update.floor, FloorView(update.floor))
        before = set(view.bodies.values()) if update.since == WHOLE or update.went or update.came else set()
        try:
            view.apply(update)
        except UpdateMismatch:
            del self._views[update.floor]
            raise
        if not 0.0 <= self.time_s - update.time < BACKWARD_S:
            self.time_s = update.time
        if update.since == WHOLE:  # an elevator may be gone, or have another name
            present = {name for each in self._views.values() for name in each.elevators}
            self._elevators = {name: state for name, state in self._elevators.items() if name in present}
        came = [body for body in view.bodies.values() if body not in before] if before else update.came
        for body in came:
            entities += self._entered(body, view.floor)
        moved = set(view.motions["number"][view.moved].tolist()) | {body.number for body in came}
        for number in sorted(moved):
            body = view.bodies[number]
            if self._floor_of.get(frame_of(body)) == view.floor:
                transforms.append(self._base(view, body))
                if body.kind is BodyKind.ROBOT and not self._is_whole:
                    self._publish_pose(view, body)
        for body in came:
            transforms += self._links(body)
        for name, state in update.elevators.items():
            known = self._elevators.get(name)
            self._elevators[name] = state
            if elevator := self._building.elevators.get(name):
                if known is None or (known.doors is Doors.OPEN) != (state.doors is Doors.OPEN):
                    entities.append(elevator_entity(elevator, state.doors is Doors.OPEN, self.time_s))
                if known is None or known.height != state.height:
                    transforms += self._cabin(name, state)
        return [(body, view.floor) for body in before.difference(view.bodies.values())]

    def _entered(self, body: Body, floor: str) -> list[SceneEntity]:
        frame = frame_of(body)
        is_new = self._floor_of.get(frame) != floor
        self._floor_of[frame] = floor
        if is_new and body.kind is BodyKind.ROBOT:
            self.log(f"{body.name} is on {floor}", body.name)
        return self._entities(body)

    def _left(self, body: Body, floor: str) -> list[str]:
        """The entities to delete of a body that left a floor; none if it is on another one already."""
        frame = frame_of(body)
        if self._floor_of.get(frame) != floor:
            return []
        del self._floor_of[frame]
        if body.kind is BodyKind.ROBOT:
            self._postures.pop(body.name, None)
            self.log(f"{body.name} is gone", body.name)
        return entity_ids(body)

    def _entities(self, body: Body) -> list[SceneEntity]:
        return body_entities(body, self._heights.get(body.name, 0.7), self.time_s)  # 0.7 m if the map does not have it

    def _base(self, view: FloorView, body: Body) -> FrameTransform:
        """Where a body is."""
        *at, heading = self._pose(view, body)
        return self._transform(MAP, frame_of(body), vector(at), yaw(heading))

    def _publish_pose(self, view: FloorView, body: Body) -> None:
        message = PoseInFrame(timestamp=timestamp(self.time_s), frame_id=MAP, pose=pose(*self._pose(view, body)))
        self._channel(body.name, "pose", PoseInFrameChannel).log(message, log_time=nanoseconds(self.time_s))

    def _pose(self, view: FloorView, body: Body) -> tuple[float, float, float, float]:
        """x, y, z [m] and heading [rad] of a body."""
        row = view.motion(body.number)
        return float(row["x"]), float(row["y"]), self._ground_m(view.floor, body), float(row["heading"])

    def _ground_m(self, floor: str, body: Body) -> float:
        """The height on which a body stands [m]: of the cabin in which it is, else of the floor.

        A cabin may arrive by an earlier update than the one by which its riders come to the new floor."""
        for state in self._elevators.values():
            if body.name in state.riders:
                return state.height
        return self._building.floors[floor].floor.elevation if floor in self._building.floors else 0.0

    def _cabin(self, name: str, state: ElevatorState) -> list[FrameTransform]:
        """Where a cabin is, and the robots in it: they move up and down with it."""
        elevator = self._building.elevators[name]
        x, y = elevator.at
        at = vector((x, y, state.height))
        riders = [self._base(view, body) for view, body in self._bodies() if body.name in state.riders]
        return [self._transform(MAP, elevator_frame(name), at, yaw(elevator.heading)), *riders]

    # ---- robots ----

    def update_postures(self, postures: Iterable[Posture]) -> None:
        """Publish joint angles that robots have reported."""
        transforms: list[FrameTransform] = []
        for posture in postures:
            robot = posture.robot
            if len(posture.joints) != len(JOINTS) or f"{robot}/base_link" not in self._floor_of:
                continue  # a robot of another kind, or one that has left
            self._postures[robot] = posture
            joints = [JointState(name=name, position=angle) for name, angle in zip(JOINTS, posture.joints, strict=True)]
            message = JointStates(timestamp=timestamp(posture.time), joints=joints)
            self._channel(robot, "joint_states", JointStatesChannel).log(message, log_time=nanoseconds(self.time_s))
            transforms += self._link_transforms(robot, posture.joints)
        self._publish((), (), transforms)

    def update_scans(self, scans: Iterable[RobotScan]) -> None:
        """Publish scans of robots' sensors. Rays without a hit are infinite, as in REP 117."""
        for scan in scans:
            x, y, heading = scan.mount
            ranges = np.where(scan.hits, scan.rim_m + scan.distances, np.inf)
            message = LaserScan(
                timestamp=timestamp(scan.time),
                frame_id=f"{scan.robot}/base_link",
                pose=pose(x, y, LASER_M[2], heading),
                start_angle=scan.first_rad,
                end_angle=scan.first_rad + scan.step_rad * (len(ranges) - 1),
                ranges=ranges.tolist(),
            )
            sensors = self._sensors.setdefault(scan.robot, [])
            if scan.sensor not in sensors:
                sensors.append(scan.sensor)
            number = sensors.index(scan.sensor) + 1
            topic = f"scan_{number}" if number > 1 else "scan"
            self._channel(scan.robot, topic, LaserScanChannel).log(message, log_time=nanoseconds(self.time_s))

    def _channel(self, robot: str, topic: str, kind: Any) -> Any:
        """The channel of a robot's topic, of this kind."""
        channels = self._channels.setdefault(robot, {})
        if topic not in channels:
            channels[topic] = kind(f"/{robot}/{topic}", context=self._context)
        return channels[topic]

    def _links(self, body: Body) -> list[FrameTransform]:
        """Where the links of a robot are in its frame."""
        if body.kind is BodyKind.OBJECT:
            return []
        posture = self._postures.get(body.name)
        return self._link_transforms(body.name, posture.joints if posture else [0.0] * len(JOINTS))

    def _link_transforms(self, robot: str, joints: Sequence[float]) -> list[FrameTransform]:
        base = link_frame(robot, "base")
        return [
            self._transform(base, link_frame(robot, link), vector(at.tolist()), _quaternion(attitude))
            for link, (at, attitude) in self._smartpal.links(np.array(joints)).items()
            if link != "base"
        ]

    # ---- documents and log ----

    def publish_robots(self) -> None:
        """Publish where all robots are, as ROBOTS_SCHEMA describes it. Topics of robots that are gone end."""
        rides = {robot: name for name, state in self._elevators.items() for robot in state.riders}
        robots = [
            robot_as_json(name, view.floor, view.motion(body.number), rides.get(name, ""), self.displays.get(name))
            for view, body in self._bodies()
            if body.kind is BodyKind.ROBOT and (name := body.name)
        ]
        self._robots.log({"robots": robots}, log_time=nanoseconds(self.time_s))
        self._close_channels({robot["name"] for robot in robots})

    def _close_channels(self, robots: set[str]) -> None:
        """Close the channels of all robots but these."""
        for robot in self._channels.keys() - robots:
            self._sensors.pop(robot, None)
            for channel in self._channels.pop(robot).values():
                channel.close()

    def update_missions(self, missions: Iterable[tuple[str, MissionContent]]) -> None:
        """Publish the last missions, as MISSIONS_SCHEMA describes them, if some have changed: names and states."""
        changed = {name: mission_as_json(name, content) for name, content in missions}
        for name, mission in changed.items():
            before = self._mission_states.pop(name, None)
            self._mission_states[name] = mission
            if before is None or (before["phase"], before["result"]) != (mission["phase"], mission["result"]):
                level = LogLevel.Info if mission["result"] in ("running", "done") else LogLevel.Error
                text = mission["phase"] if mission["result"] == "running" else mission["result"]
                self.log(": ".join(filter(None, (text, mission["reason"]))), name, level)
        for name in list(self._mission_states)[:-20]:
            del self._mission_states[name]
        if changed:
            self._publish_missions()

    def _publish_missions(self) -> None:
        self._missions.log({"missions": [*self._mission_states.values()]}, log_time=nanoseconds(self.time_s))

    def log(self, text: str, name: str, level: LogLevel = LogLevel.Info) -> None:
        """Publish a line of the log. name: of the robot or mission that it is about."""
        message = Log(timestamp=timestamp(self.time_s), level=level, message=text, name=name)
        self._log.log(message, log_time=nanoseconds(self.time_s))

    # ---- messages ----

    def _transform(self, parent: str, child: str, at: Vector3, attitude: Quaternion) -> FrameTransform:
        return FrameTransform(
            timestamp=timestamp(self.time_s),
            parent_frame_id=parent,
            child_frame_id=child,
            translation=at,
            rotation=attitude,
        )

    def _publish(
        self, entities: Sequence[SceneEntity], gone: Sequence[str], transforms: Sequence[FrameTransform]
    ) -> None:
        at = nanoseconds(self.time_s)
        if transforms:
            self._transforms.log(FrameTransforms(transforms=list(transforms)), log_time=at)
        if entities or gone:
            deletions = [SceneEntityDeletion(timestamp=timestamp(self.time_s), id=each) for each in gone]
            self._scene.log(SceneUpdate(entities=list(entities), deletions=deletions), log_time=at)


def _quaternion(attitude: Any) -> Quaternion:
    """From w, x, y, z."""
    w, x, y, z = attitude.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)

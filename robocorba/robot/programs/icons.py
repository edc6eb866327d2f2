"""The icons of a program: their parameters with units and bounds.

Units are metres, radians, seconds and newtons. The classes check nothing when they are constructed in Python;
`program.loads` and `ProgramBuilder.program` do. Field names are those of the program's JSON file.
"""

from __future__ import annotations

import math
import re
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, get_args

from msgspec import Meta, Struct

from robocorba.map_editor.spatial.pose import MAX_CARRIERS
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, LUMBAR, OPEN_RAD, SHUT_RAD, Side
from robocorba.robot.programs.installed_icons import installed
from robocorba.simulation.sensing.scan import LASER, ray_sensor


def _tag(name: str) -> str:
    """MbasePath: mbase_path."""
    return re.sub(r"(?<=.)([A-Z])", r"_\1", name).lower()


def _joint(number: int, title: str) -> Meta:
    return Meta(ge=float(JOINT_LOWER[number]), le=float(JOINT_UPPER[number]), title=f"{title} [rad]")


# ---- types of parameters ----

Text = Annotated[str, Meta(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$", title="name")]
Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6, title="coordinate [m]", description="In the building's frame.")]
Heading = Annotated[
    float, Meta(ge=-2 * math.pi, le=2 * math.pi, title="heading [rad]", description="Counter-clockwise from +x.")
]
Offset = Annotated[float, Meta(ge=-1000.0, le=1000.0, title="distance [m]", description="In the robot's own frame.")]
Turn = Annotated[float, Meta(ge=-2 * math.pi, le=2 * math.pi, title="turn [rad]", description="Plus to the left.")]
Speed = Annotated[float, Meta(ge=0.01, le=BASE_LIMITS.speed, title="speed [m/s]", description="At most this fast.")]
Velocity = Annotated[float, Meta(ge=-BASE_LIMITS.speed, le=BASE_LIMITS.speed, title="velocity [m/s]")]
TurnVelocity = Annotated[
    float, Meta(ge=-BASE_LIMITS.turn_speed, le=BASE_LIMITS.turn_speed, title="turn [rad/s]", description="Plus: left.")
]
Seconds = Annotated[float, Meta(gt=0.0, le=3600.0, title="time [s]")]
RecoveryTimeout = Annotated[
    float,
    Meta(
        gt=0.0,
        le=3600.0,
        title="recovery timeout [s]",
        description="For how long robots or servers may be missing after a fault before the mission fails; else 60 s.",
    ),
]
Reach = Annotated[float, Meta(ge=-2.0, le=2.0, title="coordinate [m]", description="In the robot's own frame.")]
Angle = Annotated[float, Meta(ge=-math.pi, le=math.pi, title="angle [rad]", description="In the robot's own frame.")]
Joints = tuple[
    Annotated[float, _joint(0, "shoulder roll")],
    Annotated[float, _joint(1, "shoulder bend")],
    Annotated[float, _joint(2, "upper arm roll")],
    Annotated[float, _joint(3, "elbow")],
    Annotated[float, _joint(4, "forearm roll")],
    Annotated[float, _joint(5, "first wrist bend")],
    Annotated[float, _joint(6, "second wrist bend")],
]
LumbarLower = Annotated[float, _joint(LUMBAR.start, "lower lumbar joint")]
LumbarUpper = Annotated[float, _joint(LUMBAR.start + 1, "upper lumbar joint")]
Opening = Annotated[float, Meta(ge=0.0, le=1.0, title="opening", description="From 0, shut, to 1, open.")]
Force = Annotated[float, Meta(ge=0.1, le=50.0, title="force [N]")]
Distance = Annotated[float, Meta(ge=0.0, le=LASER.range_m, title="distance [m]")]
Times = Annotated[int, Meta(ge=1, le=10_000, title="times")]

Hand = Literal["left", "right", "both"]
GripperAction = Literal["open", "close"]
Outcome = Literal["done", "stopped", "timed_out", "refused"]
#: The laser; the nearest of all proximity sensors; each proximity sensor, in the order of the rays of a scan.
Sensor = Literal[
    "laser", "proximity", "front", "front_left", "left", "back_left", "back", "back_right", "right", "front_right"
]


def sides(hand: str) -> tuple[Side, ...]:
    """The hands for `left`, `right` or `both`."""
    return (Side.LEFT, Side.RIGHT) if hand == "both" else (Side(hand),)


def range_m(sensor: str) -> float:
    """Range of a sensor [m]."""
    return ray_sensor(sensor).fan.range_m


class Destination(Struct, frozen=True, forbid_unknown_fields=True):
    """Target pose of an object."""

    floor: Text
    x: Coordinate
    y: Coordinate
    heading: Heading = 0.0


# ---- conditions ----


class _Condition(Struct, frozen=True, forbid_unknown_fields=True, tag_field="when", tag=_tag):
    pass


class CloserThan(_Condition, frozen=True):
    """The nearest obstacle that a sensor sees is closer than this."""

    sensor: Sensor
    distance: Distance


class FartherThan(_Condition, frozen=True):
    """Every obstacle that a sensor sees is at least this far away."""

    sensor: Sensor
    distance: Distance


class Holding(_Condition, frozen=True):
    """A hand holds something; `both`: each does."""

    hand: Hand


class Event(_Condition, frozen=True):
    """An event has arrived since the program began that no condition has consumed; this condition consumes one. In
    type and source * matches any text, ? any character."""

    type: Text = "*"
    source: Text = "*"


class Result(_Condition, frozen=True):
    """The previous icon ended with this result."""

    result: Outcome


# ---- icons ----


class _Icon(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, tag_field="icon", tag=_tag):
    pass


class MovementIcon(_Icon, frozen=True):
    """An icon that one method of the robot performs."""

    def perform(self, robot: Any) -> None:
        """Move a `robot.robot.Robot`. Raises as its methods do."""
        raise NotImplementedError


class MbasePath(MovementIcon, frozen=True):
    """Drive to a point in the building along a path of the path planning agent, across floors and elevators. The
    robot yields to other robots and, after it was blocked, plans around them. Without `heading` it keeps the last
    heading of the drive."""

    floor: Text
    x: Coordinate
    y: Coordinate
    heading: Heading | None = None
    speed: Speed | None = None

    def perform(self, robot: Any) -> None:
        robot.drive_path(self.floor, self.x, self.y, self.heading, self.speed or 0.0)


class MbaseTo(MovementIcon, frozen=True):
    """Drive straight to a point on the floor where the robot is."""

    x: Coordinate
    y: Coordinate
    heading: Heading | None = None
    speed: Speed | None = None

    def perform(self, robot: Any) -> None:
        robot.drive_to(self.x, self.y, self.heading, self.speed or 0.0)


class MbaseBy(MovementIcon, frozen=True):
    """Drive straight by a distance ahead and to the left, turning by an angle on the way."""

    ahead: Offset = 0.0
    left: Offset = 0.0
    turn: Turn = 0.0
    speed: Speed | None = None

    def perform(self, robot: Any) -> None:
        robot.drive_by(self.ahead, self.left, self.turn, self.speed or 0.0)


class MbaseVelocity(MovementIcon, frozen=True):
    """Drive and turn with a velocity for a time, then stop."""

    ahead: Velocity
    left: Velocity
    turn: TurnVelocity
    seconds: Seconds

    def perform(self, robot: Any) -> None:
        robot.drive_at((self.ahead, self.left, self.turn), self.seconds)


class MhandJoints(_Icon, frozen=True):
    """Bring an arm's joints to angles, from shoulder to wrist. `both`: the same angles, so that the arms mirror each
    other. `seconds` is the least duration."""

    hand: Hand
    joints: Joints
    seconds: Seconds | None = None


class MhandPose(_Icon, frozen=True):
    """Bring a hand to a pose in the robot's frame: its control point to x, y, z, turned by roll about x, then pitch
    about y, then yaw about z; without all three the attitude is free. `both`: the pose is the left hand's, the right
    hand mirrors it."""

    hand: Hand
    x: Reach
    y: Reach
    z: Reach
    roll: Angle | None = None
    pitch: Angle | None = None
    yaw: Angle | None = None
    seconds: Seconds | None = None


class MhandOffset(_Icon, frozen=True):
    """Move a hand along a straight line in the robot's frame, without turning it. `both`: the hands move alike."""

    hand: Hand
    dx: Reach = 0.0
    dy: Reach = 0.0
    dz: Reach = 0.0
    seconds: Seconds | None = None


class MhandPosture(_Icon, frozen=True):
    """Bring an arm into a named posture; `both`: the arms mirror each other."""

    hand: Hand
    posture: Text
    seconds: Seconds | None = None


class Lumbar(_Icon, frozen=True):
    """Bend the body at its two joints: plus bends it forwards, minus backwards. `lower` is above the base, `upper`
    below the trunk."""

    lower: LumbarLower
    upper: LumbarUpper
    seconds: Seconds | None = None


class Gripper(MovementIcon, frozen=True):
    """Open or close a gripper, by default completely; `opening` sets how far. `force` (closing only) is the gripping
    force; `object` (closing only) names the gripped object in the building."""

    hand: Hand
    action: GripperAction
    opening: Opening | None = None
    force: Force | None = None
    object: Text | None = None

    @property
    def angle_rad(self) -> float:
        """Target angle of the gripper's joint [rad]."""
        opening = self.opening if self.opening is not None else float(self.action == "open")
        return SHUT_RAD + opening * (OPEN_RAD - SHUT_RAD)

    def perform(self, robot: Any) -> None:
        if self.action == "open":
            robot.release(sides(self.hand), self.angle_rad)
        else:
            robot.grip(sides(self.hand), self.angle_rad, self.force, self.object or "")


class WaitUntil(_Icon, frozen=True):
    """Wait for a condition, at most for `seconds`: the result is `done` or `timed_out`."""

    condition: Condition
    seconds: Seconds


class StopIfCloser(_Icon, frozen=True):
    """Run icons, but end with the result `stopped` as soon as a sensor sees an obstacle closer than this."""

    sensor: Sensor
    distance: Distance
    icons: Body


class Wait(MovementIcon, frozen=True):
    """Do nothing for a time."""

    seconds: Seconds

    def perform(self, robot: Any) -> None:
        with robot.execution.awaiting(lambda: f"{self.seconds:g} s"):
            robot.wait(self.seconds)


class Confirm(_Icon, frozen=True):
    """Ask a person a question, answered on the robot's panel or by any client. The result is `done` after yes. After
    no, or without an answer within `seconds`, the program fails, unless `on_no` is `go_on`: then the result is
    `refused` or `timed_out`."""

    question: Text
    seconds: Seconds
    on_no: Literal["fail", "go_on"] = "fail"


class Repeat(_Icon, frozen=True):
    """Run icons several times."""

    times: Times
    icons: Body


class Branch(_Icon, frozen=True):
    """Run the icons of `then` if a condition holds, else those of `otherwise`."""

    condition: Condition
    then: Body
    otherwise: tuple[Icon, ...] = ()


class Say(_Icon, frozen=True):
    """Publish an event on the robot's channel, with any JSON value as payload."""

    type: Text
    payload: Any = None


class CooperativeIcon(_Icon, frozen=True):
    """An icon that several robots execute together, in a mission. Packages add their own: docs/mission.md."""

    @property
    def moved(self) -> str:
        """Name of the object that it takes away from its place in the building, or empty."""
        return ""

    @property
    def needs_arms(self) -> bool:
        """Whether the robot whose program has this icon moves its arms for it."""
        return True


class MoveTable(CooperativeIcon, frozen=True):
    """Carry a table together with other robots: the mission layer makes the icons of each of them. Without `carriers`
    its mass decides."""

    table: Text
    to: Destination
    recovery_timeout: RecoveryTimeout | None = None
    carriers: Annotated[int, Meta(ge=2, le=MAX_CARRIERS)] | None = None

    @property
    def moved(self) -> str:
        return self.table


class HandOver(CooperativeIcon, frozen=True):
    """Hand an object to another robot. Without `giver` the giver is the robot that runs the program."""

    object: Text
    taker: Text
    giver: Text | None = None
    recovery_timeout: RecoveryTimeout | None = None

    @property
    def moved(self) -> str:
        return self.object

    @property
    def needs_arms(self) -> bool:
        return not self.giver


Condition = CloserThan | FartherThan | Holding | Event | Result
Icon = (
    MbasePath
    | MbaseTo
    | MbaseBy
    | MbaseVelocity
    | MhandJoints
    | MhandPose
    | MhandOffset
    | MhandPosture
    | Lumbar
    | Gripper
    | WaitUntil
    | StopIfCloser
    | Wait
    | Confirm
    | Repeat
    | Branch
    | Say
    | MoveTable
    | HandOver
)
#: Cooperative icons of other packages. Their modules may import all that is above.
INSTALLED = installed(CooperativeIcon, {str(kind.__struct_config__.tag) for kind in get_args(Icon)})
Icon = reduce(or_, INSTALLED, Icon)  # type: ignore[misc]
Body = Annotated[tuple[Icon, ...], Meta(min_length=1)]

#: Every icon and condition by its tag.
ICONS: dict[str, type[Icon]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Icon)}
CONDITIONS: dict[str, type[Condition]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Condition)}


def kind(icon: Icon | Condition) -> str:
    """The tag of an icon or a condition, such as mbase_path."""
    return str(icon.__struct_config__.tag)


def bodies(icon: Icon) -> tuple[tuple[str, tuple[Icon, ...]], ...]:
    """The icons inside an icon, by the parameter that contains them."""
    if isinstance(icon, Repeat | StopIfCloser):
        return (("icons", icon.icons),)
    if isinstance(icon, Branch):
        return (("then", icon.then), ("otherwise", icon.otherwise))
    return ()

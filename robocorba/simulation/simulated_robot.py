"""A robot in the simulated building: its velocity commands, emergency stop and posture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from robocorba.errors.simulation import InvalidCommand
from robocorba.map_editor.spatial.pose import RobotMotion
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.body_names import robot_body
from robocorba.simulation.physics import FloorPhysics
from robocorba.simulation.registry import Description
from robocorba.system.stop_latch import StopLatch

#: Maximum validity of a velocity command [s].
MAX_VALID_S = 5.0
#: Field of the InvalidCommand for a robot that is held by an emergency stop.
STOPPED = "stopped"
#: Maximum number of joints in a reported posture.
MAX_JOINTS = 64


class SimulatedRobot:
    """A robot in the building. Its methods and `holding` are thread-safe. name_of: names an object by its body."""

    def __init__(
        self, description: Description, number: int, floor: str, physics: FloorPhysics, name_of: Callable[[str], str]
    ) -> None:
        self.description, self.number = description, number
        self.body = robot_body(description.name)
        self.floor, self.physics = floor, physics
        self._name_of = name_of
        self.collisions = 0
        #: Name of the robot or object of the last collision; empty for a static obstacle.
        self.touched = ""
        #: The emergency stops of the robot's name.
        self._stops = StopLatch()
        #: The posture that the robot reported last; None before the first one.
        self.posture: Posture | None = None
        self._last, self._held = RobotMotion(physics.time, description.pose, (0.0, 0.0, 0.0)), ""

    @property
    def name(self) -> str:
        return self.description.name

    def command(self, ahead: float, left: float, turn: float, valid_s: float) -> None:
        """Set the velocity [m/s, rad/s] for `valid_s` of simulated time or until the next command.

        Raises InvalidCommand."""
        if not math.isfinite(ahead + left + turn):
            raise InvalidCommand("wanted", f"({ahead}, {left}, {turn}) is not a velocity")
        if not 0.0 <= valid_s <= MAX_VALID_S:
            raise InvalidCommand("validFor", f"{valid_s} is not 0 to {MAX_VALID_S:g} s")
        if self._stops.reasons:
            raise InvalidCommand(STOPPED, self._stops.reason)
        self.physics.command(self.body, ahead, left, turn, valid_s)
        if self._stops.reasons:  # the robot was stopped meanwhile, perhaps before this command
            self.physics.brake(self.body)

    def brake(self) -> None:
        """Stop as fast as ground friction allows, until the next command."""
        self.physics.brake(self.body)

    def hold_by(self, stops: StopLatch) -> None:
        """Stop as `brake`, and refuse commands, while this latch is on."""
        self._stops = stops
        if stops.is_on:
            self.physics.brake(self.body)

    def report_posture(self, joints: Sequence[float]) -> None:
        """Keep the robot's joint angles [rad] for readers; no effect on the simulation. Raises InvalidCommand."""
        if len(joints) > MAX_JOINTS:
            raise InvalidCommand("joints", f"{len(joints)} angles; at most {MAX_JOINTS}")
        if not all(map(math.isfinite, joints)):
            raise InvalidCommand("joints", "an angle is not a finite number")
        self.posture = Posture(self.name, self.physics.time, tuple(joints))

    @property
    def holding(self) -> str:
        """Name of the held object after the last step; empty for none."""
        snapshot = self.physics.snapshot
        if self.body in snapshot.row_of:  # else it was just added or is changing floors
            self._held = snapshot.held.get(self.body, "")
        return self._name_of(self._held)

    def state(self) -> RobotMotion:
        """Pose and velocity after the last step."""
        snapshot = self.physics.snapshot
        row = snapshot.row_of.get(self.body)
        if row is not None:  # else it was just added or is changing floors
            self._last = snapshot.states[row]
        return self._last

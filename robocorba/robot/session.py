"""A robot's session in the simulated building: its body, sensors, grips, elevator rides and reserved areas.

A virtual robot is that body. An actual robot has a body, too, which follows it so that others see it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeVar

from robocorba.errors.robots import ServerAway
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.motion.robot_state import Velocity
from robocorba.simulation.elevator import RideStatus
from robocorba.simulation.emergency_stops import StopHold
from robocorba.simulation.registry import Pose
from robocorba.simulation.reservations import Reservation
from robocorba.simulation.sensing.scan import Mount, ScanSpec
from robocorba.system.backoff import Backoff

#: Time for which a robot tries to give back what it has at the simulation server, while that is away [s]. A server that
#: hangs is restarted after 10 s.
GIVING_BACK_S = 60.0
T = TypeVar("T")


class SessionState(NamedTuple):
    """time: of the simulation [s]. velocity: ahead and to the left [m/s], turn [rad/s]. holding: name of the object
    that the robot holds, or empty. collisions: of all sessions of the robot until now. touched: name of what it
    collided with last, empty for a wall."""

    time: float
    at: Pose
    velocity: Velocity
    holding: str
    ride: RideStatus | None
    collisions: int
    touched: str


class BuildingSession(Protocol):
    """Thread-safe. Every method raises RobotLost if the simulation server does not answer."""

    @property
    def latest(self) -> SessionState:
        """The last result of `state`, without a call. Raises RobotLost if there is none."""

    def log_on(self, at: Pose | None = None) -> None:
        """Log on unless the robot is logged on: at its last pose; `at` a pose if it was never logged on. Raises
        SimulationError, UnknownFloor."""

    def log_off(self) -> None:
        """Has no effect if the server does not answer."""

    def heartbeat(self) -> None:
        """Renew the robot's lease."""

    def state(self) -> SessionState:
        """The present state."""

    def command(self, velocity: Velocity, valid_s: float) -> None:
        """Move at a velocity for `valid_s` of simulated time. Raises InvalidCommand; RobotHeld while an emergency stop
        at the server holds the robot."""

    def announce_body(self, is_robot: bool) -> None:
        """Tell the server whether the robot is its body in the building, or the body follows an actual robot."""

    def hold(self) -> StopHold:
        """The emergency stop by which the server holds the robot's name."""

    def report_stop(self, reason: str) -> tuple[bool, StopHold]:
        """Let the server hold the robot's name, unless something does already. Returns whether that is a new stop, and
        what holds it."""

    def end_stops(self, number: int) -> StopHold:
        """End the server's stops up to a number; returns what holds the robot still."""

    def brake(self) -> None:
        """Stop as hard as the wheels hold."""

    def scan(self, at: Pose, mount: Mount, spec: ScanSpec) -> Floats:
        """Distances (rays,) [m]. Raises InvalidScan, SensorBehind, UnknownFloor."""

    def grip(self, what: str, x: float, y: float) -> None:
        """Hold an object at a point (x, y) [m]. Raises CannotGrip."""

    def release(self) -> None:
        """Release the object."""

    def call_elevator(
        self, elevator: str, destination: str, party: str = "", size: int = 1, boarding_s: float = 0.0
    ) -> None:
        """Reserve a ride. party: name of a group of `size` robots that ride together and alone, or empty. boarding_s:
        time that it needs to drive in, and to drive out; 0 if that is unknown.

        Raises InvalidRide, ElevatorFull."""

    def longest_elevator_wait_s(self) -> float:
        """Upper bound of the simulated time until the doors open for the ride [s], whatever other robots do; 0 once
        they have, and without a ride."""

    def cancel_elevator(self) -> None:
        """Cancel the ride."""

    def reserve(self, areas: Sequence[FloorArea], limit_s: float) -> None:
        """Request areas (floor, corners [m]), all or none, for `limit_s` of simulated time after they are granted.

        Raises InvalidReservation, UnknownFloor, ReservationsFull."""

    def reserve_one_of(self, alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
        """The same for one of several alternatives: the one that is granted the soonest if all earlier requests last as
        long as they may, among equals the first. Returns its index.

        Raises InvalidReservation, UnknownFloor, ReservationsFull."""

    def exchange_areas(self, areas: Sequence[FloorArea], least_s: float) -> bool:
        """Replace the granted areas by others, for what is left of their limit, if that is at least `least_s` and
        nobody has to wait longer for it. Returns whether they were. Raises InvalidReservation, UnknownFloor."""

    def take_over_areas(self, former: str) -> None:
        """Take over the areas that were granted to a robot which fell silent while it held an object. Raises
        InvalidReservation."""

    def reservation(self) -> Reservation | None:
        """The state of the request; None without a request, or once its grant has expired."""

    def keep_areas(self, areas: Sequence[FloorArea]) -> None:
        """Return all other areas. Raises InvalidReservation."""

    def release_areas(self) -> None:
        """Return all areas, or cancel the request."""


def once_back(call: Callable[[], T]) -> T:
    """The answer to a call of a session, repeated while the simulation server is away, for GIVING_BACK_S at most: an
    object would stay in the hands, and areas reserved. Raises RobotLost, and what the call raises."""
    return Backoff(0.05, 0.5).call(call, GIVING_BACK_S, ServerAway)

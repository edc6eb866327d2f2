"""A robot's session in the building, as the control agent uses it: its body there, what it senses, grips and rides.

A virtual robot is that body. An actual one has it too: it goes where the robot goes, so that others see it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from robocorba.maps.polygons import FloorArea
from robocorba.motion.robot_state import Velocity
from robocorba.sensing.virtual_sensor import Mount, ScanSpec
from robocorba.simulation.elevator import RideStatus
from robocorba.simulation.registry import Pose
from robocorba.simulation.reservations import Reservation
from robocorba.spatial.grids import Floats


class SessionState(NamedTuple):
    """time: of the simulation, s. velocity: m/s ahead and to the left, rad/s. holding: an object, empty for none.
    touched: what was collided with last, empty for a wall."""

    time: float
    at: Pose
    velocity: Velocity
    holding: str
    ride: RideStatus | None
    collisions: int
    touched: str


class BuildingSession(Protocol):
    """Safe from any thread. Everything raises RobotLost where nobody answers."""

    @property
    def latest(self) -> SessionState:
        """What `state` answered last; nobody is asked. Raises RobotLost where it never did."""

    def log_on(self, at: Pose | None = None) -> None:
        """Make sure that the robot is logged on: where it was last, or `at` a place if it was not. Raises
        SimulationError, UnknownFloor."""

    def log_off(self) -> None:
        """Does nothing where nobody answers."""

    def heartbeat(self) -> None:
        """The robot is there: its lease is renewed."""

    def state(self) -> SessionState:
        """Now."""

    def command(self, velocity: Velocity, valid_s: float) -> None:
        """Move like this for so much simulated time. Raises InvalidCommand."""

    def brake(self) -> None:
        """Stand as soon as the wheels hold."""

    def scan(self, at: Pose, mount: Mount, spec: ScanSpec) -> Floats:
        """Distances (rays,), m. Raises SensingError, UnknownFloor."""

    def grip(self, what: str, x: float, y: float) -> None:
        """Hold an object at a place. Raises CannotGrip."""

    def release(self) -> None:
        """Let go of it."""

    def call_elevator(self, elevator: str, destination: str, party: str = "", size: int = 1) -> None:
        """Reserve a ride; with a party of so many robots that have the cabin for themselves, where it is named.

        Raises InvalidRide, ElevatorFull."""

    def give_up_elevator(self) -> None:
        """Not ride any more."""

    def reserve(self, areas: Sequence[FloorArea], limit_s: float) -> None:
        """Ask for areas (floor, corners in m), all of them or none, for so much simulated time after they are granted.

        Raises InvalidReservation, UnknownFloor, ReservationsFull."""

    def reservation(self) -> Reservation | None:
        """How far the request has come; None where there is none, or its grant has ended."""

    def keep_areas(self, areas: Sequence[FloorArea]) -> None:
        """Give back all but these. Raises InvalidReservation."""

    def release_areas(self) -> None:
        """Give back all, or don't wait for them any more."""

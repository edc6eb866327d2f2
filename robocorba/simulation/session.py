"""What a robot that is logged on may do: its session. Any call renews its lease."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from robocorba.errors.simulation import InvalidRide
from robocorba.maps.polygons import FloorArea
from robocorba.simulation.building import SimulatedBuilding, SimulatedRobot
from robocorba.simulation.elevator import RideStatus
from robocorba.simulation.registry import RobotClient
from robocorba.simulation.reservations import Reservation, kept_of, wanted_of
from robocorba.spatial.floor_state import RobotMotion


class Session:
    """Safe from any thread. Every call raises SessionExpired once the robot is logged off.

    do: makes a change of the building, and returns when it can't be lost any more."""

    def __init__(
        self,
        client: RobotClient,
        robot: SimulatedRobot,
        building: SimulatedBuilding,
        do: Callable[[Callable[[], None]], None],
        log_off: Callable[[RobotClient], None],
    ) -> None:
        self.client, self.robot = client, robot
        self._building, self._do_durably, self._log_off = building, do, log_off

    @property
    def name(self) -> str:
        return self.client.name

    def command(self, ahead: float, left: float, turn: float, valid_s: float) -> None:
        """Move like this, m/s and rad/s, for so much simulated time unless told again. Raises InvalidCommand."""
        self.client.renew_lease(time.monotonic())
        self.robot.command(ahead, left, turn, valid_s)

    def brake(self) -> None:
        """Stand as soon as the ground allows, until another command."""
        self.client.renew_lease(time.monotonic())
        self.robot.brake()

    def state(self) -> RobotMotion:
        """How the robot is after the last step."""
        self.client.renew_lease(time.monotonic())
        return self.robot.state()

    def heartbeat(self) -> None:
        """Renew the lease."""
        self.client.renew_lease(time.monotonic())

    @property
    def ride(self) -> RideStatus | None:
        """What the robot has to do with an elevator."""
        return self._building.rides.get(self.name)

    def grip(self, thing: str, at: tuple[float, float]) -> None:
        """Hold an object at a place, x and y in m. Raises CannotGrip, SimulationBusy, ServiceError."""
        self._do(lambda: self._building.grip(self.name, thing, at))

    def release(self) -> None:
        """Let go of what the robot holds, if it does. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.release(self.name))

    def call_elevator(self, elevator: str, destination: str, party: str = "", size: int = 1) -> None:
        """Reserve a ride from where the robot is, alone or in a party of so many.

        Raises InvalidRide, ElevatorFull, SimulationBusy, ServiceError."""
        self._do(lambda: self._building.call_elevator(self.name, elevator, destination, party, size))

    def call_elevator_together(self, elevator: str, destination: str, party: str, size: int) -> None:
        """The same for a party that has a name, and the cabin for itself. Raises what `call_elevator` does."""
        if not party:
            raise InvalidRide("party", "has no name")
        self.call_elevator(elevator, destination, party, size)

    def give_up_elevator(self) -> None:
        """Not ride any more. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.give_up_elevator(self.name))

    def reserve(self, areas: Sequence[FloorArea], limit_s: float) -> None:
        """Ask for areas for so much simulated time after they are granted.

        Raises InvalidReservation, UnknownFloor, ReservationsFull, SimulationBusy, ServiceError."""
        self.client.renew_lease(time.monotonic())
        wanted = wanted_of(areas, limit_s, self._building.building.floors)
        self._do(lambda: self._building.reserve(self.name, wanted))

    def reservation(self) -> Reservation | None:
        """How far the request for areas has come; None where there is none, or its grant has ended."""
        self.client.renew_lease(time.monotonic())
        return self._building.reservations.find(self.name, self._building.time)

    def keep_areas(self, areas: Sequence[FloorArea]) -> None:
        """Give back all but these of the areas. Raises InvalidReservation, SimulationBusy, ServiceError."""
        kept = kept_of(areas)
        self._do(lambda: self._building.reservations.keep(self.name, kept))

    def release_areas(self) -> None:
        """Give back all areas, or don't wait for them any more. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.reservations.release(self.name))

    def deregister(self) -> None:
        """Log off. Raises SimulationBusy, ServiceError."""
        self.client.renew_lease(time.monotonic())
        self._log_off(self.client)

    def _do(self, change: Callable[[], None]) -> None:
        self.client.renew_lease(time.monotonic())
        self._do_durably(change)

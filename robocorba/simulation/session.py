"""The session of a logged-on robot. Every call renews its lease."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from robocorba.errors.simulation import InvalidReservation, InvalidRide, SessionExpired
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import RobotMotion
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.elevator import RideStatus
from robocorba.simulation.occupants import Held
from robocorba.simulation.registry import RobotClient
from robocorba.simulation.reservations import (
    MAX_LIMIT_S,
    AreaRequest,
    Reservation,
    area_request,
    area_requests,
    canonical_areas,
)
from robocorba.simulation.simulated_robot import SimulatedRobot


class Session:
    """What a logged-on robot can do. Thread-safe. Every call raises SessionExpired once the robot is logged off.

    do_durably: applies a change to the building, and returns when it is on disk; else it undoes it and
    raises ServiceError."""

    def __init__(
        self,
        client: RobotClient,
        robot: SimulatedRobot,
        building: SimulatedBuilding,
        do_durably: Callable[[Callable[[], None], Callable[[], None] | None], None],
        log_off: Callable[[RobotClient], None],
    ) -> None:
        self.client, self.robot = client, robot
        self._building, self._do_durably, self._log_off = building, do_durably, log_off
        #: Simulated time of the log-on, or of the restart that restored the session [s].
        self.began = building.time

    @property
    def name(self) -> str:
        return self.client.name

    def command(self, ahead: float, left: float, turn: float, valid_s: float) -> None:
        """Set the velocity [m/s, rad/s] for `valid_s` of simulated time or until the next command.

        Raises InvalidCommand."""
        self.client.renew_lease()
        self.robot.command(ahead, left, turn, valid_s)

    def brake(self) -> None:
        """Stop as fast as ground friction allows, until the next command."""
        self.client.renew_lease()
        self.robot.brake()

    def state(self) -> RobotMotion:
        """Pose and velocity after the last step."""
        self.client.renew_lease()
        return self.robot.state()

    def report_posture(self, joints: Sequence[float]) -> None:
        """Publish the robot's joint angles, in the order of its model [rad]. Raises InvalidCommand."""
        self.client.renew_lease()
        self.robot.report_posture(joints)

    def heartbeat(self) -> None:
        """Renew the lease."""
        self.client.renew_lease()

    @property
    def ride(self) -> RideStatus | None:
        """Status of the robot's ride; None without a ride."""
        return self._building.elevators.rides.get(self.name)

    def grip(self, object_name: str, at: tuple[float, float]) -> None:
        """Grip an object at the point `at` [m]. Raises CannotGrip, SimulationBusy, ServiceError."""
        occupants = self._building.occupants
        before: Held | None = None

        def grip() -> None:
            nonlocal before
            before = occupants.held_by(self.name)
            occupants.grip(self.name, object_name, at)

        self._do(grip, lambda: occupants.hold_again(self.name, before))

    def release(self) -> None:
        """Release the held object, if any. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.occupants.release(self.name))

    def call_elevator(
        self, elevator: str, destination: str, party: str | None = None, size: int = 1, boarding_s: float = 0.0
    ) -> None:
        """Call an elevator to the robot's floor, for one robot or as a member of a named party of `size` robots, which
        rides alone and needs `boarding_s` to drive in, and to drive out; 0 if that is unknown.

        Raises InvalidRide, ElevatorFull, SimulationBusy, ServiceError."""
        if party == "":
            raise InvalidRide("party", "needs a name")
        self._do(
            lambda: self._building.elevators.call(self.name, elevator, destination, party or "", size, boarding_s),
            lambda: self._building.elevators.cancel(self.name),
        )

    def longest_elevator_wait_s(self) -> float:
        """Upper bound of the simulated time until the doors open for the robot's ride [s]; 0 without one."""
        self.client.renew_lease()
        return self._building.elevators.longest_wait_s(self.name)

    def cancel_elevator(self) -> None:
        """Cancel the ride, if any. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.elevators.cancel(self.name))

    def reserve(self, areas: Sequence[FloorArea], limit_s: float) -> None:
        """Request areas; the grant lasts `limit_s` of simulated time.

        Raises InvalidReservation, UnknownFloor, ReservationsFull, SimulationBusy, ServiceError."""
        self.client.renew_lease()
        self._reserve([area_request(areas, limit_s, self._building.building.floors)])

    def reserve_one_of(self, alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
        """Request one of several alternatives, see Reservations.reserve; return its index. Raises as `reserve`."""
        self.client.renew_lease()
        return self._reserve(area_requests(alternatives, limit_s, self._building.building.floors))

    def _reserve(self, alternatives: Sequence[AreaRequest]) -> int:
        chosen = 0

        def reserve() -> None:
            nonlocal chosen
            chosen = self._building.reserve(self.name, alternatives)

        self._do(reserve, lambda: self._building.reservations.release(self.name))
        return chosen

    def exchange_areas(self, areas: Sequence[FloorArea], least_s: float) -> bool:
        """Replace the granted areas, see Reservations.exchange; return whether they were. Raises InvalidReservation,
        UnknownFloor, SimulationBusy, ServiceError."""
        self.client.renew_lease()
        if not 0.0 <= least_s <= MAX_LIMIT_S:  # also refuses NaN
            raise InvalidReservation("least", f"{least_s} s is not 0 to {MAX_LIMIT_S:g} s")
        request = area_request(areas, MAX_LIMIT_S, self._building.building.floors)
        reservations = self._building.reservations
        former: AreaRequest | None = None

        def exchange() -> None:
            nonlocal former
            before = reservations.requests.get(self.name)
            former_request = before.request if before else None
            if reservations.exchange(self.name, request, least_s):
                former = former_request

        def exchange_back() -> None:  # unless others have been granted the former areas meanwhile
            if former:
                reservations.exchange(self.name, former, 0.0)

        self._do(exchange, exchange_back)
        return former is not None

    def take_over_areas(self, former: str) -> None:
        """Take over areas, see Reservations.take_over. Raises InvalidReservation, SimulationBusy, ServiceError."""
        self._do(
            lambda: self._building.reservations.take_over(self.name, former),
            lambda: self._building.reservations.fall_silent(self.name, former),
        )

    def reservation(self) -> Reservation | None:
        """Status of the request for areas; None if there is none or its grant has ended."""
        self.client.renew_lease()
        return self._building.reservations.find(self.name, self._building.time)

    def keep_areas(self, areas: Sequence[FloorArea]) -> None:
        """Release all areas but these. Raises InvalidReservation, SimulationBusy, ServiceError."""
        self.client.renew_lease()
        kept = canonical_areas(areas)
        self._do(lambda: self._building.reservations.keep(self.name, kept))

    def release_areas(self) -> None:
        """Release all areas, or cancel the request. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.reservations.release(self.name))

    def deregister(self) -> None:
        """Log off. Raises SimulationBusy, ServiceError."""
        self.client.renew_lease()
        self._log_off(self.client)

    def _do(self, change: Callable[[], None], undo: Callable[[], None] | None = None) -> None:
        self.client.renew_lease()
        self._do_durably(self._while_logged_on(change), self._while_logged_on(undo) if undo else None)

    def _while_logged_on(self, change: Callable[[], None]) -> Callable[[], None]:
        """The change; raises SessionExpired if the robot is logged off before the simulation thread makes it. Then the
        name may be another robot's."""

        def checked() -> None:
            if self.client.is_logged_off:
                raise SessionExpired()
            change()

        return checked

"""What a robot that is logged on may do: its session. Any call renews its lease."""

from __future__ import annotations

import time
from collections.abc import Callable

from robocorba.simulation.building import Robot, SimulatedBuilding
from robocorba.simulation.elevator import Ride
from robocorba.simulation.registry import Client
from robocorba.simulation.seen import State


class Session:
    """Safe from any thread. Every call raises SessionExpired once the robot is logged off.

    do: makes a change of the building, and returns when it can't be lost any more."""

    def __init__(
        self,
        client: Client,
        robot: Robot,
        building: SimulatedBuilding,
        do: Callable[[Callable[[], None]], None],
        log_off: Callable[[Client], None],
    ) -> None:
        self.client, self.robot = client, robot
        self._building, self._do_kept, self._log_off = building, do, log_off

    @property
    def name(self) -> str:
        return self.client.name

    def command(self, ahead: float, left: float, turn: float, valid_s: float) -> None:
        """Move like this, m/s and rad/s, for so much simulated time unless told again. Raises InvalidCommand."""
        self.client.heard(time.monotonic())
        self.robot.command(ahead, left, turn, valid_s)

    def brake(self) -> None:
        """Stand as soon as the ground allows, until another command."""
        self.client.heard(time.monotonic())
        self.robot.brake()

    def state(self) -> State:
        """How the robot is after the last step."""
        self.client.heard(time.monotonic())
        return self.robot.state()

    def heartbeat(self) -> None:
        """Renew the lease."""
        self.client.heard(time.monotonic())

    @property
    def ride(self) -> Ride | None:
        """What the robot has to do with an elevator."""
        return self._building.rides.get(self.name)

    def grip(self, thing: str, at: tuple[float, float]) -> None:
        """Hold an object at a place, x and y in m. Raises CannotGrip, SimulationBusy, ServiceError."""
        self._do(lambda: self._building.grip(self.name, thing, at))

    def release(self) -> None:
        """Let go of what the robot holds, if it does. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.release(self.name))

    def call_elevator(self, elevator: str, destination: str) -> None:
        """Reserve a ride from where the robot is. Raises InvalidRide, ElevatorFull, SimulationBusy, ServiceError."""
        self._do(lambda: self._building.call_elevator(self.name, elevator, destination))

    def give_up_elevator(self) -> None:
        """Not ride any more. Raises SimulationBusy, ServiceError."""
        self._do(lambda: self._building.give_up_elevator(self.name))

    def deregister(self) -> None:
        """Log off. Raises SimulationBusy, ServiceError."""
        self.client.heard(time.monotonic())
        self._log_off(self.client)

    def _do(self, change: Callable[[], None]) -> None:
        self.client.heard(time.monotonic())
        self._do_kept(change)

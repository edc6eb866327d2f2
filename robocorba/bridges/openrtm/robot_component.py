"""A robot as an RT component: pose, floor and ranges out, velocity in.

| port | type | |
|---|---|---|
| `pose` (out) | RTC::TimedPose2D | pose of the base in the frame of the map [m, rad] |
| `floor` (out) | RTC::TimedString | the floor on which the robot is |
| `range` (out) | RTC::RangeData | the scan of the robot's first sensor |
| `velocity` (in) | RTC::TimedVelocity2D | drive at this velocity [m/s, rad/s] for `velocity_valid_for` |

Times are simulated. An inactive component sends nothing, takes no velocities, and its robot has been ordered to stand.
While the robot is in an emergency stop, or is not reachable, an active component goes to ERROR; reset ends the
emergency stop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from robocorba.bridges.openrtm.data_ports import Channel, DataPort, DataType, InPort, InvalidValue, OutPort
from robocorba.bridges.openrtm.life_cycle import LifeCycle, ReturnCode
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_view import RobotPlace

#: Bounds and initial value of the rate of the execution context [Hz]: the simulation publishes no faster.
MIN_RATE_HZ, MAX_RATE_HZ = 0.1, 20.0
#: The only parameter, and its bounds [s].
VELOCITY_VALID_FOR, MIN_VALID_S, MAX_VALID_S = "velocity_valid_for", 0.05, 5.0

Velocity = tuple[float, float, float]


class TimedPose(NamedTuple):
    """time_s: simulated. x, y [m], heading [rad]: in the frame of the map."""

    time_s: float
    x: float
    y: float
    heading: float


class TimedText(NamedTuple):
    time_s: float
    text: str


class Ranges(NamedTuple):
    """rate_hz: at which scans come."""

    scan: RobotScan
    rate_hz: float


class DataTypes(NamedTuple):
    """The types of the ports."""

    pose: DataType[TimedPose]
    text: DataType[TimedText]
    ranges: DataType[Ranges]
    velocity: DataType[Velocity]


class Orders(Protocol):
    """What the component has the robot do. Drive does not block."""

    def drive(self, velocity: Velocity, valid_s: float) -> None:
        """Drive ahead and to the left [m/s], turn [rad/s], for some time [s]."""

    def reset_stop(self) -> None:
        """End the emergency stop. Raises RoboCorbaError."""


class RobotComponent:
    """name: of the instance. robot: the robot's own name. Thread-safe."""

    def __init__(self, name: str, robot: str, types: DataTypes, channel: Channel, orders: Orders) -> None:
        self.name, self.robot = name, robot
        self._orders = orders
        self.life_cycle = LifeCycle(self._stand, orders.reset_stop)
        #: Whether the execution context runs, and its rate [Hz].
        self.is_running, self.rate_hz = True, MAX_RATE_HZ
        #: For how long a velocity holds [s].
        self.velocity_valid_s = 0.5
        self._pose = OutPort(f"{name}.pose", types.pose, channel)
        self._floor = OutPort(f"{name}.floor", types.text, channel)
        self._range = OutPort(f"{name}.range", types.ranges, channel)
        self._velocity = InPort(f"{name}.velocity", types.velocity, channel, self._drive)
        self._executed_at_s = -math.inf
        #: Whether the robot has got velocities that have not been ended.
        self._is_driven = False
        self._sensor: tuple[object, ...] | None = None

    @property
    def ports(self) -> list[DataPort]:
        return [self._pose, self._floor, self._range, self._velocity]

    # ---- the execution context ----

    def start(self) -> ReturnCode:
        if self.is_running:
            return ReturnCode.PRECONDITION_NOT_MET
        self.is_running = True
        return ReturnCode.OK

    def stop(self) -> ReturnCode:
        if not self.is_running:
            return ReturnCode.PRECONDITION_NOT_MET
        self.is_running = False
        self._stand()
        return ReturnCode.OK

    def set_rate(self, rate_hz: float) -> ReturnCode:
        if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:  # also refuses NaN
            return ReturnCode.BAD_PARAMETER
        self.rate_hz = rate_hz
        return ReturnCode.OK

    # ---- the configuration ----

    @property
    def configuration(self) -> dict[str, str]:
        """Values of the parameters, by name."""
        return {VELOCITY_VALID_FOR: f"{self.velocity_valid_s:g}"}

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters. Raises InvalidValue; then none is set."""
        valid_s = self.velocity_valid_s
        for name, value in values.items():
            if name != VELOCITY_VALID_FOR:
                raise InvalidValue(f"there is no parameter {name}")
            try:
                valid_s = float(value)
            except (TypeError, ValueError):
                valid_s = math.nan
            if not MIN_VALID_S <= valid_s <= MAX_VALID_S:
                raise InvalidValue(f"{name}: {value!r} is not {MIN_VALID_S:g} to {MAX_VALID_S:g} s")
        self.velocity_valid_s = valid_s

    # ---- data ----

    def show(self, now_s: float, time_s: float, place: RobotPlace) -> None:
        """Send where the robot is, at most at the rate, to a tenth of a period. now_s: monotonic, time_s: simulated."""
        if not self._is_executed or (now_s - self._executed_at_s) * self.rate_hz < 0.9:
            return
        self._executed_at_s = now_s
        self._pose.write(TimedPose(time_s, place.x, place.y, place.heading))
        self._floor.write(TimedText(time_s, place.floor))

    def show_scan(self, scan: RobotScan, rate_hz: float) -> None:
        """Send a scan, if it is of the sensor that sent first."""
        self._sensor = self._sensor or scan.sensor
        if self._is_executed and scan.sensor == self._sensor:
            self._range.write(Ranges(scan, rate_hz))

    @property
    def _is_executed(self) -> bool:
        return self.is_running and self.life_cycle.is_active

    def _drive(self, velocity: Velocity) -> bool:
        if not all(map(math.isfinite, velocity)):
            return False
        if self._is_executed:
            self._is_driven = True
            self._orders.drive(velocity, self.velocity_valid_s)
        return True

    def _stand(self) -> None:
        if self._is_driven:
            self._is_driven = False
            self._orders.drive((0.0, 0.0, 0.0), self.velocity_valid_s)

    def disconnect_lost(self) -> None:
        """End connections of which another port has gone; blocks while it looks."""
        for port in self.ports:
            port.connections.disconnect_lost()

    def close(self) -> None:
        """End all connections, and let the robot stand if it is driven by velocities."""
        for port in self.ports:
            port.close()
        self.life_cycle.deactivate()

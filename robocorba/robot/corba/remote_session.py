"""Client of a robot's session at the simulation server, for the robot's own process."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple, TypeVar

import numpy as np
from omniORB import CORBA

from robocorba.errors.robots import RobotHeld, RobotLost, ServerAway
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidCommand, PlaceTaken
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.exceptions import domain_error
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.robot.adaptor import SIMULATION_SERVER
from robocorba.robot.corba import robot_states
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.session import SessionState
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.emergency_stops import NOT_HELD, StopHold
from robocorba.simulation.registry import LEASE_S, Description, Pose
from robocorba.simulation.reservations import Reservation
from robocorba.simulation.sensing.scan import Mount, ScanSpec
from robocorba.simulation.simulated_robot import STOPPED
from robocorba.stubs import RoboCorba
from robocorba.system.backoff import Backoff

#: Timeout of calls in the control loop [s]; the robot stops earlier, when its last command expires.
CALL_TIMEOUT_S = 1.0
#: While the server is away or held up, calls that may be repeated are, for this time [s]: the robot stands meanwhile,
#: and a server that restarts restores its session.
PATIENCE_S = 5.0
#: Timeout of calls that the server stores on disk before it answers [s].
CHANGE_TIMEOUT_S = 3.0
#: A heartbeat is left out this long after any other call, which renews the lease too [s]. The lease is 2 s.
RENEWED_S = 0.6
Answer = TypeVar("Answer")


class _References(NamedTuple):
    """References to a session with CALL_TIMEOUT_S and with CHANGE_TIMEOUT_S, and to its assigned sensor.
    collisions_before: of earlier sessions, since the server counts those of each."""

    session: Any
    slow_session: Any
    sensor: Any
    collisions_before: int = 0


class RemoteSession:
    """The BuildingSession of the robot that `about` describes; call `log_on` first."""

    def __init__(self, orb: Orb, about: Description) -> None:
        self._orb, self.about = orb, about
        #: Serializes log_on and log_off.
        self._lock = threading.Lock()
        self._references: _References | None = None
        self._latest: SessionState | None = None
        #: Reference of the robot's StopTarget; None for none. It is reported to the server with each session.
        self.stop_target: Any = None
        #: Returns the present names of floors by those that they had while the robot was on a floor; see
        #: PoolFollower.floors_since.
        self.floors_since: Callable[[str], Mapping[str, str]] = lambda floor: {}
        self._is_body = True
        self._answered_at = -math.inf

    @property
    def latest(self) -> SessionState:
        if self._latest is None:
            raise RobotLost(f"{self.about.name} is not logged on")
        return self._latest

    @property
    def is_logged_on(self) -> bool:
        """Whether the server has answered a call within the lease, so that the robot's name can be nobody else's."""
        return self._references is not None and time.monotonic() - self._answered_at < LEASE_S

    def log_on(self, at: Pose | None = None) -> None:
        """Raises RobotLost, SimulationError, UnknownFloor."""
        with self._lock:
            if self._references and self._is_alive(self._references.session):
                return
            if at is None and self._latest:
                self._register_near(self._latest)
            else:
                self._register(replace(self.about, pose=at or self.about.pose))

    def log_off(self) -> None:
        with self._lock:
            references, self._references = self._references, None
            if references:
                with contextlib.suppress(CORBA.Exception):
                    references.slow_session.deregister()

    def state(self) -> SessionState:
        def ask(to: _References) -> SessionState:
            found = robot_states.session_state_of(to.session.state())
            return found._replace(collisions=to.collisions_before + found.collisions)

        self._latest = found = self._repeat(ask)
        return found

    def heartbeat(self) -> None:
        """Raises RobotLost. Does nothing right after another call."""
        if self._references is None or time.monotonic() - self._answered_at > RENEWED_S:
            self._call(lambda to: to.slow_session.heartbeat())

    def command(self, velocity: Velocity, valid_s: float) -> None:
        try:
            self._call(lambda to: to.session.command(RoboCorba.Velocity(*velocity), valid_s))
        except ServerAway:  # once it is back another command, or none, may be right: it is not sent again
            self._repeat(lambda to: to.session.heartbeat())
        except InvalidCommand as error:
            if error.field == STOPPED:
                raise RobotHeld(error.reason) from None
            raise

    def announce_body(self, is_robot: bool) -> None:
        self._is_body = is_robot
        self._call(lambda to: self._report_stop_target(to.slow_session))

    def hold(self) -> StopHold:
        return self._call(lambda to: _hold(to.slow_session._get_hold))

    def report_stop(self, reason: str) -> tuple[bool, StopHold]:
        def report(to: _References) -> tuple[bool, StopHold]:
            try:
                is_new, hold = to.slow_session.reportStop(reason)
            except CORBA.BAD_OPERATION:
                return False, NOT_HELD
            return bool(is_new), sessions.stop_hold_of(hold)

        return self._call(report)

    def end_stops(self, number: int) -> StopHold:
        def end(to: _References) -> StopHold:
            try:
                return sessions.stop_hold_of(to.slow_session.endStops(number))
            except CORBA.BAD_OPERATION:  # of an earlier release
                _known(to.slow_session.resetStop)
                return NOT_HELD

        return self._call(end)

    def brake(self) -> None:
        self._repeat(lambda to: to.session.brake(), CALL_TIMEOUT_S)  # the caller wants to know soon

    def report_posture(self, joints: Floats) -> None:
        """Publish the robot's joint angles (n,), at most 64 [rad]. Raises RobotLost, InvalidCommand."""
        self._call(lambda to: to.session.reportPosture(joints.tolist()))

    def scan(self, at: Pose, mount: Mount, spec: ScanSpec) -> Floats:
        seen = self._call(lambda to: to.sensor.scan(at, RoboCorba.Mount(*mount), scans.spec(spec)), is_sensor=True)
        return np.array(seen.distances)

    def grip(self, what: str, x: float, y: float) -> None:
        self._call(lambda to: to.slow_session.grip(what, RoboCorba.XY(x, y)))

    def release(self) -> None:
        self._repeat(lambda to: to.slow_session.release())

    def call_elevator(
        self, elevator: str, destination: str, party: str = "", size: int = 1, boarding_s: float = 0.0
    ) -> None:
        if party:
            self._call(lambda to: to.slow_session.callElevatorFor(elevator, destination, party, size, boarding_s))
        else:
            self._call(lambda to: to.slow_session.callElevator(elevator, destination))

    def longest_elevator_wait_s(self) -> float:
        return float(self._repeat(lambda to: to.session.longestElevatorWait()))

    def cancel_elevator(self) -> None:
        self._call(lambda to: to.slow_session.giveUpElevator())

    def reserve(self, areas: Sequence[FloorArea], limit_s: float) -> None:
        self._call(lambda to: to.slow_session.reserveAreas(sessions.areas(areas), limit_s))

    def reserve_one_of(self, alternatives: Sequence[Sequence[FloorArea]], limit_s: float) -> int:
        found = [sessions.areas(areas) for areas in alternatives]
        return int(self._call(lambda to: to.slow_session.reserveOneOf(found, limit_s)))

    def exchange_areas(self, areas: Sequence[FloorArea], least_s: float) -> bool:
        found = sessions.areas(areas)
        return bool(self._call(lambda to: to.slow_session.exchangeAreas(found, least_s)))

    def take_over_areas(self, former: str) -> None:
        self._call(lambda to: to.slow_session.takeOverAreas(former))

    def reservation(self) -> Reservation | None:
        return sessions.reservation_of(self._repeat(lambda to: to.session.reservation()))

    def keep_areas(self, areas: Sequence[FloorArea]) -> None:
        self._call(lambda to: to.slow_session.keepAreas(sessions.areas(areas)))

    def release_areas(self) -> None:
        self._call(lambda to: to.slow_session.releaseAreas())

    # ---- implementation ----

    def _report_stop_target(self, session: Any) -> None:
        if self.stop_target is not None:
            _known(lambda: session.reportStopTarget(self.stop_target, self._is_body))

    @staticmethod
    def _is_alive(session: Any) -> bool:
        """Whether the session still exists at the server, which restores sessions when it restarts within the lease."""
        try:
            session.heartbeat()
        except CORBA.OBJECT_NOT_EXIST:
            return False
        except CORBA.SystemException as error:
            raise _lost(error) from None
        return True

    def _register_near(self, last: SessionState) -> None:
        """Register at the pose before the loss, or up to 0.2 m beside it, in eight directions, if the place is taken
        meanwhile; in a cabin that has arrived without the robot, on that floor. Floors may have other names now."""
        try:
            names = self.floors_since(last.at.floor)
        except NotReachable as error:
            raise RobotLost(str(error)) from None
        floors = [last.at.floor]
        if last.ride and last.ride.phase is RidePhase.RIDING:
            floors.append(last.ride.destination)
        places = [last.at._replace(floor=names.get(floor, floor)) for floor in floors]
        for place, distance_m in product(places, (0.0, 0.05, 0.1, 0.2)):
            for turn in range(8 if distance_m else 1):
                x = place.x + distance_m * math.cos(math.tau * turn / 8)
                y = place.y + distance_m * math.sin(math.tau * turn / 8)
                with contextlib.suppress(PlaceTaken):
                    self._register(replace(self.about, pose=place._replace(x=x, y=y)))
                    return
        self._register(replace(self.about, pose=places[0]))

    def _register(self, about: Description) -> None:
        try:
            server = self._orb.resolve("SimulationServer", RoboCorba.SimulationServer, 5.0, CHANGE_TIMEOUT_S)
        except NotReachable as error:
            raise RobotLost(str(error)) from None
        with translated(SIMULATION_SERVER, RobotLost):
            uri = self._orb.uri(server.registerRobot(sessions.description(about)))
            session = self._orb.reference(uri, RoboCorba.RobotSession, CALL_TIMEOUT_S)
            slow_session = self._orb.reference(uri, RoboCorba.RobotSession, CHANGE_TIMEOUT_S)
            try:
                sensor = slow_session._get_sensor()
                self._report_stop_target(slow_session)
            except CORBA.SystemException:
                with contextlib.suppress(CORBA.Exception):  # else the robot's name is taken until the lease expires
                    slow_session.deregister()
                raise
            set_call_timeout(sensor, CALL_TIMEOUT_S)
        collisions = self._latest.collisions if self._latest else 0
        self._references = _References(session, slow_session, sensor, collisions)

    def _repeat(self, operation: Callable[[_References], Answer], limit_s: float = math.inf) -> Answer:
        """The answer to a call that may be repeated, for PATIENCE_S at most. Raises RobotLost and domain errors."""
        return Backoff(0.02, 0.1).call(lambda: self._call(operation), min(limit_s, PATIENCE_S), ServerAway)

    def _call(self, operation: Callable[[_References], Answer], is_sensor: bool = False) -> Answer:
        """The answer to a call; is_sensor: of the sensor, which does not renew the lease. Raises RobotLost and domain
        errors."""
        references = self._references
        if references is None:
            raise RobotLost(f"{self.about.name} is not logged on")
        began = time.monotonic()
        try:
            answer = operation(references)
            if not is_sensor:
                self._answered_at = began
            return answer
        except CORBA.UserException as error:
            raise (domain_error(error) or error) from None
        except CORBA.SystemException as error:
            raise _lost(error, is_sensor) from None


def _hold(read: Callable[[], Any]) -> StopHold:
    try:
        return sessions.stop_hold_of(read())
    except CORBA.BAD_OPERATION:  # of an earlier release
        return NOT_HELD


def _known(operation: Callable[[], None]) -> None:
    """Call an operation that servers of earlier versions don't have; these ignore it."""
    with contextlib.suppress(CORBA.BAD_OPERATION):
        operation()


def _lost(error: CORBA.SystemException, is_sensor: bool = False) -> RobotLost:
    if isinstance(error, CORBA.OBJECT_NOT_EXIST) and not is_sensor:
        return RobotLost(f"{SIMULATION_SERVER} has logged the robot off")
    # It has ended, is about to start, or is held up.
    is_away = isinstance(error, (CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT))
    server = "the virtual sensor server" if is_sensor else SIMULATION_SERVER
    return (ServerAway if is_away else RobotLost)(f"{server} does not answer ({describe(error)})")

"""Conversion of robots, sessions and the simulation server's state from and to the IDL."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from omniORB import CORBA

from robocorba.errors import simulation as errors
from robocorba.map_editor.corba.maps import xy, xy_of
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import Limits, Pose, RobotMotion
from robocorba.map_editor.spatial.posture import Posture
from robocorba.orb.exceptions import register, register_system, register_with
from robocorba.orb.structs import Converter, struct_converter
from robocorba.simulation.elevator import RidePhase, RideStatus
from robocorba.simulation.emergency_stops import StopAnswer, StopHold, StopState
from robocorba.simulation.load_balance import Load, SensorServer
from robocorba.simulation.registry import Description, RobotClient, ServerState
from robocorba.simulation.reservations import Reservation, ReservedAreas, check_alternatives, check_sizes
from robocorba.stubs import RoboCorba

_PHASES = {
    RidePhase.WAITING: RoboCorba.WAITING_FOR_CABIN,
    RidePhase.BOARDING: RoboCorba.BOARDING,
    RidePhase.RIDING: RoboCorba.RIDING,
    RidePhase.ALIGHTING: RoboCorba.ALIGHTING,
}


def pose_of(struct: Any) -> Pose:
    return Pose(struct.floor, struct.x, struct.y, struct.heading)


#: A RobotDescription struct, and the robot of one; raises InvalidDescription.
description, description_of = struct_converter(
    Description,
    RoboCorba.RobotDescription,
    {"start": "pose", "radius": "radius_m", "mass": "mass_kg"},
    pose=Converter(lambda pose: pose, pose_of),
    limits=Converter(
        lambda limits: RoboCorba.MotionLimits(*limits),
        lambda found: Limits(found.speed, found.turn, found.acceleration, found.turnAcceleration),
    ),
).both


def robot_state(state: RobotMotion, holding: str, riding: RideStatus | None, collisions: int, touched: str) -> Any:
    moving = RoboCorba.Velocity(*state.velocity)
    return RoboCorba.RobotState(state.time, state.pose, moving, holding, ride(riding), collisions, touched)


def ride_of(struct: Any) -> RideStatus | None:
    phase = next((phase for phase, found in _PHASES.items() if found == struct.phase), None)
    return RideStatus(phase, struct.elevator, struct.origin, struct.destination, struct.ahead) if phase else None


def ride(value: RideStatus | None) -> Any:
    if value is None:
        return RoboCorba.Ride(RoboCorba.NO_RIDE, "", "", "", 0)
    return RoboCorba.Ride(_PHASES[value.phase], value.elevator, value.origin, value.destination, value.ahead)


def areas(floor_areas: Sequence[FloorArea]) -> list[Any]:
    return [RoboCorba.FloorArea(floor, [xy(corner) for corner in polygon]) for floor, polygon in floor_areas]


def areas_of(structs: Sequence[Any]) -> list[FloorArea]:
    """Raises InvalidReservation for too many areas or corners, before it converts them."""
    check_sizes([struct.polygon for struct in structs])
    return [_area_of(struct) for struct in structs]


def alternatives_of(structs: Sequence[Any]) -> list[list[FloorArea]]:
    """Raises InvalidReservation for too many alternatives, areas or corners, before it converts them."""
    check_alternatives(structs)
    return [areas_of(areas) for areas in structs]


def _area_of(struct: Any) -> FloorArea:
    return struct.onFloor, tuple(map(xy_of, struct.polygon))


def reservation(value: Reservation | None) -> Any:
    if value is None:
        return RoboCorba.ReservationState(RoboCorba.NO_RESERVATION, 0, 0.0, 0.0)
    phase = RoboCorba.AREAS_GRANTED if value.granted else RoboCorba.WAITING_FOR_AREAS
    return RoboCorba.ReservationState(phase, value.ahead, value.longest_wait_s, value.left_s)


def reservation_of(struct: Any) -> Reservation | None:
    return None if struct.phase == RoboCorba.NO_RESERVATION else _status_of(struct)


def _status_of(struct: Any) -> Reservation:
    granted = struct.phase == RoboCorba.AREAS_GRANTED
    return Reservation(granted, struct.ahead, struct.longestWait, struct.left)


def reserved_areas(value: ReservedAreas) -> Any:
    return RoboCorba.ReservationRecord(value.robot, areas(value.areas), reservation(value.status))


def reserved_areas_of(struct: Any) -> ReservedAreas:
    return ReservedAreas(struct.robot, tuple(map(_area_of, struct.areas)), _status_of(struct.state))


def posture(value: Posture) -> Any:
    return RoboCorba.Posture(value.robot, value.time, list(value.joints))


def posture_of(struct: Any) -> Posture:
    return Posture(struct.robot, struct.time, tuple(struct.joints))


def server_state(state: ServerState) -> Any:
    return RoboCorba.ServerState(*state)


def client_state(client: RobotClient, at: Pose, silent_s: float, sensor: str) -> Any:
    return RoboCorba.ClientState(
        client.name, at, client.since, max(0.0, silent_s), client.call_rate, client.latency_s, sensor
    )


def load(value: Load) -> Any:
    return RoboCorba.SensorLoad(*value)


def load_of(struct: Any) -> Load:
    """Raises CORBA.BAD_PARAM for impossible values."""
    if not all(0.0 <= value <= 1e9 for value in (struct.busy, struct.lag, struct.scanRate)):
        raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
    return Load(struct.busy, struct.lag, struct.scanRate, struct.robots)


def sensor_state(sensor: SensorServer) -> Any:
    return RoboCorba.SensorState(sensor.name, load(sensor.load), len(sensor.robots))


_STOP_MEMBERS = {"held": "is_held", "stopped": "is_stopped", "confirmed": "is_confirmed"}
stop_state, stop_state_of = struct_converter(StopState, RoboCorba.StopState, _STOP_MEMBERS).both
stop_hold, stop_hold_of = struct_converter(StopHold, RoboCorba.StopHold, _STOP_MEMBERS).both
stop_answer, stop_answer_of = struct_converter(StopAnswer, RoboCorba.StopAnswer, _STOP_MEMBERS).both


register_with(
    errors.PlaceTaken,
    RoboCorba.PlaceTaken,
    lambda e: RoboCorba.PlaceTaken(RoboCorba.Point(e.floor, e.x, e.y), e.blocker),
    lambda e: errors.PlaceTaken(e.place.floor, e.place.x, e.place.y, e.by),
)
register(errors.InvalidDescription, RoboCorba.InvalidDescription, "field", "reason")
register(errors.NameTaken, RoboCorba.NameTaken, "name")
register(errors.ServerFull, RoboCorba.ServerFull, "limit", "now", "retry_s")
register(errors.InvalidCommand, RoboCorba.InvalidCommand, "field", "reason")
register(errors.CannotGrip, RoboCorba.CannotGrip, "what", "reason")
register(errors.InvalidRide, RoboCorba.InvalidRide, "field", "reason")
register(errors.ElevatorFull, RoboCorba.ElevatorFull, "elevator", "limit")
register(errors.InvalidReservation, RoboCorba.InvalidReservation, "field", "reason")
register(errors.ReservationsFull, RoboCorba.ReservationsFull, "limit")
register(errors.InvalidPicture, RoboCorba.InvalidPicture, "field", "reason")
register(errors.UnknownRobot, RoboCorba.UnknownRobot, "name")
register(errors.UnknownBody, RoboCorba.UnknownBody, "name")
register(errors.InvalidChoice, RoboCorba.InvalidSetting, "field", "reason")
register(errors.InvalidMission, RoboCorba.InvalidMission, "field", "reason")
register_with(
    errors.NoRoom, RoboCorba.InvalidMission, lambda error: RoboCorba.InvalidMission(error.field, error.reason)
)
register(errors.StaleMission, RoboCorba.StaleMission, "name", "expected", "current")
register(errors.UnknownMission, RoboCorba.UnknownMission, "name")
register(errors.SensorRefused, RoboCorba.SensorRefused, "name", "reason")
register_system(errors.SessionExpired, CORBA.OBJECT_NOT_EXIST)
register_system(errors.SimulationBusy, CORBA.TRANSIENT)

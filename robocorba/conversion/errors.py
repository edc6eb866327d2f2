"""Domain errors to IDL exceptions, and IDL exceptions to sentences for people."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NoReturn

import CosEventChannelAdmin
import CosEventComm
from omniORB import CORBA

from robocorba import errors
from robocorba.conversion import maps, paths
from robocorba.stubs import RoboCorba

#: Of a text in an exception: what was wrong may have been of any length.
MOST_TEXT = 500


def raise_idl(error: errors.RoboCorbaError) -> NoReturn:
    """Raise the IDL exception that says what a domain error says."""
    make = _EXCEPTIONS.get(type(error))
    if make is None:
        # The store failed: nothing was changed. Anything else would be a fault of the servant.
        raise CORBA.PERSIST_STORE(0, CORBA.COMPLETED_NO) from error
    raise _shortened(make(error)) from error


def _shortened(exception: Any) -> Any:
    """The same with its texts cut."""
    for member, value in vars(exception).items():
        if isinstance(value, str) and len(value) > MOST_TEXT:
            setattr(exception, member, value[:MOST_TEXT])
    return exception


def _id(error: Any) -> Any:
    return maps.element_id(error.kind, error.floor, error.name)


_EXCEPTIONS: dict[type, Callable[[Any], Exception]] = {
    errors.InvalidElement: lambda e: RoboCorba.InvalidElement(_id(e), e.reason),
    errors.UnknownElement: lambda e: RoboCorba.UnknownElement(_id(e)),
    errors.DuplicateElement: lambda e: RoboCorba.DuplicateElement(_id(e)),
    errors.StaleEdit: lambda e: RoboCorba.StaleEdit(_id(e), e.expected, e.current),
    errors.StaleVersion: lambda e: RoboCorba.StaleVersion(e.expected, e.current),
    errors.NothingToUndo: lambda e: RoboCorba.NothingToUndo(),
    errors.NothingToRedo: lambda e: RoboCorba.NothingToRedo(),
    errors.VersionUnavailable: lambda e: RoboCorba.VersionUnavailable(e.version, e.oldest, e.current),
    errors.TransactionClosed: lambda e: RoboCorba.TransactionClosed(),
    errors.TooManyTransactions: lambda e: RoboCorba.TooManyTransactions(e.limit),
    errors.InvalidPoint: lambda e: RoboCorba.InvalidPoint(e.which, e.field, e.reason),
    errors.InvalidRequest: lambda e: RoboCorba.InvalidRequest(e.field, e.reason),
    errors.UnknownFloor: lambda e: RoboCorba.UnknownFloor(e.which, e.floor, list(e.known)),
    errors.NotFree: lambda e: RoboCorba.NotFree(
        e.which, RoboCorba.Point(e.floor, e.x, e.y), e.obstacle, e.clearance_m, e.required_m
    ),
    errors.PlanningTimeout: lambda e: CORBA.TIMEOUT(0, CORBA.COMPLETED_NO),
    errors.InvalidScan: lambda e: RoboCorba.InvalidScan(e.field, e.reason),
    errors.SensorBehind: lambda e: RoboCorba.SensorBehind(e.lag_s, e.limit_s),
    errors.InvalidDescription: lambda e: RoboCorba.InvalidDescription(e.field, e.reason),
    errors.NameTaken: lambda e: RoboCorba.NameTaken(e.name),
    errors.PlaceTaken: lambda e: RoboCorba.PlaceTaken(RoboCorba.Point(e.floor, e.x, e.y), e.blocker),
    errors.ServerFull: lambda e: RoboCorba.ServerFull(e.limit, e.now, e.retry_s),
    errors.InvalidCommand: lambda e: RoboCorba.InvalidCommand(e.field, e.reason),
    errors.CannotGrip: lambda e: RoboCorba.CannotGrip(e.what, e.reason),
    errors.InvalidRide: lambda e: RoboCorba.InvalidRide(e.field, e.reason),
    errors.ElevatorFull: lambda e: RoboCorba.ElevatorFull(e.elevator, e.limit),
    errors.InvalidReservation: lambda e: RoboCorba.InvalidReservation(e.field, e.reason),
    errors.ReservationsFull: lambda e: RoboCorba.ReservationsFull(e.limit),
    errors.InvalidPicture: lambda e: RoboCorba.InvalidPicture(e.field, e.reason),
    errors.UnknownRobot: lambda e: RoboCorba.UnknownRobot(e.name),
    errors.InvalidChoice: lambda e: RoboCorba.InvalidSetting(e.field, e.reason),
    errors.InvalidMission: lambda e: RoboCorba.InvalidMission(e.field, e.reason),
    errors.StaleMission: lambda e: RoboCorba.StaleMission(e.name, e.expected, e.current),
    errors.UnknownMission: lambda e: RoboCorba.UnknownMission(e.name),
    errors.SessionExpired: lambda e: CORBA.OBJECT_NOT_EXIST(0, CORBA.COMPLETED_NO),
    errors.SimulationBusy: lambda e: CORBA.TRANSIENT(0, CORBA.COMPLETED_NO),
    errors.InvalidEvent: lambda e: RoboCorba.InvalidEvent(e.field, e.reason),
    errors.InvalidSubscription: lambda e: RoboCorba.InvalidSubscription(e.where, e.reason),
    errors.InvalidQueue: lambda e: RoboCorba.InvalidQueue(e.field, e.reason),
    errors.TooManyProxies: lambda e: RoboCorba.TooManyProxies(e.limit),
    errors.UnknownSubscription: lambda e: RoboCorba.UnknownSubscription(e.name),
    errors.UnknownPeer: lambda e: RoboCorba.UnknownPeer(e.peer, list(e.known)),
    errors.InvalidPeer: lambda e: RoboCorba.InvalidPeer(e.field, e.reason),
    errors.SessionOver: lambda e: RoboCorba.SessionOver(),
    errors.AlreadyConnected: lambda e: CosEventChannelAdmin.AlreadyConnected(),
    errors.Disconnected: lambda e: CosEventComm.Disconnected(),
    errors.ProxyGone: lambda e: CORBA.OBJECT_NOT_EXIST(0, CORBA.COMPLETED_NO),
    errors.InvalidProgram: lambda e: RoboCorba.InvalidProgram(e.icon, e.parameter, e.reason),
    errors.IllegalOrder: lambda e: RoboCorba.IllegalOrder(e.order, e.condition),
    errors.UnknownAdaptor: lambda e: RoboCorba.UnknownAdaptor(e.name, list(e.known)),
    errors.AdaptorFailed: lambda e: RoboCorba.AdaptorFailed(e.cause),
    errors.UnitFailed: lambda e: RoboCorba.AdaptorFailed(e.cause),
    errors.RobotLost: lambda e: RoboCorba.AdaptorFailed(e.cause),
    errors.UnknownPlan: lambda e: RoboCorba.UnknownPlan(e.name),
    errors.NoPath: lambda e: RoboCorba.NoPath(
        e.reason, [RoboCorba.Blocker(maps.element_id(b.kind, b.floor, b.name), b.reason) for b in e.blockers]
    ),
}


def translating(method: Callable[..., Any]) -> Callable[..., Any]:
    """A servant's method whose domain errors reach the caller as IDL exceptions."""

    @functools.wraps(method)
    def call(*arguments: Any) -> Any:
        try:
            return method(*arguments)
        except errors.RoboCorbaError as error:
            raise_idl(error)

    return call


def error_of(exception: Any) -> str:
    """One sentence for a person about an IDL exception."""
    error = domain_error(exception)
    return str(error) if error else f"{type(exception).__name__}: {exception}"


def domain_error(exception: Any) -> Exception | None:
    """The domain error that an IDL exception stands for, None for any other exception."""
    make = _DOMAIN_ERRORS.get(type(exception))
    return make(exception) if make else None


_DOMAIN_ERRORS: dict[type, Callable[[Any], Exception]] = {
    RoboCorba.InvalidElement: lambda e: errors.InvalidElement(*_words(e.id), e.reason),
    RoboCorba.UnknownElement: lambda e: errors.UnknownElement(*_words(e.id)),
    RoboCorba.DuplicateElement: lambda e: errors.DuplicateElement(*_words(e.id)),
    RoboCorba.StaleEdit: lambda e: errors.StaleEdit(*_words(e.id), e.expected, e.current),
    RoboCorba.StaleVersion: lambda e: errors.StaleVersion(e.expected, e.current),
    RoboCorba.InvalidMap: lambda e: errors.MapFileError("map", e.line, e.key, e.reason),
    RoboCorba.InvalidPoint: lambda e: errors.InvalidPoint(e.which, e.field, e.reason),
    RoboCorba.InvalidRequest: lambda e: errors.InvalidRequest(e.field, e.reason),
    RoboCorba.UnknownFloor: lambda e: errors.UnknownFloor(e.which, e.floorName, e.known),
    RoboCorba.NotFree: lambda e: errors.NotFree(
        e.which, *paths.place_of(e.position), e.obstacle, e.clearance, e.required
    ),
    RoboCorba.InvalidScan: lambda e: errors.InvalidScan(e.field, e.reason),
    RoboCorba.SensorBehind: lambda e: errors.SensorBehind(e.lag, e.limit),
    RoboCorba.InvalidDescription: lambda e: errors.InvalidDescription(e.field, e.reason),
    RoboCorba.NameTaken: lambda e: errors.NameTaken(e.name),
    RoboCorba.PlaceTaken: lambda e: errors.PlaceTaken(*paths.place_of(e.place), e.by),
    RoboCorba.ServerFull: lambda e: errors.ServerFull(e.limit, e.now, e.retryAfter),
    RoboCorba.InvalidCommand: lambda e: errors.InvalidCommand(e.field, e.reason),
    RoboCorba.CannotGrip: lambda e: errors.CannotGrip(e.what, e.reason),
    RoboCorba.InvalidRide: lambda e: errors.InvalidRide(e.field, e.reason),
    RoboCorba.ElevatorFull: lambda e: errors.ElevatorFull(e.elevator, e.limit),
    RoboCorba.InvalidReservation: lambda e: errors.InvalidReservation(e.field, e.reason),
    RoboCorba.ReservationsFull: lambda e: errors.ReservationsFull(e.limit),
    RoboCorba.InvalidPicture: lambda e: errors.InvalidPicture(e.field, e.reason),
    RoboCorba.UnknownRobot: lambda e: errors.UnknownRobot(e.name),
    RoboCorba.InvalidSetting: lambda e: errors.InvalidChoice(e.field, e.reason),
    RoboCorba.InvalidMission: lambda e: errors.InvalidMission(e.field, e.reason),
    RoboCorba.StaleMission: lambda e: errors.StaleMission(e.name, e.expected, e.current),
    RoboCorba.UnknownMission: lambda e: errors.UnknownMission(e.name),
    RoboCorba.InvalidEvent: lambda e: errors.InvalidEvent(e.field, e.reason),
    RoboCorba.InvalidSubscription: lambda e: errors.InvalidSubscription(e.where, e.reason),
    RoboCorba.InvalidQueue: lambda e: errors.InvalidQueue(e.field, e.reason),
    RoboCorba.TooManyProxies: lambda e: errors.TooManyProxies(e.limit),
    RoboCorba.UnknownSubscription: lambda e: errors.UnknownSubscription(e.name),
    RoboCorba.UnknownPeer: lambda e: errors.UnknownPeer(e.peer, e.known),
    RoboCorba.InvalidPeer: lambda e: errors.InvalidPeer(e.field, e.reason),
    RoboCorba.InvalidProgram: lambda e: errors.InvalidProgram(e.icon, e.parameter, e.reason),
    RoboCorba.IllegalOrder: lambda e: errors.IllegalOrder(e.order, e.condition),
    RoboCorba.UnknownAdaptor: lambda e: errors.UnknownAdaptor(e.name, e.known),
    RoboCorba.AdaptorFailed: lambda e: errors.AdaptorFailed(e.cause),
    RoboCorba.UnknownPlan: lambda e: errors.UnknownPlan(e.name),
    RoboCorba.NoPath: lambda e: errors.NoPath(e.reason, [errors.Blocker(*_words(b.id), b.reason) for b in e.blockers]),
}


def _words(struct: Any) -> tuple[str, str, str]:
    return maps.kind_of(struct.kind).value, struct.onFloor, struct.name

"""Every domain error that may leave a process has an IDL exception; a process loads only what it translates."""

from __future__ import annotations

import inspect
import pkgutil
import subprocess
import sys
from importlib import import_module

import pytest
from omniORB import CORBA

from robocorba import errors
from robocorba.corba.calls import error_of
from robocorba.corba.conversion.errors import MAX_TEXT, domain_error, raise_idl, registered, translating
from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.events import UnknownPeer
from robocorba.errors.maps import InvalidElement, MapFileError, StaleEdit
from robocorba.errors.paths import Blocker, InvalidRequest, NoPath, UnknownFloor
from robocorba.errors.robots import RobotLost, ServerAway
from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import NoRoom, PlaceTaken, ServerFull
from robocorba.stubs import RoboCorba

#: Errors that end within their process: reported in a program's or mission's result, in the log or on stderr.
LOCAL = {
    *("AlreadyRunning", "PortInUse", "StateMismatch", "StartFailed"),
    *("VideoError", "InvalidRecording", "UpdateMismatch", "NoRide", "GridTooLarge"),
    *("Unreachable", "InvalidPlan", "StalePlan", "InvalidCarry", "ImpossibleCarry", "RideLost"),
    *("GoalReached", "InTheWay", "MissionTakenOver"),
    *("NotDelivered", "Unconfirmed", "Refused", "InternalFault", "ClientGone", "RobotHeld"),
    *("OutputExists", "OutputIsInput", "LimitExceeded", "WorkEnded"),
}


def classes() -> set[type[RoboCorbaError]]:
    """Of all errors."""
    modules = [import_module(f"{errors.__name__}.{module.name}") for module in pkgutil.iter_modules(errors.__path__)]
    found = {value for module in modules for value in vars(module).values() if inspect.isclass(value)}
    return {value for value in found if issubclass(value, RoboCorbaError)}


def test_every_error_is_translated_or_stays_within_its_process() -> None:
    ours = classes()
    leaves = {one for one in ours if not ours & set(one.__subclasses__())}
    assert {one.__name__ for one in leaves - registered()} == LOCAL


@pytest.mark.parametrize(
    "error",
    [
        InvalidElement("wall", "L1", "w", "it is too short"),
        StaleEdit("node", "L1", "n", 3, 4),
        InvalidRequest("radius", "must be positive"),
        UnknownFloor("start", "L9", ("L1", "L2")),
        NoPath("nothing leads there", [Blocker("door", "L1", "d", "is locked")]),
        PlaceTaken("L1", 1.0, 2.0, "robot B"),
        ServerFull(10, 10, 2.0),
        UnknownPeer("lab", ("hall",)),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_means_the_same_to_the_caller(error: RoboCorbaError) -> None:
    with pytest.raises(CORBA.UserException) as raised:
        raise_idl(error)
    again = domain_error(raised.value)
    assert type(again) is type(error)
    assert str(again) == str(error) == error_of(raised.value)


def test_several_errors_share_an_exception() -> None:
    with pytest.raises(RoboCorba.AdaptorFailed):
        raise_idl(RobotLost("no answer"))
    with pytest.raises(RoboCorba.AdaptorFailed):
        raise_idl(ServerAway("no answer"))
    with pytest.raises(RoboCorba.InvalidMission):
        raise_idl(NoRoom("name", "1000 missions are stored already; remove one"))


@pytest.mark.parametrize("error", [ServiceError("no room"), MapFileError("map.sqlite", 0, "", "no room")])
def test_a_store_that_fails_is_a_system_exception_and_logged(
    error: RoboCorbaError, caplog: pytest.LogCaptureFixture
) -> None:
    """No operation declares it: as a user exception it would arrive as UNKNOWN."""
    with pytest.raises(CORBA.PERSIST_STORE) as raised:
        raise_idl(error)
    assert raised.value.completed == CORBA.COMPLETED_NO
    assert str(error) in caplog.text


def test_texts_are_short() -> None:
    with pytest.raises(RoboCorba.InvalidRequest) as raised:
        raise_idl(InvalidRequest("field" * MAX_TEXT, "reason"))
    assert len(raised.value.field) == MAX_TEXT


def test_an_error_without_an_exception_is_a_defect() -> None:
    @translating
    def method() -> None:
        raise FieldError("a", "b")

    with pytest.raises(CORBA.INTERNAL):
        method()


def test_an_event_channel_loads_no_maps_and_compiles_nothing() -> None:
    heavy = "{'numpy', 'scipy', 'shapely', 'numba', 'robocorba.maps', 'robocorba.planning'}"
    code = f"import robocorba.servers.event_channel, sys; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"

"""Values of the domain in the IDL and back: errors, scans, and texts."""

from __future__ import annotations

import inspect
import itertools
import math
import pkgutil
import subprocess
import sys
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from robocorba import errors
from robocorba.errors.base import FieldError, RoboCorbaError
from robocorba.errors.events import UnknownPeer
from robocorba.errors.maps import InvalidElement, MapFileError, StaleEdit
from robocorba.errors.paths import Blocker, InvalidRequest, NoPath, UnknownFloor
from robocorba.errors.robots import RobotLost, ServerAway
from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import NoRoom, PlaceTaken, ServerFull
from robocorba.orb.calls import error_of
from robocorba.orb.exceptions import MAX_TEXT, domain_error, raise_idl, registered, translating
from robocorba.orb.texts import check_of, refuse_unreadable_texts
from robocorba.simulation.corba import scans
from robocorba.stubs import RoboCorba, RoboCorba__POA
from tests.simulation.places import scan

#: Errors that end within their process: reported in a program's or mission's result, in the log or on stderr.
LOCAL = {
    *("AlreadyRunning", "PortInUse", "StartFailed"),
    *("InvalidRecording", "UpdateMismatch", "NoRide", "GridTooLarge"),
    *("Unreachable", "InvalidPlan", "StalePlan", "ImpossibleCarry", "RideLost"),
    *("GoalReached", "InTheWay", "MissionTakenOver"),
    *("NotDelivered", "Unconfirmed", "Refused", "InternalFault", "ClientGone", "RobotHeld"),
    *("OutputError", "LimitExceeded", "WorkEnded", "Blind", "Bumped", "OutdatedChannel", "TooFewEvents"),
}


def classes() -> set[type[RoboCorbaError]]:
    """Of all errors."""
    modules = [import_module(f"{errors.__name__}.{module.name}") for module in pkgutil.iter_modules(errors.__path__)]
    found = {value for module in modules for value in vars(module).values() if inspect.isclass(value)}
    return {value for value in found if issubclass(value, RoboCorbaError)}


def test_errors_and_their_exceptions() -> None:
    ours = classes()
    leaves = {one for one in ours if not ours & set(one.__subclasses__())}
    assert {one.__name__ for one in leaves - registered()} == LOCAL
    for error, shared in (
        (RobotLost("no answer"), RoboCorba.AdaptorFailed),
        (ServerAway("no answer"), RoboCorba.AdaptorFailed),
        (NoRoom("name", "1000 missions are stored already; remove one"), RoboCorba.InvalidMission),
    ):
        with pytest.raises(shared):
            raise_idl(error)
    with pytest.raises(RoboCorba.InvalidRequest) as raised:
        raise_idl(InvalidRequest("field" * MAX_TEXT, "reason"))
    assert len(raised.value.field) == MAX_TEXT

    @translating
    def method() -> None:
        raise FieldError("a", "b")  # one without an exception is a defect

    with pytest.raises(CORBA.INTERNAL):
        method()
    heavy = "{'numpy', 'scipy', 'shapely', 'numba', 'robocorba.map_editor', 'robocorba.planning'}"
    code = f"import robocorba.servers.event_channel, sys; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_an_error_means_the_same_to_the_caller(caplog: pytest.LogCaptureFixture) -> None:
    for error in (
        InvalidElement("wall", "L1", "w", "it is too short"),
        StaleEdit("node", "L1", "n", 3, 4),
        InvalidRequest("radius", "must be positive"),
        UnknownFloor("start", "L9", ("L1", "L2")),
        NoPath("nothing leads there", [Blocker("door", "L1", "d", "is locked")]),
        PlaceTaken("L1", 1.0, 2.0, "robot B"),
        ServerFull(10, 10, 2.0),
        UnknownPeer("lab", ("hall",)),
    ):
        with pytest.raises(CORBA.UserException) as raised:
            raise_idl(error)
        again = domain_error(raised.value)
        assert type(again) is type(error)
        assert str(again) == str(error) == error_of(raised.value)
    # A store that fails: no operation declares it; as a user exception it would arrive as UNKNOWN.
    for failure in (ServiceError("no room"), MapFileError("map.sqlite", 0, "", "no room")):
        with pytest.raises(CORBA.PERSIST_STORE) as failed:
            raise_idl(failure)
        assert failed.value.completed == CORBA.COMPLETED_NO
        assert str(failure) in caplog.text


SEEN = scan(distances=np.array([1.0, 8.0]), hits=np.array([True, False]), rim_m=0.3, noise=(0.1, 0.2, 0.3, 7))


def test_a_scan_survives_the_way_to_the_idl_and_back_unless_it_is_inconsistent() -> None:
    back = scans.robot_scan_of(scans.robot_scan(SEEN))
    assert back._replace(distances=None, hits=None) == SEEN._replace(distances=None, hits=None)
    assert (back.distances.tolist(), back.hits.tolist()) == ([1.0, 8.0], [True, False])
    for part, member, value in (
        ("", "hits", b"\x01"),
        *(("seen", "distances", distances) for distances in ([1.0, math.nan], [1.0, 2.0, 3.0])),
        ("seen", "time", math.inf),
        ("spec", "rays", 3),
        ("spec", "range", math.nan),
        ("", "at", SEEN.at._replace(x=math.nan)),
    ):
        wrong = scans.robot_scan(SEEN)
        setattr(getattr(wrong, part) if part else wrong, member, value)
        with pytest.raises(CORBA.BAD_PARAM):
            scans.robot_scan_of(wrong)
    with pytest.raises(CORBA.BAD_PARAM):
        scans.robot_scan_of(scans.robot_scan(scan(distances=np.ones(10_000), hits=np.ones(10_000, bool))))


NUL, LOST = "a\0b", "a\N{REPLACEMENT CHARACTER}b"
REASONS = [(NUL, CORBA.BAD_PARAM), (LOST, CORBA.DATA_CONVERSION)]


class Supervisor(RoboCorba__POA.Supervisor):
    """Notes what it is asked."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def endRobot(self, name: str) -> None:
        self.asked.append(name)

    def startRobot(self, robot_order: Any) -> None:
        self.asked.append(robot_order.name)

    def processes(self) -> list[Any]:
        return []


def checked(**members: Any) -> Any:
    """A servant of a class that checks its texts. members: of the class."""
    servant = type("Checked", (Supervisor,), members)
    refuse_unreadable_texts(servant)
    return servant()


def robot_order(name: str = "A", arguments: tuple[str, ...] = ()) -> Any:
    return RoboCorba.RobotOrder(name, "simulated", list(arguments), "L1", False, 0.0, 0.0, 0.0, "")


def test_unreadable_texts_do_not_reach_a_servant() -> None:
    for text, refusal in REASONS:
        servant = checked()
        for operation, argument in (
            *((servant.endRobot, text), (servant.startRobot, robot_order(text))),
            (servant.startRobot, robot_order("A", ("--x", text))),
        ):
            with pytest.raises(refusal):
                operation(argument)
        assert not servant.asked
        servant.endRobot("ナビ")
        servant.startRobot(robot_order("two\nlines"))
        assert servant.asked == ["ナビ", "two\nlines"]


def test_texts_are_checked_in_unions_but_not_by_each_servant() -> None:
    assert type(checked()).processes is Supervisor.processes
    servant = checked(checks_texts_itself=frozenset({"endRobot"}))
    servant.endRobot(NUL)
    assert servant.asked == [NUL]
    with pytest.raises(CORBA.BAD_PARAM):
        servant.startRobot(robot_order(NUL))
    check = check_of(RoboCorba._d_Element)
    assert check

    def check_both(node: str, edge: str) -> None:
        check(RoboCorba.Element(RoboCorba.NODE_ELEMENT, RoboCorba.PathNode("n", RoboCorba.XY(0.0, 0.0), node)))
        edges = RoboCorba.PathEdge("e", "a", "b", False, 0.0, 0.0, ["g", edge])
        check(RoboCorba.Element(RoboCorba.EDGE_ELEMENT, edges))

    check_both("", "")
    for (text, refusal), is_first in itertools.product(REASONS, (True, False)):
        with pytest.raises(refusal):
            check_both(*((text, "") if is_first else ("", text)))
    assert check_of(RoboCorba._d_Velocity) is check_of(RoboCorba._d_DoubleSeq) is None

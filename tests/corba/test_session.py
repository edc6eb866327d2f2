"""A robot's client of its session: which references it holds, and what their loss means."""

from __future__ import annotations

import contextlib
from typing import Any

import pytest
from omniORB import CORBA

from robocorba.corba.remote import session as module
from robocorba.corba.remote.session import RemoteSession
from robocorba.errors.robots import RobotLost
from robocorba.errors.simulation import PlaceTaken
from robocorba.sensing.fan import LASER
from robocorba.sensing.scan import Mount, ScanSpec
from robocorba.simulation.registry import Description, Pose
from robocorba.stubs import RoboCorba


class Server:
    """A simulation server, its ORB and its only session."""

    def __init__(self) -> None:
        self.registered, self.has_sensor, self.heartbeats = 0, True, 0
        #: Floors without a free place, and those on which robots logged on.
        self.full, self.started_on = set[str](), list[str]()
        self.riding = RoboCorba.Ride(RoboCorba.NO_RIDE, "", "", "", 0)
        #: Calls that fail because the server is away, how, and all calls by their names.
        self.failing, self.failure, self.calls = 0, CORBA.COMM_FAILURE, list[str]()

    def resolve(self, *arguments: Any) -> Server:
        return self

    def uri(self, reference: Any) -> str:
        return "session"

    def reference(self, uri: str, interface: Any, call_timeout_s: float) -> Server:
        return self

    def registerRobot(self, about: Any) -> Server:
        if about.start.floor in self.full:
            raise RoboCorba.PlaceTaken(RoboCorba.Point(about.start.floor, about.start.x, about.start.y), "a cabin")
        self.started_on.append(about.start.floor)
        self.registered += 1
        return self

    def _get_sensor(self) -> Server:
        if not self.has_sensor:
            raise CORBA.TRANSIENT()
        return self

    def deregister(self) -> None:
        self.registered -= 1

    def heartbeat(self) -> None:
        self.heartbeats += 1
        if not self.registered:
            raise CORBA.OBJECT_NOT_EXIST()

    def state(self) -> Any:
        at, still = RoboCorba.Pose("L1", 1.0, 2.0, 0.0), RoboCorba.Velocity(0.0, 0.0, 0.0)
        return RoboCorba.RobotState(1.0, at, still, "", self.riding, 0, "")

    def brake(self) -> None:
        self._answer("brake")

    def command(self, velocity: Any, valid_s: float) -> None:
        self._answer("command")

    def callElevator(self, elevator: str, destination: str) -> None:
        self._answer("callElevator")

    def scan(self, at: Any, mount: Any, spec: Any) -> None:
        self._answer("scan")

    def _answer(self, operation: str) -> None:
        self.calls.append(operation)
        if self.failing:
            self.failing -= 1
            raise self.failure(0, CORBA.COMPLETED_MAYBE)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    monkeypatch.setattr(module, "set_call_timeout", lambda reference, timeout_s: None)
    return Server()


@pytest.fixture
def session(server: Server) -> RemoteSession:
    return RemoteSession(server, Description("A", Pose("L1", 1.0, 2.0, 0.0), 0.4))  # type: ignore[arg-type]


def test_a_robot_is_registered_once(session: RemoteSession, server: Server) -> None:
    session.log_on()
    session.log_on()
    session.heartbeat()
    assert server.registered == 1


def test_after_logging_off_calls_fail(session: RemoteSession, server: Server) -> None:
    session.log_on()
    session.log_off()
    session.log_off()
    assert server.registered == 0
    with pytest.raises(RobotLost, match="A is not logged on"):
        session.heartbeat()


def test_a_robot_that_the_server_logged_off_registers_again(session: RemoteSession, server: Server) -> None:
    session.log_on()
    server.registered = 0
    with pytest.raises(RobotLost, match="has logged the robot off"):
        session.heartbeat()
    session.log_on()
    session.heartbeat()


def test_a_robot_logs_on_again_on_a_floor_that_has_another_name_now(session: RemoteSession, server: Server) -> None:
    session.log_on()
    session.state()
    session.floors_since = lambda floor: {"L1": "ground", "L2": "L1"}
    server.registered = 0
    session.log_on()
    assert server.started_on == ["L1", "ground"]


@pytest.mark.parametrize(("phase", "floors"), [("RIDING", ["L1", "top"]), ("WAITING_FOR_CABIN", ["L1"])])
def test_a_robot_that_was_logged_off_in_a_cabin_logs_on_where_that_arrived(
    session: RemoteSession, server: Server, phase: str, floors: list[str]
) -> None:
    server.riding = RoboCorba.Ride(getattr(RoboCorba, phase), "E1", "L1", "L2", 0)
    session.log_on()
    session.state()
    session.floors_since = lambda floor: {"L1": "L1", "L2": "top"}
    server.registered, server.full = 0, {"L1"}
    with contextlib.suppress(PlaceTaken):
        session.log_on()
    assert server.started_on == floors


def test_a_session_without_a_sensor_is_given_back(session: RemoteSession, server: Server) -> None:
    server.has_sensor = False
    with pytest.raises(RobotLost):
        session.log_on()
    assert server.registered == 0


def test_a_heartbeat_right_after_another_call_is_left_out(
    session: RemoteSession, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    session.log_on()
    session.heartbeat()
    assert server.heartbeats == 1
    session.heartbeat()
    assert server.heartbeats == 1
    now += module.RENEWED_S + 0.1
    session.heartbeat()
    assert server.heartbeats == 2


@pytest.mark.parametrize("failure", [CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT])
def test_a_server_that_restarts_or_is_held_up_is_waited_for(
    session: RemoteSession, server: Server, failure: type[CORBA.SystemException]
) -> None:
    session.log_on()
    server.failing, server.failure = 3, failure
    session.brake()
    assert server.calls == ["brake"] * 4


def test_a_server_that_stays_away_is_waited_for_in_vain(
    session: RemoteSession, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "RETRY_S", 0.1)
    session.log_on()
    server.failing = 1000
    with pytest.raises(RobotLost, match="does not answer"):
        session.brake()
    assert 1 < len(server.calls) < 20


@pytest.mark.parametrize("failure", [CORBA.COMM_FAILURE, CORBA.TIMEOUT])
def test_a_command_is_not_sent_again(
    session: RemoteSession, server: Server, failure: type[CORBA.SystemException]
) -> None:
    """An emergency stop may have come meanwhile."""
    session.log_on()
    server.failing, server.failure = 1, failure
    session.command((0.3, 0.0, 0.0), 0.1)
    assert (server.calls, server.heartbeats) == (["command"], 1)


def test_an_actual_robot_does_not_wait_for_a_restart(session: RemoteSession, server: Server) -> None:
    session.log_on()
    session.announce_body(False)
    server.failing = 2
    for call in (session.brake, lambda: session.command((0.3, 0.0, 0.0), 0.1)):
        with pytest.raises(RobotLost, match="does not answer"):
            call()
    assert server.calls == ["brake", "command"]


def test_what_could_be_done_twice_is_not_repeated(session: RemoteSession, server: Server) -> None:
    session.log_on()
    server.failing = 1
    with pytest.raises(RobotLost, match="does not answer"):
        session.call_elevator("E1", "L2")
    assert server.calls == ["callElevator"]


@pytest.mark.parametrize("failure", [CORBA.TIMEOUT, CORBA.OBJECT_NOT_EXIST])
def test_the_server_that_does_not_answer_is_named(
    session: RemoteSession, server: Server, failure: type[CORBA.SystemException]
) -> None:
    session.log_on()
    server.failing, server.failure = 1, failure
    with pytest.raises(RobotLost, match="the virtual sensor server does not answer"):
        session.scan(Pose("L1", 1.0, 2.0, 0.0), Mount(0.0, 0.0, 0.0), ScanSpec(LASER))

"""Emergency stop of robots by every way there is, for operators; and what shows that they stand.

The names of robots and servers can be bound by every client, so what answers to a name proves nothing. The simulation
server at the address in the state folder shows how the bodies move, and stop targets, whose references are secret,
speak for their robots. The naming service is not needed for either. Without a state folder, as on another machine, the
simulation server is found by its name."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import EventClient
from robocorba.orb.guard import Guard
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import CALM, RemoteAgent, order_all, robots
from robocorba.robot.corba.stop_target import stop_at
from robocorba.simulation.corba import sessions
from robocorba.simulation.emergency_stops import UNTIL_RESET, StopAnswer, StopEvent, StopRecord, StopState
from robocorba.stubs import RoboCorba
from robocorba.system.background import Background, Workers
from robocorba.system.names import CHANNELS, STOP_EVENT
from robocorba.system.roles import Role
from robocorba.system.stop_latch import EMERGENCY_STOP

#: In place of a name: robots that only the simulation server knows.
OTHERS = "*"
#: Time limit of a stop [s].
LIMIT_S = 6.0
#: Timeout of a call to the simulation server [s].
SERVER_TIMEOUT_S = 1.5
#: Timeout for the names in the naming service [s].
NAMES_S = 1.0


@dataclass(frozen=True)
class StopAddresses:
    """What the state folder knows. server: HOST:PORT of the simulation server, empty if unknown. channels: HOST:PORT of
    event channels by name. targets: of robots by name. guard: of a guarded system, else None."""

    server: str = ""
    channels: Mapping[str, str] = field(default_factory=dict)
    targets: Mapping[str, StopRecord] = field(default_factory=dict)
    guard: Guard | None = None

    def key(self, name: str) -> str:
        """The object key by which an operator calls a server's object."""
        return self.guard.key(name, Role.OPERATOR) if self.guard else name


class Verdict(NamedTuple):
    """stands: whether it is shown that the robot stands. text: by what, or why not. is_known: False if only a name is
    known, and the simulation server, which answers, has no such robot."""

    robot: str
    stands: bool
    text: str
    is_known: bool = True


def stop_robots(
    orb: Orb, names: Sequence[str], addresses: StopAddresses, reason: str = EMERGENCY_STOP
) -> list[Verdict]:
    """Stop robots, without names all; returns after LIMIT_S at the latest. Does not raise.

    Without names and while the simulation server does not answer, a verdict about OTHERS says so."""
    return _Stop(orb, names, addresses, reason).run()


def end_stop_of_all(orb: Orb, addresses: StopAddresses) -> None:
    """Let robots that log on from now on move, after a stop of all; those that it has stopped stay so until each is
    reset. Raises NotReachable."""
    with (
        translated("the simulation server"),
        contextlib.suppress(CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT),
    ):  # of an earlier release
        server = _simulation_server(orb, addresses)
        server.endStopOfAll(server._get_stopOfAll().number)


def reset_robots(orb: Orb, names: Sequence[str], addresses: StopAddresses) -> Iterator[tuple[str, str]]:
    """End the stop of robots, without names of all; each name with the reason if it is still stopped, else empty.
    OTHERS are the robots that log on later."""
    if not names:
        problem = ""
        try:
            end_stop_of_all(orb, addresses)
        except NotReachable as error:
            problem = f"robots that log on stay stopped: {error}"
        yield OTHERS, problem
    yield from order_all(orb, names or robots(orb), RemoteAgent.reset_stop if names else _reset_if_stopped, CALM)


def _reset_if_stopped(agent: RemoteAgent) -> None:
    try:
        agent.reset_stop()
    except IllegalOrder:
        if agent.state().condition is AgentCondition.STOPPED:
            raise


def _simulation_server(orb: Orb, addresses: StopAddresses) -> Any:
    if address := addresses.server:
        uri = orb.uri_at(address, addresses.key("SimulationServer"))
        return orb.reference(uri, RoboCorba.SimulationServer, SERVER_TIMEOUT_S)
    return orb.resolve("SimulationServer", RoboCorba.SimulationServer, NAMES_S, SERVER_TIMEOUT_S)


class _Stop:
    def __init__(self, orb: Orb, names: Sequence[str], addresses: StopAddresses, reason: str) -> None:
        self._orb, self._names, self._addresses, self._reason = orb, tuple(names), addresses, reason
        self._deadline = time.monotonic() + LIMIT_S
        #: What the simulation server shows; `_has_answered`: its last call succeeded, else `_problem` is the reason.
        self._shown: dict[str, StopState] = {}
        self._has_answered, self._problem = False, "the simulation server did not answer"
        #: Whether the server holds robots that log on, too.
        self._holds_all = False
        self._answers: dict[str, StopAnswer] = {}
        #: The problem of each bound name that was called; empty if what is bound to it confirmed the stop.
        self._bound: dict[str, str] = {}

    def run(self) -> list[Verdict]:
        server = self._start(self._by_server)
        others = [self._start(way) for way in (self._by_targets, self._by_names, self._by_events)]
        server.join(self._left_s)
        if self._has_answered and all(state.stands for state in self._shown.values()):
            self._deadline = min(self._deadline, time.monotonic() + 1.0)  # for the other ways
        for other in others:
            other.join(self._left_s)
        names = self._names or sorted({*self._shown, *self._answers, *self._bound, *self._unanswered()})
        verdicts = [self._verdict(name) for name in names]
        if not self._names and not self._has_answered:
            verdicts.append(Verdict(OTHERS, False, f"other robots may move: {self._problem}"))
        elif not self._names:
            verdicts.append(
                Verdict(OTHERS, True, f"robots that log on are stopped, too, {UNTIL_RESET}")
                if self._holds_all
                else Verdict(
                    OTHERS, False, "robots that log on may move: the simulation server is of release 0.1.0", False
                )
            )
        return verdicts

    @property
    def _left_s(self) -> float:
        return max(0.0, self._deadline - time.monotonic())

    def _unanswered(self) -> Sequence[str]:
        """Robots with a stop target that can't be compared with those that the server knows."""
        return () if self._has_answered else tuple(self._addresses.targets)

    def _verdict(self, name: str) -> Verdict:
        state, answer = self._shown.get(name), self._answers.get(name)
        if state is not None and state.stands:
            return Verdict(name, True, "the robot confirms it" if state.is_confirmed else "its body stands")
        if state is not None:
            return Verdict(name, False, f"is not shown to stand: {state.waits_for}")
        if answer is not None and answer.is_stopped and answer.is_confirmed:
            return Verdict(name, True, "the robot confirms it")
        problem = self._bound.get(name, f"did not answer within {LIMIT_S:g} s")
        what = problem or "what is bound to its name says that it has stopped, which proves nothing"
        if self._has_answered:
            return Verdict(name, False, f"{what}; it is not logged on", name in self._addresses.targets)
        return Verdict(name, False, f"{what}; {self._problem}")

    def _start(self, way: Callable[[], None]) -> Background:
        thread = Background(way.__name__.strip("_"), way, self._note)
        thread.start()
        return thread

    def _note(self, reason: str) -> None:
        """A way has failed: robots that no other way shows to stand have this problem."""
        self._problem = reason

    # ---- the ways ----

    def _by_server(self) -> None:
        server: Any = None
        has_stopped = False
        while self._left_s:
            try:
                server = server or _simulation_server(self._orb, self._addresses)
                with translated("the simulation server"):
                    found = self._look_at(server) if has_stopped else server.stopRobots(self._names, self._reason)
                    if not (has_stopped or self._names):
                        with contextlib.suppress(CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT):  # of an earlier release
                            self._holds_all = server._get_stopOfAll().held
                states, has_stopped = [sessions.stop_state_of(state) for state in found], True
            except RoboCorbaError as error:
                self._has_answered, self._problem, server = False, str(error), None
                time.sleep(0.2)
                continue
            self._shown, self._has_answered = {state.robot: state for state in states}, True
            if all(state.stands for state in states):
                return
            time.sleep(0.05)  # while they brake

    def _look_at(self, server: Any) -> Any:
        try:
            return server.stopStates(self._names)
        except CORBA.BAD_OPERATION:  # of an earlier release
            return server.stopRobots(self._names, self._reason)

    def _by_targets(self) -> None:
        def stop(name: str, record: StopRecord) -> None:
            with contextlib.suppress(NotReachable):
                self._answers[name] = stop_at(self._orb, record.target, self._reason)

        targets = self._addresses.targets
        callers = Workers("stop target", 32, self._note)
        for name in self._names or targets:
            if name in targets and targets[name].target:
                callers.submit(stop, name, targets[name])
        callers.finish()

    def _by_names(self) -> None:
        with contextlib.suppress(NotReachable):
            names = self._names or robots(self._orb)
            for name, problem in order_all(self._orb, names, RemoteAgent.stop):
                self._bound[name] = problem

    def _by_events(self) -> None:
        payload = StopEvent(robots=list(self._names), reason=self._reason)
        for name, address in self._channels().items():
            with contextlib.suppress(RoboCorbaError):
                uri = self._orb.uri_at(address, self._addresses.key(f"{CHANNELS}/{name}"))
                found = self._orb.reference(uri, RoboCorba.EventChannel, NAMES_S) if address else None
                with contextlib.closing(EventClient(self._orb, name, timeout_s=NAMES_S, channel_at=found)) as client:
                    # A late event must not stop a robot that was reset.
                    client.push(STOP_EVENT, payload, expiry_s=2.0, retry_s=0.0)

    def _channels(self) -> Mapping[str, str]:
        """Addresses of the channels by name; empty for those that are found by their name."""
        if self._addresses.channels:
            return self._addresses.channels
        with contextlib.suppress(NotReachable):
            return dict.fromkeys(self._orb.names(CHANNELS, NAMES_S), "")
        return {}

"""Robots log on, fall silent, are evicted and kept out, with what they ride, hold and have reserved, and the server is
killed at any moment: against a model. No time passes but that of the test."""

from __future__ import annotations

import copy
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar, TypeVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robocorba.errors.services import ServiceError
from robocorba.errors.simulation import (
    InvalidDescription,
    InvalidReservation,
    InvalidRide,
    NameTaken,
    PlaceTaken,
    ServerFull,
    SessionExpired,
    SimulationError,
    UnknownRobot,
)
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation import building, elevators, management_agent
from robocorba.simulation.attended_time import AttendedTime
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.registry import LEASE_S
from robocorba.simulation.session import Session
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.simulation_loop import SimulationLoop
from robocorba.simulation.state_writer import StateWriter
from robocorba.simulation.store import SimulationStore
from tests.clock import Clock
from tests.simulation.area_model import AreaModel, areas
from tests.simulation.places import robot, tower

T = TypeVar("T")
FLOORS = ("L1", "L2")
#: Where robots log on: A and B beside the table, each with the point of its edge that it can grip.
STARTS = {"A": Pose("L1", 1.0, 2.0, 0.5), "B": Pose("L1", 2.0, 2.95), "C": Pose("L1", 7.0, 2.0, -2.0)}
HANDS = {"A": (1.6, 2.0), "B": (2.0, 2.3)}
PLACES = [*STARTS.values(), Pose("L2", 2.0, 2.0), Pose("L2", 7.0, 7.0, 1.5)]
#: Cycles of the housekeeping [s], and how much of a longer pause counts; sums of both are exact.
TICK_S, PAUSE_S = 0.125, 0.1875
#: A step of the simulation; nobody drives.
STEP_S = 0.25
#: Calls that a logged-on robot may make at any time.
CALLS: list[Callable[[Session], object]] = [
    Session.heartbeat,
    Session.state,
    Session.reservation,
    Session.longest_elevator_wait_s,
    lambda session: session.command(0.0, 0.0, 0.0, 0.0),
    lambda session: session.report_posture([0.1]),
]
#: And those that wait for the simulation.
CHANGES: list[Callable[[Session], object]] = [
    Session.release,
    Session.release_areas,
    Session.cancel_elevator,
    lambda session: session.keep_areas([]),
    lambda session: session.reserve(areas([(0, 0, 0, 1, 1)], FLOORS), 1.0),
    lambda session: session.take_over_areas("A"),
    lambda session: session.call_elevator("E1", "L2"),
    Session.deregister,
]
names = st.sampled_from(sorted(STARTS))
numbers = st.integers(0, len(STARTS) - 1)
boxes = st.lists(
    st.tuples(st.integers(0, 1), st.integers(0, 2), st.just(0), st.just(1), st.just(1)), min_size=1, max_size=2
)


class Cycles(SimulationLoop):
    """Its cycles are called by the test. meanwhile: happens before the next call is executed."""

    meanwhile: Callable[[], object] = staticmethod(lambda: None)

    def do(self, call: Callable[[], T]) -> T:
        meanwhile, self.meanwhile = self.meanwhile, lambda: None
        meanwhile()
        return super().do(call)

    def cycle(self) -> None:
        self._housekeeping()


class Writer(StateWriter):
    """It writes in the caller's thread."""

    last: ClassVar[Writer]

    def __init__(self, store: SimulationStore) -> None:
        super().__init__(store)
        Writer.last = self

    def flush(self) -> None:
        self._write()


class Disk(SimulationStore):
    is_full = False

    def save(self, kind: str, key: str, record: object) -> None:
        if self.is_full:
            raise ServiceError("no space left")
        super().save(kind, key, record)

    def delete(self, kind: str, key: str) -> None:
        if self.is_full:
            raise ServiceError("no space left")
        super().delete(kind, key)


@dataclass
class Member:
    """A logged-on robot of the model."""

    key: str
    pose: Pose
    last_call: float
    is_riding: bool = False
    is_holding: bool = False
    #: Calls in progress.
    calls: int = 0


class LogOn(RuleBasedStateMachine):
    """Each call of a robot that is logged on renews its lease, whatever comes of it."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self._patch = pytest.MonkeyPatch()
        self.clock = Clock()
        self._patch.setattr(management_agent, "time", SimpleNamespace(monotonic=self.clock))
        self._patch.setattr(management_agent, "AttendedTime", partial(AttendedTime, self.clock, PAUSE_S))
        self._patch.setattr(management_agent, "SimulationLoop", Cycles)
        self._patch.setattr(management_agent, "StateWriter", Writer)
        for module in (building, elevators):
            self._patch.setattr(module, "STEP_S", STEP_S)
        self.limit, self.pace, self.is_paused = 3, 1.0, False
        self.here: dict[str, Member] = {}
        self.areas = AreaModel()
        self.kept_out: set[str] = set()
        self.gone: list[Session] = []
        self._open()
        self.agent.configure(limit=self.limit)
        self.note_written()

    def teardown(self) -> None:
        self._store.__exit__(None, None, None)
        self._folder.cleanup()
        self._patch.undo()

    def _open(self) -> None:
        self._store = Disk(Path(self._folder.name) / "simulation.sqlite")
        self.began: list[Session] = []
        self.ended: list[Session] = []
        self.events: list[SimulationEvent] = []
        self.are_leases_running = False
        #: The time of leases, and how much has passed since the last cycle [s].
        self.attended_at, self.unattended_s = self.clock.now, 0.0
        self.agent = ManagementAgent(
            *(tower(), 7, self._store, self.events.append, self.began.append, self.ended.append)
        )
        assert isinstance(self.agent.loop, Cycles)
        self.loop = self.agent.loop

    # ---- the model ----

    @property
    def lease_now(self) -> float:
        return self.attended_at + min(self.unattended_s, PAUSE_S)

    def note_written(self) -> None:
        """The state is on disk."""
        self.written = copy.deepcopy((self.here, self.areas))

    def session(self, name: str) -> Session:
        """Of a robot that is about to call."""
        self.here[name].last_call = self.lease_now
        return self.agent.sessions[self.here[name].key]

    def refusal(self, name: str) -> type[SimulationError] | None:
        """Why a robot can't log on."""
        if name in self.kept_out:
            return InvalidDescription
        if name in self.here:
            return NameTaken
        if len(self.here) >= self.limit:
            return ServerFull
        return PlaceTaken if STARTS[name] in [member.pose for member in self.here.values()] else None

    # ---- coming and going ----

    @initialize(who=st.dictionaries(names, st.sets(st.sampled_from(["ride", "object", "areas"]))), runs=st.booleans())
    def begin(self, who: dict[str, set[str]], runs: bool) -> None:
        """Robots that have something, and perhaps leases."""
        for number, (name, things) in enumerate(who.items()):
            self.log_on(name)
            if "ride" in things:
                self.call_elevator(number, False)
            if "object" in things and name in HANDS:
                self.grip(name, False)
            if "areas" in things:
                self.reserve(number, [(0, number // 2, 0, 1, 1)], False)
        if runs:
            self.begin_leases()

    def some(self, number: int) -> str:
        return list(self.here)[number % len(self.here)]

    @rule(name=names, is_full=st.booleans())
    def log_on(self, name: str, is_full: bool = False) -> None:
        description = robot(name, *STARTS[name])
        if refusal := self.refusal(name):
            with pytest.raises(refusal) as refused:
                self.agent.register(description)
            if isinstance(refused.value, ServerFull):
                oldest = min((member.last_call for member in self.here.values()), default=self.lease_now)
                retry_s = max(0.0, oldest + LEASE_S - self.lease_now)
                assert (refused.value.limit, refused.value.now) == (self.limit, len(self.here))
                assert refused.value.retry_s == pytest.approx(retry_s)
            return
        is_stored = self.durably(lambda: self.agent.register(description), is_full)
        session = self.began.pop()
        if is_stored:
            self.here[name] = Member(session.client.key, STARTS[name], self.lease_now)
        else:
            assert self.ended.pop() is session

    @precondition(lambda self: self.here)
    @rule(number=numbers, way=st.sampled_from(["deregister", "evict"]), is_full=st.booleans())
    def log_off(self, number: int, way: str, is_full: bool) -> None:
        """It is logged off also if that can't be stored; that is tried again."""
        self.leave(self.some(number), way, is_full)
        Writer.last.flush()

    def leave(self, name: str, way: str, is_full: bool = False) -> None:
        session = self.session(name)
        if way == "deregister":
            self.durably(session.deregister, is_full)
        elif way == "evict":
            self.durably(lambda: self.agent.evict(name), is_full)
        else:
            assert self.agent.keep_out(name)
            self.kept_out.add(name)
        self.areas.keep(name, [])
        del self.here[name]
        assert self.ended.pop() is session
        self.gone.append(session)

    @precondition(lambda self: self.here)
    @rule(number=numbers, way=st.sampled_from(["deregister", "evict"]), is_killed=st.booleans())
    def come_back(self, number: int, way: str, is_killed: bool) -> None:
        """Another robot of the same name logs on, perhaps before anything else is written."""
        name = self.some(number)
        self.leave(name, way)
        self.log_on(name)
        if is_killed:
            self.restart(True, set(), self.are_leases_running)

    @precondition(lambda self: not self.kept_out)
    @rule(name=names)
    def keep_out(self, name: str) -> None:
        if name in self.here:
            self.leave(name, "keep out")
            return
        with pytest.raises(UnknownRobot):
            self.agent.evict(name)
        assert not self.agent.keep_out(name)
        self.kept_out.add(name)

    @precondition(lambda self: self.kept_out)
    @rule(name=names)
    def admit(self, name: str) -> None:
        assert self.agent.admit(name) is (name in self.kept_out)
        self.kept_out.discard(name)

    @rule(limit=st.sampled_from([0, 2, 3, 3]), is_full=st.booleans())
    def set_limit(self, limit: int, is_full: bool) -> None:
        pace, pauses = limit + 1.0, limit == 0
        if self.durably(lambda: self.agent.configure(limit=limit, pace=pace, is_paused=pauses), is_full):
            self.limit, self.pace, self.is_paused = limit, pace, pauses

    # ---- leases ----

    @precondition(lambda self: not self.are_leases_running)
    @rule(ticks=st.integers(1, 20))
    def begin_leases_later(self, ticks: int) -> None:
        """Until then nobody is logged off, and then nobody at once."""
        self.pass_time(ticks, set())
        self.begin_leases()
        self.pass_time(1, set())

    def begin_leases(self) -> None:
        self.agent.begin_leases()
        self.are_leases_running = True
        for member in self.here.values():
            member.last_call = self.lease_now

    @rule(ticks=st.integers(1, 20), calling=st.sets(names))
    def pass_time(self, ticks: int, calling: set[str]) -> None:
        for _ in range(ticks):
            for name in calling & self.here.keys():
                self.session(name).heartbeat()
            self.cycle(TICK_S)

    @precondition(lambda self: self.here and self.are_leases_running)
    @rule(number=numbers)
    def fall_silent(self, number: int) -> None:
        name = self.some(number)
        self.pass_time(math.ceil(LEASE_S / TICK_S) + 1, self.here.keys() - {name})
        assert name not in self.here

    @rule(pause_s=st.sampled_from([0.0625, 1.0, 60.0]), name=names)
    def hold_up(self, pause_s: float, name: str) -> None:
        """The server did nothing for a while; a robot calls before it does."""
        self.clock.now += pause_s
        self.unattended_s += pause_s
        if name in self.here:
            self.session(name).heartbeat()
        self.cycle(TICK_S)

    def cycle(self, seconds: float) -> None:
        """Robots whose leases are over by now are logged off, and the state is written."""
        self.clock.now += seconds
        self.unattended_s += seconds
        sessions = dict(self.agent.sessions)
        self.loop.cycle()
        Writer.last.flush()
        self.attended_at, self.unattended_s = self.lease_now, 0.0
        silent_since = self.lease_now - LEASE_S
        for name, member in list(self.here.items()) if self.are_leases_running else ():
            if member.last_call < silent_since and not member.calls:
                if member.is_holding:
                    self.areas.fall_silent(name)
                else:
                    self.areas.keep(name, [])
                del self.here[name]
                self.gone.append(sessions[member.key])
                assert self.ended.pop(0) is sessions[member.key]
        self.note_written()

    @precondition(lambda self: self.here)
    @rule(number=numbers, ticks=st.integers(1, 20))
    def make_long_calls(self, number: int, ticks: int) -> None:
        """Two calls that end one after the other."""
        name = self.some(number)
        member, client = self.here[name], self.session(name).client
        client.begin_call()
        client.begin_call()
        member.calls = 2
        while member.calls:
            self.pass_time(ticks, set())
            client.end_call()
            member.last_call = self.lease_now
            member.calls -= 1

    @precondition(lambda self: self.here)
    @rule(number=numbers, call=st.sampled_from(CALLS))
    def call(self, number: int, call: Callable[[Session], object]) -> None:
        name = self.some(number)
        call(self.session(name))

    @precondition(lambda self: self.gone)
    @rule(which=st.integers(0, 9), call=st.sampled_from([*CALLS, *CHANGES]))
    def call_too_late(self, which: int, call: Callable[[Session], object]) -> None:
        with pytest.raises(SessionExpired):
            call(self.gone[which % len(self.gone)])

    @precondition(lambda self: self.here and not self.kept_out)
    @rule(number=numbers, change=st.sampled_from(CHANGES), returns=st.booleans())
    def log_off_during_a_call(self, number: int, change: Callable[[Session], object], returns: bool) -> None:
        name = self.some(number)
        """Perhaps another robot of its name has logged on before the simulation gets to the call."""
        session = self.session(name)

        def meanwhile() -> None:
            self.leave(name, "evict")
            if returns:
                self.log_on(name)

        self.loop.meanwhile = meanwhile
        with pytest.raises(SessionExpired):
            change(session)

    # ---- what robots have ----

    @precondition(lambda self: self.here)
    @rule(number=numbers, place=st.sampled_from(PLACES))
    def put(self, number: int, place: Pose) -> None:
        name = self.some(number)
        if any(other != name and member.pose == place for other, member in self.here.items()):
            with pytest.raises(PlaceTaken):
                self.agent.place(name, place)
            return
        self.agent.place(name, place)
        self.here[name].pose, self.here[name].is_holding = place, False
        self.note_written()

    @precondition(lambda self: any(self.can_grip(name) for name in HANDS))
    @rule(name=st.sampled_from(sorted(HANDS)), is_full=st.booleans())
    def grip(self, name: str, is_full: bool) -> None:
        if self.can_grip(name):
            at = HANDS[name]
            if self.durably(lambda: self.session(name).grip("T1", at), is_full):
                self.here[name].is_holding = True
                self.note_written()

    def can_grip(self, name: str) -> bool:
        return name in self.here and self.here[name].pose == STARTS[name]

    @precondition(lambda self: self.here)
    @rule(number=numbers, is_full=st.booleans())
    def call_elevator(self, number: int, is_full: bool) -> None:
        name = self.some(number)
        member, session = self.here[name], self.session(name)
        destination = "L2" if member.pose.floor == "L1" else "L1"
        if member.is_riding:
            with pytest.raises(InvalidRide):
                session.call_elevator("E1", destination)
        elif self.durably(lambda: session.call_elevator("E1", destination), is_full):
            member.is_riding = True
            self.note_written()

    @precondition(lambda self: self.here)
    @rule(number=numbers, wanted=boxes, is_full=st.booleans())
    def reserve(self, number: int, wanted: list, is_full: bool) -> None:
        name = self.some(number)
        session = self.session(name)
        if self.areas.of(name):
            with pytest.raises(InvalidReservation):
                session.reserve(areas(wanted, FLOORS), 30.0)
        elif self.durably(lambda: session.reserve(areas(wanted, FLOORS), 30.0), is_full):
            self.areas.reserve(name, [wanted], 30.0)
            self.note_written()

    @precondition(lambda self: self.here and self.areas.kept)
    @rule(number=numbers, former=names, is_full=st.booleans())
    def take_over(self, number: int, former: str, is_full: bool) -> None:
        name = self.some(number)
        session = self.session(name)
        if not self.areas.take_over(name, former):
            with pytest.raises(InvalidReservation):
                session.take_over_areas(former)
        elif self.durably(lambda: session.take_over_areas(former), is_full):
            self.note_written()
        else:
            self.areas.fall_silent(name, former)

    @precondition(lambda self: self.here)
    @rule(number=numbers, what=st.sampled_from(["object", "areas", "ride"]), is_full=st.booleans())
    def release(self, number: int, what: str, is_full: bool) -> None:
        name = self.some(number)
        """That stays done also if it can't be stored."""
        member, session = self.here[name], self.session(name)
        if what == "object":
            is_stored = self.durably(session.release, is_full)
            member.is_holding = False
        elif what == "areas":
            is_stored = self.durably(session.release_areas, is_full)
            self.areas.keep(name, [])
        else:
            is_stored = self.durably(session.cancel_elevator, is_full)
            member.is_riding = False
        if is_stored:
            self.note_written()

    def durably(self, change: Callable[[], object], is_full: bool) -> bool:
        """Whether a change was stored; it is not if the disk is full, and raises that."""
        if not is_full:
            change()
            return True
        self._store.is_full = True
        with pytest.raises(ServiceError):
            change()
        self._store.is_full = False
        return False

    @precondition(lambda self: self.here or self.areas.queue)
    @rule(steps=st.sampled_from([1, 20, 90]))
    def simulate(self, steps: int) -> None:
        """What ends is said, and written."""
        for _ in range(steps):
            self.agent.step()
        over = self.areas.pass_time(self.agent.simulated.time)
        ended = [(*event.who, event.reason) for event in self.events if event.kind == "reservation over"]
        assert sorted(ended) == sorted(over)  # those of robots that fell silent together come in any order
        for event in self.events:
            if event.kind == "ride lost":
                assert self.here[event.who[0]].is_riding
                self.here[event.who[0]].is_riding = False
        self.events.clear()
        self.cycle(TICK_S)

    # ---- restarts ----

    @rule(
        is_killed=st.booleans(),
        being_kept_out=st.sets(names, max_size=1),
        are_leases_running=st.sampled_from([True, True, False]),
    )
    def restart(self, is_killed: bool, being_kept_out: set[str], are_leases_running: bool) -> None:
        """A kill loses what was not written; a robot that logged on since then is at its start, and has nothing. One
        that is just being kept out is so on disk, its log-off is not."""
        if not is_killed:
            self.agent.close()
            self.note_written()
        else:
            for name in being_kept_out:
                self._store.keep_out(name)
                self.kept_out.add(name)
                self.here.pop(name, None)
        self._store.__exit__(None, None, None)
        self._open()
        here, self.areas = copy.deepcopy(self.written)
        same = {name for name, member in self.here.items() if name in here and here[name].key == member.key}
        self.here = {
            name: here[name] if name in same else Member(member.key, STARTS[name], 0.0)
            for name, member in self.here.items()
        }
        for member in self.here.values():
            member.last_call, member.calls = self.lease_now, 0
        self.areas.queue = [one for one in self.areas.queue if one.is_kept or one.owner in same]
        self.areas.settle()
        self.note_written()
        self.gone.clear()
        if are_leases_running:
            self.begin_leases()

    # ---- comparison ----

    @invariant()
    def as_in_the_model(self) -> None:
        agent, world = self.agent, self.agent.simulated
        assert {session.name: key for key, session in agent.sessions.items()} == {
            name: member.key for name, member in self.here.items()
        }
        assert [client.name for client in agent.registry.clients] == list(self.here)
        assert agent.kept_out == sorted(self.kept_out)
        state = agent.state
        assert (state.limit, state.pace, state.is_paused) == (self.limit, self.pace, self.is_paused)
        assert state.robots == len(self.here)
        assert world.occupants.robots.keys() == self.here.keys()
        assert set(world.elevators.rides) == {name for name, member in self.here.items() if member.is_riding}
        for name, member in self.here.items():
            assert world.occupants.pose(name) == pytest.approx(member.pose, abs=0.01), name
            assert world.occupants.robots[name].holding == ("T1" if member.is_holding else "")
        self.areas.check(world.reservations.all(world.time), FLOORS)
        assert not self.began and not self.ended


LogOn.TestCase.settings = settings(max_examples=22, stateful_step_count=40, deadline=None)
TestLogOn = LogOn.TestCase

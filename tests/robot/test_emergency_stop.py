"""After a stop nothing but a later reset lets a robot move, whatever happens at the same time.

All sides are real, without their threads: whatever calls another side passes a point at which other operations run
first, as if another thread had been quicker. A later reset is one that began after the stop."""

from __future__ import annotations

import contextlib
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.errors.robots import IllegalOrder, RobotError, RobotHeld, RobotLost, ServerAway
from robocorba.errors.simulation import InvalidCommand, UnknownRobot
from robocorba.planning.planner import PathPlanner
from robocorba.robot import agent as agent_module
from robocorba.robot import emergency_stop, model_switcher, session
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.agent import ControlAgent
from robocorba.robot.high_controller import HighController, Timing
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ActorCommand, RobotState, Velocity
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.protective_field import ProtectiveField
from robocorba.robot.session import SessionState
from robocorba.robot.simulated_adaptor import SimulatedAdaptor
from robocorba.simulation import emergency_stops
from robocorba.simulation.emergency_stops import EmergencyStops, StopAnswer, StopHold, StopRecord
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.registry import Pose
from robocorba.simulation.session import Session
from robocorba.simulation.store import SimulationStore
from tests.robot.places import Channel, eventually
from tests.simulation.places import robot, tower

NAME = "A"
LONG = ProgramBuilder("long").mbase_velocity(0.2, 0.0, 0.0, 600.0).program()
TOWER = tower()
NOBODY = StopRecord()
ADAPTORS = ("simulated", "driver")
#: What may happen at a point: a method of World.
MEANWHILE = (
    *("stop", "stop_at_server", "stop_all", "end_stop_of_all", "deliver", "report", "reset"),
    *("lose", "come_back", "expire", "evict", "admit", "start_server", "damage", "reset_at_server"),
)
#: The number of points before it, and what happens.
Script = list[tuple[int, str]]
meanwhile = st.lists(st.tuples(st.integers(0, 8), st.sampled_from(MEANWHILE)), max_size=3)


class Steps:
    """Takes the place of Repeating: its task runs when the test says so."""

    tasks: ClassVar[dict[str, Callable[[], None]]] = {}

    def __init__(self, name: str, task: Callable[[], None], every_s: object) -> None:
        self.tasks[name] = task

    def start(self) -> Steps:
        return self

    def wake(self) -> None:
        pass

    def close(self) -> None:
        pass


class Calls:
    """Takes the place of Workers: its calls wait in `waiting`."""

    waiting: ClassVar[deque[Callable[[], None]]] = deque()

    def __init__(self, name: str, count: int, on_failure: Callable[[str], object]) -> None:
        self.waiting.clear()

    def submit(self, call: Callable[..., None], *arguments: Any) -> None:
        self.waiting.append(lambda: call(*arguments))

    def close(self, wait: bool = True) -> None:
        self.waiting.clear()


class Stepped(HighController):
    """Its control cycles are called by the test, and no time passes."""

    last: ClassVar[Stepped | None] = None
    _silent_s = 0.0

    def __init__(self, *parts: Any, field: ProtectiveField | None) -> None:
        assert not field or field.limit(1.0, 0.0)[1] is None
        # A reset within another one does not wait for it.
        super().__init__(*parts, timing=Timing(refresh_limit_s=0.0, check_interval_s=600.0, end_limit_s=0.0))

    def _start_loop(self) -> None:
        Stepped.last, self._is_looping = self, True

    def cycle(self) -> None:
        if not self._is_looping:
            return
        if self.is_lost:
            with contextlib.suppress(RobotError), self._adaptor_in_use:
                self._begin()
        self._tick()

    @property
    def is_moving(self) -> bool:
        return self._motion is not None


class Driver(RobotAdaptor):
    """An actual robot, which stands or drives where its body is."""

    def __init__(self, world: World) -> None:
        self._world, self._is_started = world, False

    def start(self, argv: Sequence[str]) -> bool:
        self._world.point()
        self._world.is_driving = False
        self._is_started = True
        self._world.point()
        return True

    def stop(self) -> bool:
        self._world.point()
        was_started, self._is_started = self._is_started, False
        self._world.is_driving = False
        self._world.point()
        return was_started

    def read(self, state: RobotState) -> bool:
        self._world.point()
        if self._is_started:
            at = self._world.session.latest.at
            state.x, state.y, state.heading = at[1:]
            state.joints = state.joint_velocities = np.zeros(len(JOINTS))
        return self._is_started

    def write(self, command: ActorCommand) -> bool:
        self._world.point()
        if self._is_started:
            self._world.is_driving = any(command.velocity)
        return self._is_started


class RobotSession:
    """A BuildingSession, as the one over CORBA: away is the server, for this robot."""

    def __init__(self, world: World) -> None:
        self._world, self._key = world, ""
        self.latest = SessionState(0.0, Pose("L1", 7.0, 2.0), (0.0, 0.0, 0.0), "", None, 0, "")

    def _call(self) -> Session:
        self._world.point()
        if self._world.is_away:
            raise ServerAway("away")
        if (found := self.present) is None:
            raise RobotLost("logged off")
        return found

    @property
    def present(self) -> Session | None:
        """At the server."""
        return self._world.agent.sessions.get(self._key)

    def log_on(self, at: Pose | None = None) -> None:
        try:
            self._call()
        except ServerAway:
            raise
        except RobotLost:
            if NAME in {session.name for session in self._world.agent.sessions.values()}:
                raise RobotLost("the name is taken") from None
            self._world.point()
            if NAME in self._world.agent.kept_out:
                raise RobotLost("kept out") from None
            self._world.note_log_on()
            self._key = self._world.agent.register(robot(NAME)).client.key

    def log_off(self) -> None:
        with contextlib.suppress(RobotLost):
            self._call().deregister()

    def heartbeat(self) -> None:
        self._call()

    def state(self) -> SessionState:
        self._call()
        return self.latest

    def command(self, velocity: Velocity, valid_s: float) -> None:
        session = self._call()
        try:
            session.command(*velocity, valid_s)
        except InvalidCommand as error:
            raise RobotHeld(error.reason) from None
        self._world.body_moves = any(velocity)
        self._world.point()

    def brake(self) -> None:
        self._call().brake()
        self._world.body_moves = False

    def announce_body(self, is_robot: bool) -> None:
        self._world.stops.report_target(self._call(), "target", is_robot)

    def hold(self) -> StopHold:
        with self._world.calling_about_stops():
            return self._world.stops.hold(self._call())

    def report_stop(self, reason: str) -> tuple[bool, StopHold]:
        with self._world.calling_about_stops():
            session, until = self._call(), self._world.moment()
            answer = self._world.stops.report_stop(session, reason)
            for stop in self._world.standing:
                if stop.began < until:
                    stop.is_durable, stop.is_ended_at_server = True, False
            self._world.point()
            if self._world.is_away:  # the answer is lost
                raise ServerAway("away")
            return answer

    def end_stops(self, number: int) -> StopHold:
        with self._world.calling_about_stops():
            hold = self._world.stops.end(self._call(), number)
            for stop in self._world.standing:  # until the reset returns, or the robot reports it again
                stop.is_durable &= hold.is_held or stop.began > self._world.reset_began
            self._world.point()
            if self._world.is_away:
                raise ServerAway("away")
            return hold


class Stop:
    """A stop that no later reset of the robot has ended. is_durable: it outlives the robot's process. is_own: a defect
    of that process, which ends with it, and is not reported. is_ended_at_server: only that process holds it."""

    def __init__(self, began: int, is_durable: bool, is_own: bool = False) -> None:
        self.began, self.is_durable, self.is_own = began, is_durable, is_own
        self.is_of_server, self.is_ended_at_server = is_durable, False


class World:
    """The robot's process, the simulation server, and what stands by the model: `standing`; is_all_stopped: a stop of
    all holds each robot that logs on."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._now = folder, 0
        self.standing: list[Stop] = []
        self.script: Script = []
        self.is_away = self.is_driving = self.body_moves = self.is_all_stopped = self.is_switching = False
        self._calls_about_stops = self.reset_began = 0
        self._server = contextlib.ExitStack()
        self.start_server()
        self.start_robot()

    def close(self) -> None:
        self.is_away = False
        self.end_robot()
        self._server.close()

    def end_robot(self) -> None:
        self.script = []
        self.control.abort()  # ends the thread of its program
        assert Stepped.last
        Stepped.last.close()
        eventually(lambda: not self.is_running, "the program's end")

    def moment(self) -> int:
        self._now += 1
        return self._now

    # ---- what happens at the same time ----

    def point(self) -> None:
        if not self.script:
            return
        count, what = self.script[0]
        if count:
            self.script[0] = count - 1, what
            return
        del self.script[0]
        script, self.script = self.script, []  # not within each other
        self.happen(what)
        self.script = script

    @contextlib.contextmanager
    def calling_about_stops(self) -> Iterator[None]:
        """The reporter and resets have to wait meanwhile."""
        self._calls_about_stops += 1
        try:
            yield
        finally:
            self._calls_about_stops -= 1

    def happen(self, what: str) -> None:
        is_busy = self._calls_about_stops or (what == "reset" and self.is_switching)  # another thread waits then
        if what not in ("report", "reset") or not is_busy:
            getattr(self, what)()

    def lose(self) -> None:
        self.is_away = True

    def come_back(self) -> None:
        self.is_away = False

    def expire(self) -> None:
        with contextlib.suppress(UnknownRobot):
            self.agent.evict(NAME)
            self.body_moves = False

    def evict(self) -> None:
        if self.agent.keep_out(NAME):
            self.body_moves = False

    def admit(self) -> None:
        self.agent.admit(NAME)

    def damage(self) -> None:
        self.start_server(is_damaged=True)

    # ---- the sides ----

    def start_server(self, is_damaged: bool = False) -> None:
        """Also after kill -9. is_damaged: the file of stops is not readable."""
        self._server.close()
        if is_damaged:
            (self.folder / "stops.json").write_bytes(b"\0")
        store = self._server.enter_context(SimulationStore(self.folder / "simulation.sqlite"))
        self.agent = ManagementAgent(
            *(TOWER, 1, store),
            session_began=lambda session: self.stops.admit(session),
            session_ended=lambda session: self.stops.forget(session),
        )
        self.body_moves = False
        self.stops = EmergencyStops(
            *(self.folder / "stops.json", lambda: list(self.agent.sessions.values()), lambda: True, self._stop_target)
        )
        if is_damaged:
            self.note_end_at_server()
            self.is_all_stopped = True
            for _ in self.agent.sessions:
                self.note_log_on()  # the server knows nothing of it
        self.stops.start()

    def note_log_on(self) -> None:
        """A robot is about to log on, or the server has to learn anew whether it is held."""
        if self.is_all_stopped:
            self.standing.append(Stop(self.moment(), True))

    def _stop_target(self, target: str, reason: str, number: int) -> StopAnswer:
        if self.is_away or self.control is None:
            raise TimeoutError
        self.control.stop(reason, number)
        return self.control.stop_answer

    def start_robot(self) -> None:
        """Also after kill -9."""
        self.control: Any = None
        self.adaptors: list[RobotAdaptor] = []
        self.session: Any = RobotSession(self)
        self.session.log_on()
        self.control = ControlAgent(AdaptorContext(NAME, self.session, self), PathPlanner(TOWER), Channel())
        self.control.start("simulated")
        self.control.load(LONG)

    def make(self, name: str, context: AdaptorContext) -> RobotAdaptor:
        made: RobotAdaptor = SimulatedAdaptor(self.session) if name == "simulated" else Driver(self)
        self.adaptors.append(made)
        return made

    @property
    def is_running(self) -> bool:
        return self.control.is_busy or self.control._is_running

    # ---- operations ----

    def stop(self) -> None:
        self.standing.append(Stop(self.moment(), False))  # a reset that begins from here on may end it
        self.control.stop("button")

    def stop_at_server(self) -> None:
        self.standing.append(Stop(self.moment(), True))
        self.stops.stop([NAME], "fire")
        self.body_moves = False

    def stop_all(self) -> None:
        if self.session.present:
            self.standing.append(Stop(self.moment(), True))
        self.is_all_stopped = True
        self.stops.stop([], "fire everywhere")
        self.body_moves = False

    def end_stop_of_all(self) -> None:
        self.stops.end_stop_of_all(self.stops.stop_of_all.number)
        self.is_all_stopped = False

    def fail(self) -> None:
        """A defect ends the control loop."""
        assert Stepped.last
        if Stepped.last._is_looping:
            self.standing.append(Stop(self.moment(), False, is_own=True))
            Stepped.last._loop_failed("a defect")

    def report(self) -> None:
        script, self.script = self.script, []
        for _ in range(2):  # the first one may have to log on
            Steps.tasks["emergency stop"]()
        if not self.is_away and self.session.present:  # one that is kept out can't report
            for stop in self.standing:
                stop.is_durable |= not stop.is_ended_at_server
        self.script = script

    def deliver(self) -> None:
        if Calls.waiting:
            Calls.waiting.popleft()()

    def reset(self) -> None:
        began = self.reset_began = self.moment()
        try:
            self.control.reset_stop()
        except RobotError:
            return
        self.standing = [stop for stop in self.standing if stop.began > began]

    def reset_at_server(self) -> None:
        with contextlib.suppress(UnknownRobot):
            self.stops.reset_robot(NAME)
        self.note_end_at_server()

    def note_end_at_server(self) -> None:
        self.standing = [stop for stop in self.standing if not stop.is_of_server]
        for stop in self.standing:
            stop.is_ended_at_server |= stop.is_durable
            stop.is_durable = False

    def kill_robot(self) -> None:
        self.end_robot()
        self.is_driving = self.body_moves = self.is_away = False
        self.expire()
        self.admit()
        self.standing = [stop for stop in self.standing if stop.is_durable and not stop.is_own]
        self.start_robot()

    @property
    def is_held_on_disk(self) -> bool:
        """Whether a server that starts now holds the robot."""
        records = emergency_stops.read_records(self.folder / "stops.json")
        record, session = records.get(NAME, NOBODY), self.session.present
        is_new = session is None or record.registration != emergency_stops.registration(session)
        return bool(record.held or (is_new and records.get(emergency_stops.ALL, NOBODY).held))

    def settle(self) -> None:
        """Until the program's thread waits for its motion or for an operator, or has ended."""
        controller, execution = Stepped.last, self.control._robot.execution
        assert controller
        eventually(lambda: not self.is_running or controller.is_moving or execution.is_paused, "settled")


class Stops(RuleBasedStateMachine):
    """A robot with stops, resets, losses, switches and restarts."""

    @initialize()
    def begin(self) -> None:
        self._closing = contextlib.ExitStack()
        patch = self._closing.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(agent_module, "HighController", Stepped)
        for module in (agent_module, emergency_stop, emergency_stops):
            patch.setattr(module, "Repeating", Steps)
        patch.setattr(emergency_stops, "Workers", Calls)
        patch.setattr(session, "GIVING_BACK_S", 0.0)
        patch.setattr(model_switcher, "make", lambda name, context: context.orb.make(name, context))
        folder = self._closing.enter_context(tempfile.TemporaryDirectory())
        self.world = World(Path(folder))
        self._closing.callback(self.world.close)

    def teardown(self) -> None:
        if hasattr(self, "_closing"):
            self._closing.close()

    @rule(script=meanwhile, by_server=st.booleans(), is_reported=st.booleans())
    def stop(self, script: Script, by_server: bool, is_reported: bool) -> None:
        self.world.script = script
        if by_server:
            self.world.stop_at_server()
            self.world.deliver()
        else:
            self.world.stop()
        if is_reported:
            self.world.happen("report")

    @rule(script=meanwhile, stopped_by=st.sampled_from(["", "robot", "server"]))
    def reset(self, script: Script, stopped_by: str) -> None:
        if stopped_by:
            self.stop([], stopped_by == "server", True)
        self.world.script = script
        self.world.reset()

    @rule(script=meanwhile, adaptor=st.sampled_from(ADAPTORS))
    def switch(self, script: Script, adaptor: str) -> None:
        self.world.script, self.world.is_switching = script, True
        with contextlib.suppress(RobotError):  # a server that is away at the wrong moment ends both attempts
            self.world.control.switch(adaptor, ())
        self.world.is_switching = False

    @rule(script=meanwhile, number=st.integers(1, 3))
    def cycle(self, script: Script, number: int) -> None:
        self.world.script = script
        for _ in range(number):
            assert Stepped.last
            Stepped.last.cycle()

    @rule(what=st.sampled_from(MEANWHILE))
    def happen(self, what: str) -> None:
        self.world.happen(what)

    @rule()
    def renew_lease(self) -> None:
        Steps.tasks["lease"]()

    @rule(is_stepping=st.booleans())
    def run(self, is_stepping: bool) -> None:
        with contextlib.suppress(RobotError):
            self.world.control.run(is_stepping)
        self.world.settle()

    @rule(order=st.sampled_from(["pause", "resume", "abort"]))
    def order(self, order: str) -> None:
        with contextlib.suppress(IllegalOrder):
            getattr(self.world.control, order)()
        self.world.settle()

    @rule()
    def drive(self) -> None:
        with contextlib.suppress(RobotError):
            self.world.control.drive((0.1, 0.0, 0.0), 5.0)
        self.world.settle()

    @rule()
    def kill_robot(self) -> None:
        self.world.kill_robot()

    @rule(script=meanwhile)
    def fail(self, script: Script) -> None:
        self.world.script = script
        self.world.fail()

    @rule(way=st.sampled_from(["stop_at_server", "stop_all"]), is_reset=st.booleans(), is_killed=st.booleans())
    def evict_and_admit(self, way: str, is_reset: bool, is_killed: bool) -> None:
        """A robot that was stopped logs on again, perhaps as another process."""
        for what in (way, "evict", *(["reset_at_server"] if is_reset else []), "admit"):
            self.world.happen(what)
        if is_killed:
            self.world.kill_robot()

    @invariant()
    def holds(self) -> None:
        if not hasattr(self, "world"):
            return
        world, controller = self.world, Stepped.last
        assert controller
        world.script = []
        world.is_driving = world.body_moves = False  # commands hold for 0.1 s
        for _ in range(2):
            controller.cycle()
        assert world.control.stopped or not world.control._controller.is_closed, "it has no adaptor, and shows no stop"
        if world.control.stopped:
            assert not any(adaptor.write(ActorCommand()) for adaptor in world.adaptors), "an adaptor is started"
        if world.standing:
            assert not world.is_driving and not world.body_moves, "it moves"
            assert world.control.stopped or world.is_held_on_disk, "a stop is lost"


@pytest.fixture
def world() -> Iterator[World]:
    machine: Any = Stops()  # type: ignore[no-untyped-call]
    machine.begin()
    with contextlib.closing(machine.world), machine._closing.pop_all():
        yield machine.world
        machine.holds()


@pytest.mark.parametrize(
    "happens",
    [
        # One that was reset logs on again: its name is new to the server, and its stops have other numbers.
        ("stop_all", "deliver", "reset", "expire", "stop", "reset"),
        # The server's stop, which ends there, was not the robot's own.
        ("stop", "stop_at_server", "deliver", "reset_at_server", "report", "kill_robot"),
    ],
)
def test_no_stop_is_lost(world: World, happens: Sequence[str]) -> None:
    for what in happens:
        world.happen(what)


@pytest.mark.parametrize(
    ("what", "points", "reason"),
    [
        ("stop", 0, "was stopped again: button"),
        ("stop_at_server", 3, "is held by the simulation server: fire; reset it again"),
    ],
)
def test_a_reset_that_is_refused_for_a_later_stop_has_reported_it(
    world: World, what: str, points: int, reason: str
) -> None:
    for each in (what, "deliver"):
        world.happen(each)
    world.script = [(points, what)]
    with pytest.raises(IllegalOrder, match=reason):
        world.control.reset_stop()
    assert world.control.stopped and world.is_held_on_disk


@pytest.mark.parametrize("is_answer_lost", [True, False])
def test_a_stop_whose_end_got_no_answer_or_that_the_server_has_lost_is_reported_again(
    world: World, is_answer_lost: bool
) -> None:
    world.stop()
    world.report()
    if is_answer_lost:
        world.script = [(7, "lose")]
        world.reset()
        assert world.is_away and not world.is_held_on_disk
        world.come_back()
    else:
        (world.folder / "stops.json").unlink()
        world.start_server()
        world.expire()
        world.session.log_on()
        world.control._emergency.attend()
    world.report()
    assert world.is_held_on_disk


def test_a_server_that_could_not_write_the_end_of_a_stop_holds_the_robot_again(world: World) -> None:
    world.stop_at_server()
    world.deliver()
    held = (world.folder / "stops.json").read_bytes()
    world.reset()
    (world.folder / "stops.json").write_bytes(held)
    world.start_server()
    world.stops.states([])
    world.deliver()
    assert world.control.stopped


TestStops = Stops.TestCase
TestStops.settings = settings(deadline=None, max_examples=12, stateful_step_count=30)

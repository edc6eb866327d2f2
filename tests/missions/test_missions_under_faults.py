"""Missions whose robots and servers die, hang, or are cut off, at any moment: in each term one robot leads at most,
nobody obeys the leader of an earlier term, terms only grow, and each mission ends in a state that says how.

Cooperation, leaders, members, their succession and mission control are real, on a virtual clock. The model knows of
each process only what happened to it; of the robots' bodies it has the time that a step takes."""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import logging
import math
import random
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from msgspec import structs

from clients import cooperation
from clients.cooperation import Cooperation
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import GoalReached, IllegalOrder, MotionFailed
from robocorba.errors.services import NotPermitted, NotReachable
from robocorba.errors.simulation import NoLeader, UnknownMission
from robocorba.map_editor.spatial.pose import Pose
from robocorba.missions import attempt, clock, member, mission_agent, mission_control, recorder, succession, transport
from robocorba.missions import leader as leader_module
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.cooperative_planner import CarriedBody
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.member import MemberPolicy
from robocorba.missions.messages import Assignment, Call, Message, Order, message_of
from robocorba.missions.mission_agent import MissionAgent
from robocorba.missions.mission_control import LeaderWatch, MissionControl
from robocorba.missions.report import MissionReport
from robocorba.missions.subplan import Approach, CooperativePlan, Idle, PutDown, Reserve, Step, TakeHold
from robocorba.planning.request import Place
from robocorba.robot import execution_control
from robocorba.robot.data_pool.plans import Plan, Plans
from robocorba.robot.execution_control import ExecutionControl
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs.program import Program
from robocorba.simulation.mission_directory import MissionDirectory
from robocorba.simulation.mission_record import MissionContent, MissionResult, decoded
from robocorba.simulation.store import Mission, SimulationStore
from tests.missions.places import Bus, Given, Receive, WatchedDirectory
from tests.missions.virtual_time import Task, VirtualTime

ROBOTS, SERVER = "ABCD", "server"
ICON = json.dumps({"icon": "move_table", "table": "desk", "to": {"floor": "L1", "x": 1, "y": 2}})
#: Intervals are longer than those of the product, so that there are fewer messages.
LEADING = LeaderPolicy(order_interval_s=0.5, step_lead_s=0.5)
TAKING_PART = MemberPolicy(pause_timeout_s=1.25, state_interval_s=0.5)
#: How long a step takes, and its limit [s].
LIMIT_S = 30.0
STEP_S: dict[type[Step | Idle], float] = {Approach: 6.0, TakeHold: 1.0, Idle: 20.0, PutDown: 1.0}
#: How long a request to a robot or a server that hangs, or is cut off, waits for its answer [s].
CALL_LIMIT_S = 2.0
#: Each successor of a leader waits this much longer than the one before it [s].
TURN_S = 3.0
#: For this time after a trouble of a robot or server its mission may be handed over [s].
TROUBLE_LASTS_S = 90.0
#: The leader, its successors in turn, and others.
ROBOT = st.sampled_from([0, 1, 2, 3])
FOR_S = st.sampled_from([12.0, 25.0, 1.0, 5.0, 45.0])
HOW = st.sampled_from(
    ["dies", "restarts", "hangs", "is cut off", "gets no events", "gets no calls", "gets no assignments"]
)
OVER = st.booleans()
T = TypeVar("T")


class Body(CarriedBody):
    """Of a plan that is taken over."""

    def __init__(self, plan: CooperativePlan) -> None:
        self.plan = plan


class Planner(Given):
    """Three robots carry the desk; two of them can hold it."""

    def __init__(self, world: World) -> None:
        at, limit = (0.0, 0.0, 0.0), {"limit_s": LIMIT_S}
        hold = TakeHold(thing="desk", at=at, x=0.0, y=0.0, height_m=0.7, **limit)
        steps = [Approach(x=0.0, y=0.0, heading=0.0, **limit), hold, Idle(**limit), PutDown(**limit)]
        super().__init__(steps, steps, steps)
        if world.is_carried:
            raise GoalReached("the desk is at its goal")

    def plan(
        self, mission: str, leader: str, robots: dict[str, Place], staying: Collection[str] = ()
    ) -> CooperativePlan:
        plan = super().plan(mission, leader, robots, staying)
        pairs = tuple(itertools.combinations([subplan.robot for subplan in plan.subplans], 2))
        return structs.replace(plan, thing="desk", enough=pairs)


class Executor:
    """Does steps by letting time pass; see StepExecutor."""

    error_m, carry = 0.0, None

    def __init__(self, body: Any, *others: object) -> None:
        self._body, self.held = body, ""

    def execute(self, step: Step | Idle) -> None:
        process: Process = self._body.process
        process.note_step()

        def fails() -> bool:
            process.note_progress()
            return process.failure == "a step fails"

        duration_s = 2 * LIMIT_S if process.failure == "a step hangs" else STEP_S[type(step)]
        try:
            if self._body.execution.wait_for(fails, duration_s, lambda: process.world.time.now):
                raise MotionFailed("blocked")
        finally:
            process.failure = ""
        if isinstance(step, TakeHold):
            self.held = "desk"
            process.world.held.append(process.name)
        elif isinstance(step, PutDown):
            self.held, process.world.is_carried = "", True

    def measure_place(self) -> None: ...

    def reserve_again(self, *reserved: object) -> None: ...

    def release_reservations(self) -> None: ...

    def end_safely(self) -> None:
        self._body.process.world.time.sleep(1.0)
        self.held = ""


class Agent:
    """A control agent, as missions use it."""

    place, joints = Pose("L1", 1.0, 2.0, 0.0), np.zeros(len(JOINTS))

    def __init__(self, process: Process) -> None:
        self._process = process
        self._task: Task | None = None
        session = SimpleNamespace(latest=SimpleNamespace(at=self.place))
        execution = ExecutionControl(lambda why: None, lambda is_held: None)
        self.robot = SimpleNamespace(execution=execution, session=session, process=process)

    @property
    def is_busy(self) -> bool:
        return self._task is not None and not self._task.has_ended

    @property
    def is_free(self) -> bool:
        return not self.is_busy

    def begin_part(self, make: Callable[[Any], Any], for_own_mission: bool = False) -> Any:
        if not for_own_mission:
            self._refuse_while_running()
            self.robot.execution.reset(False)
        part = make(self.robot)
        self._process.part = part
        task = self._process.begin(part.run)
        if not for_own_mission:
            self._task = task
        return part

    def start_mission(self, mission: str, program: Program) -> None:
        self.take_over(mission, program)

    def take_over(self, mission: str, program: Program, goes_on: bool = False) -> None:
        if not (goes_on and self.is_busy):
            self._refuse_while_running()
            self.robot.execution.reset(False)

        def run() -> None:
            with contextlib.suppress(RoboCorbaError):
                self._process.cooperation.cooperate(program.icons[0], mission)

        self._task = self._process.begin(run)

    def abort(self) -> None:
        if self.is_busy:
            self.robot.execution.abort()

    def stop(self, reason: str) -> None:
        raise AssertionError(reason)

    def _refuse_while_running(self) -> None:
        if self.is_busy:
            raise IllegalOrder("start", "runs a program")


class Channel:
    """A robot's end of the event channel."""

    def __init__(self, process: Process) -> None:
        self.process, self._bus = process, process.world.bus

    def publish(self, type: str, payload: Any, retry_s: float) -> None:
        if self.process.is_dead or self.process.name in self._bus.disconnected:
            raise NotReachable("disconnected")
        self.process.world.note_published(self.process.name, message_of(type, payload))
        self._bus.publish(self.process.name, type, payload)

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Receive) -> None:
        def deliver(*event: Any) -> None:
            process = self.process
            if process.name in process.world.time.frozen:
                process.mail.append(lambda: receive(*event))
            elif not process.is_dead:
                receive(*event)

        self._bus.subscribe(id(self), self.process.name, patterns, deliver)

    def close(self) -> None:
        self._bus.subscribe(id(self), "", (), lambda *event: None)


class Records:
    """The Omni database, as a robot with a file of its own calls it."""

    def __init__(self, process: Process) -> None:
        self.process = process

    def mission(self, name: str) -> Mission:
        return self._call(lambda directory: directory.stored(name))

    def put_mission(self, mission: Mission) -> int:
        self.process.world.writes += 1

        def put(directory: MissionDirectory) -> int:
            if not directory.may_put(self.process.name, mission.name, mission.document):
                raise NotPermitted("the Omni database")
            return directory.put_mission(mission)

        return self._call(put)

    def _call(self, call: Callable[[MissionDirectory], T]) -> T:
        world, name = self.process.world, self.process.name
        world.time.sleep(0.25)
        if world.server is None or name in world.cut_off:
            world.time.sleep(CALL_LIMIT_S)
            raise NotReachable("the Omni database does not answer")
        return call(world.server)


class Leaders:
    """The robots, as mission control and other robots call them."""

    def __init__(self, world: World, caller: str) -> None:
        self._world, self._caller = world, caller

    def start(self, leader: str, mission: str, icon: str, term: int) -> None:
        program = cooperation.of_icon(icon)
        self._call(leader, lambda process: process.cooperation.lead_mission(mission, program, term))

    def abort(self, leader: str, mission: str) -> None:
        self._call(leader, lambda process: process.cooperation.abort_mission(mission))

    def mission_of(self, leader: str) -> str:
        return self._call(leader, lambda process: process.cooperation.mission)

    def plan(self, leader: str, mission: str) -> Plan:
        return self._call(leader, lambda process: process.plans.get(mission))

    def leads(self, leader: str, mission: str) -> bool:
        try:
            return self.mission_of(leader) == mission
        except NotReachable:
            return False

    def _call(self, name: str, call: Callable[[Process], T]) -> T:
        world = self._world
        world.time.sleep(0.25)
        process, is_cut_off = world.robots[name], bool({name, self._caller} & world.cut_off)
        if process.is_dead and not is_cut_off:
            raise NotReachable(f"robot {name} is not there")
        if is_cut_off or name in world.time.frozen:
            if not is_cut_off:
                process.mail.append(lambda: process.begin(lambda: self._do_late(process, call)))
            world.time.sleep(CALL_LIMIT_S)
            raise NotReachable(f"robot {name} does not answer")
        answer = call(process)
        if process.loses_answer:
            process.loses_answer = False
            world.time.sleep(CALL_LIMIT_S)
            raise NotReachable(f"the answer of {name} was lost")
        return answer

    def _do_late(self, process: Process, call: Callable[[Process], object]) -> None:
        with contextlib.suppress(RoboCorbaError):
            call(process)


class Process:
    """A robot's process."""

    def __init__(self, world: World, name: str) -> None:
        self.world, self.name = world, name
        self.is_dead = self.loses_answer = False
        #: What its present or next step does.
        self.failure = ""
        #: What waits in its sockets while it is frozen.
        self.mail: list[Callable[[], object]] = []
        self.part: Any = None
        #: The highest term that it has received of each mission.
        self.terms: defaultdict[str, int] = defaultdict(int)
        #: When it received orders last, and when it was frozen last.
        self.ordered_at = self.went_on_at = world.time.now
        #: Since when it waits for its turn to lead a mission in the term after this one.
        self.orphaned_at: dict[tuple[str, int], float] = {}
        world.time.owner = name
        agent: Any = Agent(self)
        self.plans = Plans()
        pool: Any = SimpleNamespace(current_snapshot=world.seen)
        orb: Any = self
        self.agent, self.cooperation = agent, Cooperation(orb, "hall", name, self.plans, Path())
        self.cooperation.start(agent, pool)

    def begin(self, work: Callable[[], object]) -> Task:
        return self.world.time.begin(self.name, work)

    def thaw(self) -> None:
        """What has waited in its sockets comes first."""
        self.went_on_at = self.world.time.now
        mail, self.mail = self.mail, []
        for each in mail:
            each()

    def note_received(self, message: Message) -> None:
        """It takes a message out of its queue."""
        if isinstance(message, (Call, Assignment, Order)):
            is_obeyed = message.term >= self.terms[message.of]
            self.terms[message.of] = max(self.terms[message.of], message.term)
            if isinstance(message, Assignment) or (is_obeyed and self.part and message.mission == self.part.mission):
                self.ordered_at = self.world.time.now

    def note_step(self) -> None:
        """It does a step of its part."""
        term, highest = self.part.term, self.terms[self.part.of]
        assert term >= highest, f"{self.name} does a step under term {term}, after orders of term {highest}"

    def note_progress(self) -> None:
        """Its part is not paused, nor aborted."""
        if not self.agent.robot.execution.interruption:
            self.note_step()
        if not self.part.is_holding and not self.agent.robot.execution.interruption:
            silent_s = self.world.time.now - max(self.ordered_at, self.went_on_at)
            assert silent_s <= TAKING_PART.pause_timeout_s + 1.0, f"{self.name} moves without orders"


class World:
    """Robots and mission control; what happened to them, and what was seen of missions."""

    def __init__(self, store: SimulationStore, time: VirtualTime) -> None:
        self.time, self.bus, self.store = time, Bus(), store
        #: Robots whose calls do not get through to others.
        self.cut_off: set[str] = set()
        #: When robots or the server had a trouble last; inf while they have one.
        self.trouble_at: dict[str, float] = {}
        self.is_carried = False
        #: Who gripped the desk, in turn.
        self.held: list[str] = []
        #: The leaders of each mission and term, by their messages; the attempts of each.
        self.led_in: defaultdict[tuple[str, int], set[str]] = defaultdict(set)
        self.writes = 0
        self.wrong: list[str] = []
        #: Whether a user wanted an abort; when leaders accepted the abort of their missions, as far as that was heard.
        self.is_abort_wanted = False
        self.aborted: dict[str, float] = {}
        self.server: MissionDirectory | None = None
        self.control: MissionControl
        self.start_server()
        self.robots = {name: Process(self, name) for name in ROBOTS}

    def start_server(self) -> None:
        self.server = WatchedDirectory(self.store, lambda: 1e9 + self.time.now, self.note_change)
        leaders = Leaders(self, SERVER)

        def nearest(about: str) -> list[str]:
            return [name for name in ROBOTS if not self.robots[name].is_dead]

        def is_logged_on(robot: str) -> bool:
            return not self.robots[robot].is_dead and robot not in self.time.frozen

        self.control = MissionControl(self.server, leaders, nearest)
        watch = LeaderWatch(self.server, leaders, is_logged_on, lambda: self.time.now, nearest)

        def check() -> None:
            while True:
                self.time.sleep(3.0)
                watch.check()

        self.time.begin(SERVER, check)

    def start(self, leader: str) -> None:
        """By a user."""

        def start() -> None:
            with contextlib.suppress(RoboCorbaError):
                self.control.start(leader, ICON)

        self.time.begin(SERVER, start)

    def abort(self, mission: str) -> None:
        self.is_abort_wanted = True

        def abort() -> None:
            with contextlib.suppress(NoLeader, UnknownMission):
                self.control.abort(mission)
                self.aborted.setdefault(mission, self.time.now)

        self.time.begin(SERVER, abort)

    def seen(self) -> Any:
        """The robots that are logged on."""
        here = [name for name, robot in self.robots.items() if not robot.is_dead]
        robots = [SimpleNamespace(name=name, x=0.0, y=0.0, radius_m=0.3, vx=0.0, vy=0.0, number=1) for name in here]
        return SimpleNamespace(robots=robots, objects=lambda: [])

    def kill(self, robot: str) -> None:
        self.robots[robot].is_dead = True
        self.time.kill(robot)

    def troubled(self) -> set[str]:
        """Who had a trouble lately."""
        return {who for who, at in self.trouble_at.items() if self.time.now - at <= TROUBLE_LASTS_S}

    # ---- what is seen ----

    def note_published(self, name: str, message: Any) -> None:
        if isinstance(message, (Call, Assignment, Order)):
            self.led_in[message.of, message.term].add(name)

    def note_change(self, name: str, before: MissionContent, after: MissionContent) -> None:
        """Of a mission's record."""
        if after.term < before.term:
            self.wrong.append(f"the term of {name} falls from {before.term} to {after.term}")
        if after.leader == before.leader or before.is_offered or after.is_offered:
            return
        if not self.led_in.get((name, before.term)):  # it was offered to one that has refused
            return
        if after.term == before.term:
            self.wrong.append(f"{after.leader} leads {name} in the term of {before.leader}")
        if not {SERVER, before.leader} & self.troubled():
            self.wrong.append(f"{after.leader} displaces {before.leader}, which is well")
        if after.leaders[-1].reason.endswith("was silent"):  # it has not been asked by mission control
            turn = before.successors().index(after.leader)
            waited_s = self.time.now - self.robots[after.leader].orphaned_at.get((name, before.term), math.inf)
            if waited_s < turn * TURN_S:
                self.wrong.append(f"{after.leader} takes {name} over after {waited_s:g} s, in turn {turn}")

    def contents(self) -> dict[str, MissionContent]:
        found = {each.name: decoded(each.document) for each in self.store.missions()}
        return {name: content for name, content in found.items() if content}


class WatchedTransport(transport.Transport):
    def __init__(self, channel: Channel, name: str) -> None:
        super().__init__(channel, name)
        self._process = channel.process

    def receive(self, timeout_s: float | None) -> transport.Received | None:
        received = super().receive(timeout_s)
        if received:
            self._process.note_received(received.message)
        return received


class WatchedSuccession(succession.Succession):
    def __init__(self, robot: str, records: Records, *others: Any) -> None:
        super().__init__(robot, records, *others)
        self._process = records.process

    def begin(self, mission: str, term: int) -> None:
        self._process.orphaned_at.setdefault((mission, term), self._process.world.time.now)
        super().begin(mission, term)


#: What cooperation is made of: it gets a process in place of the ORB.
PARTS: dict[str, Any] = {
    "RobotChannel": lambda process, channel, name: Channel(process),
    "RemoteWorld": lambda process: SimpleNamespace(process=process),
    "RemoteDatabase": lambda process, resolve_timeout_s: Records(process),
    "RemoteLeaders": lambda process: Leaders(process.world, process.name),
    "RemotePool": lambda process, leader, timeout_s: SimpleNamespace(
        plan=functools.partial(Leaders(process.world, process.name).plan, leader)
    ),
    "LeaderAreas": lambda session: SimpleNamespace(take_over=lambda *former: True, release=lambda: None),
    "MissionAgent": functools.partial(MissionAgent, policy=TAKING_PART),
    "Succession": WatchedSuccession,
    "Transport": WatchedTransport,
    "RemainingCarry": lambda world, plan: Body(plan),
    "reservation": lambda plan: Reserve(areas=(), hold_s=1.0, limit_s=1.0),
    "planner_of": lambda icon: lambda icon, world, leader, here: Planner(world.process.world),
    "_policy": lambda icon: LEADING,
}
MODULES = (
    *(attempt, clock, cooperation, execution_control, leader_module, member, mission_agent, mission_control),
    *(recorder, succession, transport),
)


class Defects(logging.Handler):
    """Exceptions that threads have logged."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.found: list[BaseException] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info and record.exc_info[1]:
            self.found.append(record.exc_info[1])


class Missions(RuleBasedStateMachine):
    @initialize(
        seed=st.integers(0, 2**16),
        leader=st.sampled_from(["", *ROBOTS]),
        then_s=st.sampled_from([14.0, 10.0, 4.0, 0.25, 20.0]),
    )
    def a_mission_is_started(self, seed: int, leader: str, then_s: float) -> None:
        self.closing = contextlib.ExitStack()
        self.closing.callback(OWN_CLOCK.synchronize)  # after the patch is undone
        patch = self.closing.enter_context(pytest.MonkeyPatch.context())
        self.time = VirtualTime(seed)
        self.closing.callback(self.time.close)
        self.time.install(patch, *MODULES)
        for name, part in PARTS.items():
            patch.setattr(cooperation, name, part)
        patch.setattr(cooperation.carry_planning, "warm_up", lambda: None)
        patch.setattr(member, "StepExecutor", Executor)
        patch.setattr(leader_module, "random", random.Random(seed))
        patch.setattr(MissionReport, "save", lambda report, folder: None)
        OWN_CLOCK.synchronize()
        self.defects = Defects()
        logging.getLogger("robocorba").addHandler(self.defects)
        self.closing.callback(logging.getLogger("robocorba").removeHandler, self.defects)
        folder = self.closing.enter_context(tempfile.TemporaryDirectory())
        store = self.closing.enter_context(SimulationStore(Path(folder) / "simulation.sqlite"))
        self.world = World(store, self.time)
        #: Who had troubles since the mission began, and how often a step failed.
        self.troubled: set[str] = set()
        self.failures, self.is_split = 0, False
        self.world.start(leader)
        self.run_for(then_s)

    def teardown(self) -> None:
        try:
            if hasattr(self, "world") and sys.exc_info()[0] is None:
                self.end()
        finally:
            self.closing.close()

    def run_for(self, seconds: float) -> None:
        for who in self.in_trouble():
            self.troubled.add(who)
            self.world.trouble_at[who] = self.time.now + seconds
        self.time.run_for(seconds)
        self.check()

    def in_trouble(self) -> set[str]:
        world = self.world
        dead = {name for name, robot in world.robots.items() if robot.is_dead}
        server = () if world.server else (SERVER,)
        without_assignments = {name for name, _ in world.bus.lost}
        return {*server, *dead, *world.bus.disconnected, *without_assignments, *world.cut_off, *self.time.frozen}

    # ---- what happens ----

    @rule(how=HOW, for_s=FOR_S, is_over=OVER, then_s=FOR_S)
    def the_leader_has_a_trouble(self, how: str, for_s: float, is_over: bool, then_s: float) -> None:
        self.hurt([(0, how)], for_s, is_over, then_s)

    @rule(robots=st.lists(st.tuples(ROBOT, HOW), min_size=1, max_size=2), for_s=FOR_S, is_over=OVER, then_s=FOR_S)
    def robots_have_troubles(self, robots: list[tuple[int, str]], for_s: float, is_over: bool, then_s: float) -> None:
        self.hurt(robots, for_s, is_over, then_s)

    def hurt(self, robots: list[tuple[int, str]], for_s: float, is_over: bool, then_s: float) -> None:
        if not any(content.is_running for content in self.world.contents().values()):
            self.another_mission_is_started()
        names = [self.name(robot) for robot, _ in robots]
        for name, (_, how) in zip(names, robots, strict=True):
            if how in ("dies", "restarts"):
                self.time.frozen.discard(name)
                self.world.kill(name)
            if how == "restarts":  # at once, so that nobody has missed it
                self.mend(name)
                self.troubled.add(name)
                self.world.trouble_at[name] = self.time.now
            elif how == "hangs" and not self.world.robots[name].is_dead:
                self.time.frozen.add(name)
            if how in ("gets no events", "is cut off"):
                self.world.bus.disconnected.add(name)
            if how == "gets no assignments":
                self.world.bus.lost.add((name, "mission.proposal"))
            is_under_way = any(each.part and not each.part.has_ended for each in self.world.robots.values())
            is_unheard = how in ("gets no events", "is cut off") and not is_under_way  # nobody's offer comes to it
            self.is_split = self.is_split or is_unheard or how == "gets no calls"
            if how in ("gets no calls", "is cut off"):
                self.world.cut_off.add(name)
        self.run_for(for_s)
        if is_over:
            for name in names:
                self.mend(name)
            self.run_for(then_s)

    @rule(for_s=FOR_S, then_s=FOR_S)
    def mission_control_is_started_again(self, for_s: float, then_s: float) -> None:
        self.world.server = None
        self.time.kill(SERVER)
        self.run_for(for_s)
        self.world.start_server()
        self.run_for(then_s)

    @rule(
        what=st.sampled_from(["a step fails", "a step hangs", "an answer is lost", "it is aborted", "nothing"]),
        robot=ROBOT,
        for_s=FOR_S,
    )
    def happens(self, what: str, robot: int, for_s: float) -> None:
        name = self.name(robot)
        if what.startswith("a step"):
            self.failures += 1
            self.world.robots[name].failure = what
        elif what == "an answer is lost":
            self.world.robots[name].loses_answer = True
            self.troubled.add(name)
            self.world.trouble_at[name] = self.time.now + 100.0
        elif what == "it is aborted":
            for mission in self.world.contents():
                self.world.abort(mission)
        self.run_for(for_s)

    def another_mission_is_started(self) -> None:
        self.end()
        self.world.is_carried, self.troubled, self.failures, self.is_split = False, set(), 0, False
        self.world.start(random.Random(len(self.world.contents())).choice(["", *ROBOTS]))
        self.run_for(14.0)

    def name(self, robot: int) -> str:
        """Of a robot by its number in the order of succession of the latest mission."""
        content = max(self.world.contents().values(), key=lambda content: content.begun, default=None)
        first = [content.leader, *content.successors()] if content else []
        return [*first, *(name for name in ROBOTS if name not in first)][robot]

    def mend(self, robot: str) -> None:
        world = self.world
        world.bus.disconnected.discard(robot)
        world.bus.lost.discard((robot, "mission.proposal"))
        world.cut_off.discard(robot)
        if world.robots[robot].is_dead:
            world.robots[robot] = Process(world, robot)
        elif robot in self.time.frozen:
            self.time.frozen.discard(robot)
            world.robots[robot].thaw()

    # ---- what must hold ----

    def check(self) -> None:
        world = self.world
        assert not world.wrong, world.wrong
        assert not self.time.defects, self.time.defects
        assert not self.defects.found, self.defects.found
        assert all(len(robots) == 1 for robots in world.led_in.values()), world.led_in
        for name, robot in world.robots.items():
            part = robot.part
            if robot.is_dead or name in self.time.frozen or part is None or part.has_ended:
                continue
            silent_s = self.time.now - max(robot.ordered_at, robot.went_on_at)
            assert silent_s <= TAKING_PART.holding_timeout_s + 5.0, f"{name} waits for orders"

    def end(self) -> None:
        """Once all are well, each mission ends; then all robots are free, and nobody tries to write its record."""
        world = self.world
        for robot in ROBOTS:
            self.mend(robot)
        for _ in range(40):
            self.run_for(5.0)
            is_over = not any(content.is_running for content in world.contents().values())
            if is_over and all(robot.agent.is_free for robot in world.robots.values()):
                break
        for name, content in world.contents().items():
            assert not content.is_running, f"{name} runs still"
            assert content.reason or content.result is MissionResult.DONE, f"{name} has failed without a reason"
        busy = [name for name, robot in world.robots.items() if not robot.agent.is_free]
        assert not busy, f"{busy} are not free"
        name, last = max(world.contents().items(), key=lambda found: found[1].begun, default=("", None))
        if last and last.result is MissionResult.DONE and not self.troubled:
            assert last.ended - 1e9 <= world.aborted.get(name, math.inf) + 2.0, f"{name} goes on after its abort"
        self.run_for(10.0)
        before = world.writes
        self.run_for(10.0)
        assert world.writes == before, "records are written again and again"
        # Mission control gives a mission away whose leader it does not reach, though the members still do.
        if not self.is_split and len(self.troubled) <= 1 and SERVER not in self.troubled and self.failures <= 2:
            assert last
            if not world.is_abort_wanted:
                assert last.result is MissionResult.DONE, f"{self.troubled} had troubles: {last.reason}"
            elif not self.troubled:
                assert last.result in (MissionResult.DONE, MissionResult.ABORTED), last


@contextlib.contextmanager
def a_mission_led_by_a(for_s: float) -> Iterator[Missions]:
    missions = Missions()
    try:
        missions.a_mission_is_started(0, "A", for_s)
        yield missions
    finally:
        missions.teardown()


@pytest.mark.parametrize(
    ("begins_s", "how", "for_s"),
    [
        # It receives no orders, not even its own, while it holds the object; no user has aborted that.
        (10.0, "gets no events", 12.0),
        # Mission control, which does not reach it, lets another robot lead.
        (4.0, "gets no calls", 45.0),
        # It comes back when another one has claimed the mission, whose part under it ends meanwhile.
        (14.0, "is cut off", 5.0),
        # It assigns parts after another robot has led the mission to its end.
        *((begins_s, "hangs", 60.0) for begins_s in (1.0, 1.25, 1.5, 1.75, 2.0)),
    ],
)
def test_a_leader_goes_on_late(begins_s: float, how: str, for_s: float) -> None:
    with a_mission_led_by_a(begins_s) as missions:
        missions.the_leader_has_a_trouble(how, for_s, True, 12.0)


@pytest.mark.parametrize(
    ("robot", "leader", "phases"),
    [
        (1, "A", ["phase 2", "phase 2 without B", "phase 3 without B"]),
        (0, "B", ["recovering", "phase 2 without A", "phase 3 without A"]),
    ],
)
def test_carriers_go_on_without_one_that_dies(robot: int, leader: str, phases: list[str]) -> None:
    """It is not needed. They do not put the desk down, also under another leader."""
    with a_mission_led_by_a(14.0) as missions:
        missions.hurt([(robot, "dies")], 60.0, False, 0.0)
        (content,) = missions.world.contents().values()
        assert (content.result, content.leader, content.faults) == (MissionResult.DONE, leader, ())
        assert [phase.name for phase in content.phases][-3:] == phases
        assert sorted(missions.world.held) == ["A", "B", "C"], "each has gripped it once"


def test_a_robot_whose_assignment_is_lost_reads_the_plan_in_the_leaders_data_pool() -> None:
    with a_mission_led_by_a(0.25) as missions:
        missions.world.bus.lost = {(name, "mission.proposal") for name in "BCD"}
        missions.run_for(60.0)
        (content,) = missions.world.contents().values()
        assert (content.result, content.faults) == (MissionResult.DONE, ())
        assert sorted(missions.world.held)[0] == "A" and len(missions.world.held) == 3


def test_an_aborted_mission_ends_as_aborted() -> None:
    with a_mission_led_by_a(10.0) as missions:
        missions.happens("it is aborted", 0, 12.0)
        (content,) = missions.world.contents().values()
        assert (content.result, content.reason) == (MissionResult.ABORTED, "phase 1: A: it was aborted")


TestMissions = Missions.TestCase
TestMissions.settings = settings(max_examples=6, stateful_step_count=6, deadline=None)

"""Programs do what was ordered, whatever is ordered when, against a model that knows nothing of how they run.

The agent, its runner and its control loop are real. Their threads take turns and time is the test's, so that each run
is the same. A program's say icon lets something happen at the same time, as if another thread had been as quick."""

from __future__ import annotations

import contextlib
import functools
import json
import threading
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.errors.robots import MotionFailed, RobotError, RobotLost
from robocorba.robot import agent as agent_module
from robocorba.robot import emergency_stop, execution_control, high_controller, model_switcher, runner
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.agent import AgentCalls, ControlAgent
from robocorba.robot.agent_state import ProgramReport, ProgramResult
from robocorba.robot.high_controller import TICK_S
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, ActorCommand, RobotState
from robocorba.robot.programs.program import Program, loads
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.runner import ReceivedEvent
from robocorba.robot.session import BuildingSession, SessionState
from robocorba.robot.simulated_adaptor import SimulatedSenses
from robocorba.simulation.attended_time import AttendedTime
from robocorba.simulation.emergency_stops import StopHold
from robocorba.simulation.registry import Pose
from tests.clock import Clock
from tests.robot.places import Channel
from tests.robot.turns import end_turn, take_turns

#: Time that drives and waits take [s]; how much later they may end, for the base has to brake; more for each pause.
LASTS_S, LATE_S, LATE_BY_PAUSE_S = 0.2, 0.6, 0.06
AWAY, ABORTED, ALONE = "nobody answers", "it was aborted", "nobody else is here"
UNANSWERED = "was not answered within"
NEAR_M, FAR_M = 0.1, 2.0
FREE = StopHold(False, 0, "")

Plain = dict[str, Any]
Course = Generator[None, None, str | None]

# ---- programs as plain data ----

ORDERS = ("pause", "resume", "step", "abort", "stop", "stop again", "reset", "load", "run", "switch")
HAPPENINGS = ("near", "far", "event", "yes", "no", "late")
BY_LASER = {"sensor": "laser", "distance": 0.5}
CONDITIONS: list[Plain] = [
    {"when": "closer_than", **BY_LASER},
    {"when": "farther_than", **BY_LASER},
    {"when": "event", "type": "table.*"},
    {"when": "event", "source": "C"},
    *({"when": "result", "result": result} for result in ("done", "stopped", "timed_out", "refused")),
]
REFUSED = {"when": "result", "result": "refused"}
SAID = [{"icon": "say", "type": "hello", "payload": None}]
DRIVE = {"icon": "mbase_velocity", "ahead": 0.1, "left": 0.0, "turn": 0.0, "seconds": LASTS_S}
OTHER: Plain = {"name": "other", "icons": [DRIVE, DRIVE]}


def plain(**parts: Any) -> st.SearchStrategy[Plain]:
    """Values, or lists of them to draw from."""
    draws = {name: st.sampled_from(part) if isinstance(part, list) else part for name, part in parts.items()}
    return st.fixed_dictionaries(
        {name: part if isinstance(part, st.SearchStrategy) else st.just(part) for name, part in draws.items()}
    )


leaves = st.one_of(
    st.just(DRIVE),
    plain(icon="wait", seconds=LASTS_S),
    plain(icon="wait_until", seconds=LASTS_S, condition=CONDITIONS),
    plain(icon="confirm", question="hand is free?", seconds=LASTS_S, on_no=["fail", "go_on"]),
    plain(icon="say", type=["hello", *ORDERS, *HAPPENINGS], payload={"n": [1, None]}),
    plain(icon="move_table", table=["light", "heavy", "odd"], to={"floor": "L1", "x": 0, "y": 0}),
)


def bodies(icons: st.SearchStrategy[Plain]) -> st.SearchStrategy[Plain]:
    inside = st.lists(icons, min_size=1, max_size=3)
    return st.one_of(
        plain(icon="repeat", times=[1, 2, 3], icons=inside),
        plain(icon="stop_if_closer", **BY_LASER, icons=inside),
        plain(icon="branch", condition=CONDITIONS, then=inside, otherwise=st.just([]) | inside),
    )


GUARDED: Plain = {"icon": "stop_if_closer", **BY_LASER, "icons": [DRIVE]}
WAITS: list[Plain] = [{"icon": "wait_until", "seconds": LASTS_S, "condition": CONDITIONS[number]} for number in (0, 2)]
CARRY: Plain = {"icon": "move_table", "table": "light", "to": {"floor": "L1", "x": 0, "y": 0}}
#: Pieces that random programs seldom have, beside questions for a result.
PIECES: list[Plain] = [
    {"icon": "stop_if_closer", **BY_LASER, "icons": [GUARDED, DRIVE]},
    WAITS[0],
    {"icon": "repeat", "times": 3, "icons": [WAITS[1]]},
    {"icon": "repeat", "times": 2, "icons": [CARRY]},
]
asking = plain(icon="branch", condition=CONDITIONS[-4:], then=[[DRIVE]], otherwise=[[]])
icon_lists = st.tuples(
    st.lists(st.recursive(leaves, bodies, max_leaves=5), max_size=2),
    st.lists(st.sampled_from(PIECES), max_size=1),
    st.lists(asking, max_size=1),
    st.lists(st.recursive(leaves, bodies, max_leaves=5), min_size=1, max_size=2),
).map(lambda parts: [icon for part in parts for icon in part])
programs = plain(name=[*["fetch", "carry"] * 4, "wrong"], icons=icon_lists)


# ---- the model ----


class Interrupted(Exception):
    """watch: the path of the sensor stop that interrupts; empty for an operator."""

    def __init__(self, reason: str, watch: str = "") -> None:
        self.reason, self.watch = reason, watch


class Failed(Exception):
    pass


@dataclass
class Lasting:
    """A drive or a wait that takes its time [s]."""

    is_drive: bool
    lasts_s: float
    late_s: float = LATE_S
    passed_s: float = 0.0
    is_over: bool = False


class Model:
    """What is promised of programs: the robot's side of the IDL, and docs/programs.md."""

    def __init__(self) -> None:
        self.program: Plain | None = None
        self.stops: list[str] = []
        self.is_away = self.is_lost = self.is_near = False
        self.still_s = 0.0
        self.missions: list[str] = []
        self.said: list[tuple[Any, bool]] = []
        self._clear()

    def _clear(self) -> None:
        self.course: Course | None = None
        #: Whether its thread has not ended yet, though its result is known.
        self.lingers = self.is_paused = self.is_stepping = False
        self.mission, self.outcome = "", "done"
        self.interruptions: list[Interrupted] = []
        self.watches: dict[str, bool] = {}
        self.events: list[tuple[str, str]] = []
        self.lasting: Lasting | None = None
        self.asked, self.answer = "", ""
        self.begun: list[tuple[str, str]] = []
        self.report = ProgramReport()

    def set(self, **changes: Any) -> None:
        self.report = self.report._replace(**changes)

    @property
    def condition(self) -> str:
        if self.stops or self.is_lost:
            return "STOPPED"
        return ("PAUSED" if self.is_paused else "RUNNING") if self.course else "IDLE"

    # ---- what is ordered and what happens; whether it is accepted ----

    def load(self, program: Plain) -> bool:
        if self.course or program["name"] == "wrong":
            return False
        self.program = program
        return True

    def run(self, is_stepping: bool = False, mission: str = "", is_stopped: bool = False) -> bool:
        if self.course or self.stops or self.is_lost or self.program is None:
            return False
        self._clear()
        self.is_stepping, self.mission = is_stepping, mission
        self.set(name=self.program["name"])
        self.course = self._run(self.program["icons"])
        if is_stopped:
            self.order("stop")
        return True

    def order(self, what: str) -> bool:
        if what in ("pause", "resume", "step"):
            if not (self.course or self.lingers):
                return False
            self.is_paused = what == "pause"
            self.is_stepping = what == "step" or (what == "pause" and self.is_stepping)
            if self.lasting and what == "pause":
                self.lasting.late_s += LATE_BY_PAUSE_S
        elif what in ("abort", "stop", "stop again"):
            self.stops += [what] * (what != "abort" and what not in self.stops)
            if self.course:
                self.interruptions.append(Interrupted(ABORTED if what == "abort" else what))
                self.is_paused = False
        elif what == "reset":
            if self.course or self.is_away or not (self.stops or self.is_lost):
                return False
            self.stops, self.is_lost = [], False
        elif what == "load":
            return self.load(OTHER)
        elif what == "run":
            return self.run()
        elif what == "switch":
            return self.course is None
        elif what in ("near", "far"):
            self.is_near = what == "near"
        elif what in ("yes", "no"):
            self.asked, self.answer, was_asked = "", what, self.asked
            return bool(was_asked)
        elif what == "late":
            return False
        elif what == "event":
            self.events += [("table.up", "B"), ("door", "C")]
        return True

    def pass_time(self, seconds: float) -> None:
        is_still = self.is_paused or not (self.lasting and self.lasting.is_drive)
        self.still_s = self.still_s + seconds if is_still else 0.0
        if self.lasting and not self.is_paused:
            self.lasting.passed_s += seconds

    def go_on(self) -> None:
        """As far as the program gets without time or an order."""
        count = -1
        while self.course and count != len(self.interruptions):
            count = len(self.interruptions)
            with contextlib.suppress(StopIteration):
                next(self.course)
                for path, has_seen in self.watches.items():
                    if self.is_near and not has_seen:
                        self.watches[path] = True
                        self.interruptions.append(Interrupted("sees an obstacle", path))
                continue
            self.course = None

    # ---- the program; it yields where it needs time or an order ----

    def _run(self, icons: Sequence[Plain]) -> Course:
        try:
            yield from self._icons("icons", icons)
            self.set(result=ProgramResult.DONE, icon="", kind="")
        except Interrupted as why:
            self.set(result=ProgramResult.ABORTED, reason=why.reason)
        except Failed as why:
            self.set(result=ProgramResult.FAILED, reason=str(why))

    def _icons(self, parent: str, icons: Sequence[Plain]) -> Course:
        for number, icon in enumerate(icons):
            path, kind = f"{parent}[{number}]", icon["icon"]
            self.set(icon=path, kind=kind)
            self.is_paused |= self.is_stepping
            yield from self._held()
            self.begun.append((path, kind))
            self.outcome = (yield from getattr(self, f"_{kind}")(icon, path)) or "done"
            self.set(icons_done=self.report.icons_done + 1)

    def _held(self, is_driving: bool = False) -> Course:
        """A loss ends a drive though it is paused, and a wait only when that goes on."""
        while self.is_paused or self.interruptions:
            if self.interruptions:
                raise self.interruptions[0]
            if is_driving and self.is_lost:
                return
            yield

    def _lasts(self, lasts_s: float, is_drive: bool, is_met: Callable[[], bool] = lambda: False) -> Course:
        yield from self._held()
        self.lasting = lasting = Lasting(is_drive, lasts_s)
        try:
            while not self.is_lost:
                if is_met():
                    return "done"
                if lasting.is_over:
                    return "timed_out"
                yield
                yield from self._held(is_drive)
            raise Failed(AWAY)
        finally:
            self.lasting = None

    def _mbase_velocity(self, icon: Plain, path: str) -> Course:
        yield from self._lasts(icon["seconds"], True)

    def _wait(self, icon: Plain, path: str) -> Course:
        yield from self._lasts(icon["seconds"], False)

    def _wait_until(self, icon: Plain, path: str) -> Course:
        return (yield from self._lasts(icon["seconds"], False, lambda: self._is_met(icon["condition"])))

    def _confirm(self, icon: Plain, path: str) -> Course:
        self.asked, self.answer = icon["question"], ""
        try:
            yield from self._lasts(icon["seconds"], False, lambda: bool(self.answer))
        finally:
            self.asked = ""
        if self.answer != "yes" and icon["on_no"] == "fail":
            raise Failed("with no" if self.answer else UNANSWERED)
        return {"yes": "done", "no": "refused"}.get(self.answer, "timed_out")

    def _say(self, icon: Plain, path: str) -> Course:
        self.said.append((icon["payload"], self.order(icon["type"])))
        yield from ()

    def _move_table(self, icon: Plain, path: str) -> Course:
        self.missions.append(self.mission)
        self.mission = ""
        if icon["table"] != "light":
            raise Failed(ALONE if icon["table"] == "heavy" else "ValueError: odd")
        yield from ()

    def _repeat(self, icon: Plain, path: str) -> Course:
        for _ in range(icon["times"]):
            yield from self._icons(f"{path}.icons", icon["icons"])

    def _branch(self, icon: Plain, path: str) -> Course:
        name = "then" if self._is_met(icon["condition"]) else "otherwise"
        yield from self._icons(f"{path}.{name}", icon[name])
        return self.outcome

    def _stop_if_closer(self, icon: Plain, path: str) -> Course:
        self.watches[path] = False
        try:
            yield from self._icons(f"{path}.icons", icon["icons"])
            return "done"
        except Interrupted as why:
            if why.watch != path:
                raise
        finally:
            del self.watches[path]
            self.interruptions = [why for why in self.interruptions if why.watch != path]
        yield from self._lasts(0.0, True)
        return "stopped"

    def _is_met(self, condition: Plain) -> bool:
        if "result" in condition:
            return bool(self.outcome == condition["result"])
        if "sensor" in condition:
            return self.is_near is (condition["when"] == "closer_than")
        wanted = ("table.up", "B") if "type" in condition else ("door", "C")
        is_met = wanted in self.events
        if is_met:
            self.events.remove(wanted)
        return is_met


# ---- the robot ----


class Body(RobotAdaptor):
    """An ideal base."""

    is_in_building = True

    def __init__(self, place: Place) -> None:
        self._place, self.is_started, self.velocity = place, False, ZERO_VELOCITY
        self.senses = SimulatedSenses(place.session)
        place.body = self

    def start(self, argv: Sequence[str]) -> bool:
        if self._place.is_away:
            raise RobotLost(AWAY)
        self.is_started = True
        return True

    def stop(self) -> bool:
        was_started, self.is_started, self.velocity = self.is_started, False, ZERO_VELOCITY
        return was_started

    def read(self, state: RobotState) -> bool:
        if self._place.is_away:
            raise RobotLost(AWAY)
        state.time, state.velocity = self._place.clock.now, self.velocity
        state.joints = state.joint_velocities = np.zeros(len(JOINTS))
        return self.is_started

    def write(self, command: ActorCommand) -> bool:
        self.velocity = command.velocity
        return True


class Place(Channel):
    """A robot's process, and its channel. is_away: the robot does not answer."""

    body: Body

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        super().__init__()
        self.clock, self.is_away, self.is_near = Clock(), False, False
        modules = agent_module, execution_control, high_controller, runner
        self.threads = take_turns(patch, self.clock, *modules)
        patch.setattr(high_controller, "AttendedTime", lambda **how: AttendedTime(self.clock, **how))
        for module in (agent_module, emergency_stop):
            patch.setattr(module, "Repeating", MagicMock())
        patch.setattr(model_switcher, "make", lambda name, context: Body(self))
        at = SessionState(0.0, Pose("L1", 0.0, 0.0), ZERO_VELOCITY, "", None, 0, "")
        self.session = session = MagicMock(spec=BuildingSession, latest=at)
        session.hold.return_value = session.end_stops.return_value = FREE
        session.report_stop.return_value = True, FREE
        session.scan.side_effect = lambda *_: np.full(181, NEAR_M if self.is_near else FAR_M)
        #: The number of the last question that was answered.
        self.answered = 1
        #: What happens while a program is about to begin.
        self.meanwhile = ""
        self.agent = ControlAgent(
            *(AdaptorContext("A", session, None), MagicMock(), self),
            calls=AgentCalls(check, lambda: self.order(self.meanwhile), self._changed),
        )
        self.agent.start("ideal")

    @property
    def program_thread(self) -> Any:
        return next((thread for thread in reversed(self.threads) if thread.name == "program"), None)

    @property
    def lingers(self) -> bool:
        """Whether a program has its result, and its thread has not ended yet."""
        thread = self.program_thread
        return thread is not None and not thread.is_over and self.report.result is not ProgramResult.NO_RESULT

    @property
    def report(self) -> ProgramReport:
        return self.agent.state.program

    def _changed(self) -> None:
        if self.threads and threading.current_thread() is self.program_thread:
            end_turn()

    def tick(self) -> None:
        """A cycle of the control loop."""
        self.clock.now += TICK_S
        for thread in [thread for thread in self.threads if thread.name == "high controller"]:
            thread.turn()
            thread.turn()  # an idle one waits twice in each cycle

    def settle(self, lingers: bool = False) -> None:
        """Let all threads get as far as they can without a tick. lingers: a program's thread does not quite end."""
        before: object = None
        while before != (before := self._progress()) and not (lingers and self.lingers):
            for name in ("program", "sensor stop"):
                for thread in [thread for thread in self.threads if thread.name == name]:
                    thread.turn()

    def _progress(self) -> object:
        over, state = sum(thread.is_over for thread in self.threads), self.agent.state
        return over, len(self.threads), len(self.agent.begun(0)), state.condition, state.program._replace(seconds=0.0)

    def order(self, what: str) -> bool:
        """Returns whether it is accepted."""
        orders: dict[str, Callable[[], object]] = {
            "stop": lambda: self.agent.stop("stop"),
            "stop again": lambda: self.agent.stop("stop again"),
            "reset": self.agent.reset_stop,
            "load": lambda: self.agent.load(loaded(OTHER)),
            "switch": lambda: self.agent.switch("ideal", ()),
            "near": lambda: setattr(self, "is_near", True),
            "far": lambda: setattr(self, "is_near", False),
            "event": self._send_events,
            "yes": lambda: self._answer(True),
            "no": lambda: self._answer(False),
            "late": lambda: self.agent.answer(self.answered, True),
        }
        return accepts(orders.get(what, getattr(self.agent, what, lambda: None)))

    def _answer(self, is_yes: bool) -> None:
        number = self.agent.question.number
        self.agent.answer(number, is_yes)
        self.answered = number

    def _send_events(self) -> None:
        self.receive(ReceivedEvent("table.up", "B", None))
        self.receive(ReceivedEvent("door", "C", None))

    # ---- what a program calls ----

    def publish(self, type: str, payload: Any) -> None:
        self.said.append((payload, self.order(type)))

    def cooperate(self, icon: Any, mission: str = "") -> None:
        self.missions.append(mission)
        if icon.table == "odd":
            raise ValueError("odd")
        if icon.table == "heavy":
            raise MotionFailed(ALONE)


def check(program: Program, state: object) -> CheckReport:
    report = CheckReport()
    if program.name == "wrong":
        report.add_finding("icons[0]", "", "is wrong")
    return report


def loaded(program: Plain) -> Program:
    return _read(json.dumps(program))


_read = functools.lru_cache(loads)


def accepts(order: Callable[[], object]) -> bool:
    try:
        order()
    except RobotError:
        return False
    return True


class Runs(RuleBasedStateMachine):
    """An agent and its model get the same orders."""

    @initialize()
    def begin(self) -> None:
        self._closing = contextlib.ExitStack()
        self.place = Place(self._closing.enter_context(pytest.MonkeyPatch.context()))
        self._closing.callback(self.place.agent.close)
        self.model = Model()

    def teardown(self) -> None:
        if hasattr(self, "_closing"):
            self._closing.close()

    def _settle(self, lingers: bool = False) -> None:
        self.place.settle(lingers)
        self.model.go_on()
        self.model.lingers = self.place.lingers

    @rule(program=programs)
    def load(self, program: Plain) -> None:
        assert accepts(lambda: self.place.agent.load(loaded(program))) == self.model.load(program)
        self._settle()

    @rule(is_stepping=st.booleans(), meanwhile=st.sampled_from(["", "", "", "stop"]), lingers=st.booleans())
    def run(self, is_stepping: bool, meanwhile: str, lingers: bool) -> None:
        self.place.meanwhile = meanwhile
        is_accepted = accepts(lambda: self.place.agent.run(is_stepping))
        self.place.meanwhile = ""
        assert is_accepted == self.model.run(is_stepping, is_stopped=bool(meanwhile))
        self._settle(lingers)

    @rule(program=programs, mission=st.sampled_from(["", "carry-1"]), lingers=st.booleans())
    def start_mission(self, program: Plain, mission: str, lingers: bool) -> None:
        is_accepted = accepts(lambda: self.place.agent.start_mission(mission, loaded(program)))
        assert is_accepted == (self.model.load(program) and self.model.run(mission=mission))
        self._settle(lingers)

    @rule(
        program=programs,
        is_stepping=st.sampled_from([False, False, True]),
        ticks=st.integers(0, 20),
        then=st.sampled_from(["near", "event", "hold", "step"]),
    )
    def begin_anew(self, program: Plain, is_stepping: bool, ticks: int, then: str) -> None:
        """Whatever went on before. then: what happens after some ticks; `hold`: a pause of some ticks."""
        self._end()
        if is_stepping:
            self.load(program)
            self.run(True, "", False)
        else:
            self.start_mission(program, "carry-1", False)
        self.pass_time(ticks, False, False)
        self.order(then, False)
        self.pass_time(25, False, then == "hold")
        self.pass_time(12, False, False)

    def _end(self) -> None:
        self._find()
        for what in ("abort", "reset", "far"):
            self.order(what, False)

    @rule(on_no=st.sampled_from(["fail", "go_on"]), ticks=st.integers(0, 40), data=st.data())
    def be_asked(self, on_no: str, ticks: int, data: st.DataObject) -> None:
        """Twice, with what is done then told by the result; a late answer is one to the first question."""
        asked = {"icon": "confirm", "question": "free?", "seconds": 2 * LASTS_S, "on_no": on_no}
        told = {"icon": "branch", "condition": REFUSED, "then": SAID, "otherwise": []}
        self._end()
        self.start_mission({"name": "fetch", "icons": [asked, told, asked]}, "carry-1", False)
        self.control([data.draw(st.sampled_from(["yes", "yes", "no", "late"]))])
        self.control(data.draw(st.lists(st.sampled_from(["yes", "no", "late", "late", *ORDERS[:5]]), max_size=4)))
        self.pass_time(ticks, False, data.draw(st.booleans()))

    @rule(what=st.sampled_from((*ORDERS, *HAPPENINGS)), lingers=st.booleans())
    def order(self, what: str, lingers: bool) -> None:
        if what == "switch" and self.place.is_away:
            return  # neither adaptor could start
        assert self.place.order(what) == self.model.order(what)
        self._settle(lingers)

    @rule(steps=st.lists(st.sampled_from(["pause", "resume", "step", "step", "near", "far"]), min_size=1, max_size=4))
    def control(self, steps: list[str]) -> None:
        for what in steps:
            self.order(what, False)
            self.agrees()

    @rule(ticks=st.integers(1, 40), lingers=st.booleans(), is_held=st.booleans())
    def pass_time(self, ticks: int, lingers: bool, is_held: bool) -> None:
        """is_held: the program is paused meanwhile."""
        if is_held:
            self.order("pause", False)
        for _ in range(ticks):
            self._tick(lingers)
            self.agrees()
        if is_held:
            self.order("resume", False)

    def _tick(self, lingers: bool = False) -> None:
        self.place.tick()
        self.place.settle(lingers)
        self.model.pass_time(TICK_S)
        report, lasting = self.place.report, self.model.lasting
        if lasting is not None:
            has_ended = report.icons_done > self.model.report.icons_done or report.result is ProgramResult.DONE
            has_ended |= UNANSWERED in report.reason
            assert lasting.passed_s > lasting.lasts_s - 1.5 * TICK_S or not has_ended, "an icon ends too soon"
            assert lasting.passed_s < lasting.lasts_s + lasting.late_s or has_ended, "an icon does not end"
            lasting.is_over = has_ended
        self._settle(lingers)

    @rule(is_found=st.booleans())
    def lose(self, is_found: bool) -> None:
        """The robot does not answer for a while."""
        self.place.is_away = self.model.is_away = True
        for _ in range(3):
            self._tick()
            if self.place.agent.stopped and not self.model.stops:
                self.model.is_lost = True
                self._settle()
        assert self.place.agent.stopped
        self.agrees()
        if is_found:
            self._find()

    def _find(self) -> None:
        self.place.is_away = self.model.is_away = False
        for _ in range(60):
            if self.model.is_lost and not self.model.stops:
                self._tick()
                self.model.is_lost = bool(self.place.agent.stopped)
        self.agrees()

    @invariant()
    def agrees(self) -> None:
        if not hasattr(self, "model"):
            return
        model, agent = self.model, self.place.agent
        state, report = agent.state, agent.state.program
        assert report._replace(reason="", seconds=0.0) == model.report._replace(reason="")
        assert model.report.reason in report.reason and bool(model.report.reason) == bool(report.reason)
        begun = agent.begun(0)
        assert [(icon.icon, icon.kind) for icon in begun] == model.begun
        assert [icon.number for icon in begun] == [*range(len(begun))] and agent.begun(len(begun) - 1) == begun[-1:]
        assert agent.question.text == model.asked
        assert (self.place.said, self.place.missions) == (model.said, model.missions)
        assert agent.program == (model.program and loaded(model.program))
        assert model.lingers or state.condition.name == model.condition
        assert agent.stopped == (model.stops[0] if model.stops else AWAY * model.is_lost)
        assert self.place.body.is_started is not bool(agent.stopped)
        is_still = not any(self.place.body.velocity)
        assert is_still or model.still_s < LATE_S, "it moves though nothing shall"
        lasting = model.lasting
        if lasting and lasting.is_drive and not model.is_paused and 3 * TICK_S < lasting.passed_s < lasting.lasts_s:
            assert not is_still, "it does not drive"


TestRuns = Runs.TestCase
TestRuns.settings = settings(deadline=None, max_examples=6, stateful_step_count=30)

"""Time until a robot is stationary after an emergency stop, and after the loss of a process, unit or network.

    python -m bench.robots.stops [--rounds 6] [--only TEXT] [--robot virtual|actual|both]

A real robot process in a real system, virtual and then with the actual robot's stand-in, drives around a circle at the
default speed cap, or moves both arms. As root, the actual robot runs in a network namespace of its own, whose cable is
pulled; otherwise that case is left out.

A fault is noticed when the control agent begins to stop the robot's adaptor. bench/robots/watcher.py observes from
outside when the robot is stationary. All rounds use the same robot; one that does not come back ends the bench."""

from __future__ import annotations

import contextlib
import math
import os
import random
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from bench.common.harness import System, progress, run, skip
from bench.robots.recorded_robot import FLOOR, NAME, RecordedRobot, system_on_two_floors
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.high_controller import SPEED_CAP
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.actual_robot import StandIn, running_stand_in
from testkit.json_process import Process, checkout_command
from testkit.namespaces import Namespace, ip, own_network
from testkit.processes import eventually
from testkit.report import at_most, summarize, summary

MAX_MS = 100.0
PATIENCE_S = 60.0
#: Velocity on a circle with a radius of 1.5 m [m/s] and [rad/s].
CIRCLE = SPEED_CAP, 0.0, SPEED_CAP / 1.5
FULL_SPEED_M_S, ARM_SPEED_RAD_S = 0.97 * SPEED_CAP, 0.65
#: Time for which a stop is observed, for which a process is paused, and until a killed one may log on again [s].
WATCH_S, PAUSE_S, LEASE_S = 0.8, 2.5, 3.0
#: Distances from the final place within which a base that does not drive and an arm are stationary [m, rad] and [rad].
BASE_STANDS, ARM_STANDS_RAD = 0.005, math.radians(0.1)
#: Divisor of the number of rounds in cases that kill a process, because its restart takes long.
KILLS_SHARE = 4
CABLE = "cable"


class Stop(NamedTuple):
    """One round, with times since the fault [ms]; None where it was not noticed, or not observed to stand."""

    noticed_ms: float | None
    stands_ms: float | None

    @property
    def after_notice_ms(self) -> float | None:
        return None if self.stands_ms is None else self.stands_ms - (self.noticed_ms or 0.0)


class Case(NamedTuple):
    """A kind of fault. happens: causes it. over: ends it. is_silent: no process is left to notice it; then there is no
    mark."""

    what: str
    happens: Callable[[], object]
    over: Callable[[], object] = lambda: None
    moves: str = "base"
    is_silent: bool = False


class Stage:
    """One robot, which is restarted after its process was killed. actual: the stand-in of an actual robot, cable: the
    network namespace that it is in."""

    def __init__(self, place: System, actual: StandIn | None, cable: Namespace | None) -> None:
        self._folder, _, _, self._orb = place
        self._actual, self._cable, self._starts = actual, cable, 0
        self.robot = self._start()
        what = ("units", str(actual.naming)) if actual else ("building", str(self._orb.naming), FLOOR, NAME)
        command = (*(cable.command() if cable else ()), *checkout_command("bench.robots.watcher", *what))
        self._watcher = Process(command, self._folder / f"watcher-{what[0]}.log")
        self._watcher.receive(PATIENCE_S)

    def close(self) -> None:
        with self._watcher:
            self.robot.close()

    def _start(self) -> RecordedRobot:
        self._starts += 1
        which = "actual" if self._actual else "virtual"
        adaptor = ("smartpal", "--naming", str(self._actual.naming)) if self._actual else ()
        return RecordedRobot(self._folder / f"{which}-{self._starts}", self._orb, "5,2,0", adaptor)

    # ---- a round ----

    def round(self, case: Case) -> Stop:
        self._set_off(case.moves)
        time.sleep(random.uniform(0.0, 0.1))
        self._watcher.ask("so far", PATIENCE_S)
        began = time.monotonic()
        case.happens()
        if not case.is_silent:
            eventually(lambda: self._condition() is AgentCondition.STOPPED, PATIENCE_S, "a reported stop")
        time.sleep(max(0.0, began + WATCH_S - time.monotonic()))
        looks = [look for look in self._watcher.ask("since then", PATIENCE_S) if look[0] >= began]
        stands_at = stands(looks, case.moves)
        case.over()
        noticed = [] if case.is_silent else self.robot.stops(began)
        eventually(self._is_back, PATIENCE_S, "that the robot is back")
        return Stop(*(None if at is None else (at - began) * 1e3 for at in (next(iter(noticed), None), stands_at)))

    def _set_off(self, moves: str) -> None:
        builder = ProgramBuilder("stop me")
        if moves == "arms":
            with builder.repeat(100):
                builder.mhand_posture("both", "ready").mhand_posture("both", "tuck")
        else:
            builder.mbase_velocity(*CIRCLE, 600.0)
        self.robot.agent.load(dumps(builder.program()))
        self.robot.agent.run()

        def is_moving() -> bool:
            actor = self.robot.agent.state().actor
            arms, base = abs(actor.joint_velocities).max(), math.hypot(*actor.velocity[:2])
            return bool(arms > ARM_SPEED_RAD_S if moves == "arms" else base > FULL_SPEED_M_S)

        eventually(is_moving, PATIENCE_S, f"{moves} that move")

    def _condition(self) -> AgentCondition:
        return self.robot.agent.state().condition

    def _is_back(self) -> bool:
        """Whether the robot can run a program again."""
        try:
            if self._condition() is AgentCondition.STOPPED:
                self.robot.agent.reset_stop()
            elif self._condition() is not AgentCondition.IDLE:
                self.robot.agent.abort()
            return self._condition() is AgentCondition.IDLE
        except (NotReachable, RobotError):
            return False

    # ---- what happens ----

    def _continue_process(self) -> None:
        time.sleep(PAUSE_S)
        self._signal(signal.SIGCONT)

    def _start_process(self) -> None:
        self.robot.close()
        time.sleep(LEASE_S)
        self.robot = self._start()

    def _signal(self, number: signal.Signals) -> None:
        os.kill(self.robot.process.pid, number)

    def cases(self) -> Iterator[Case]:
        def stop() -> None:
            self.robot.agent.stop()

        yield Case("emergency stop", stop)
        if self._actual:
            faults = self._actual.faults
            yield Case("emergency stop, arms move", stop, moves="arms")
            yield Case("a unit is lost", lambda: faults.lost("MnpR", True), faults.none)
        if cable := self._cable:
            pull, plug = (partial(cable.ip, "link", "set", CABLE, state) for state in ("down", "up"))
            yield Case("network is cut", pull, plug)
        hang, kill = (partial(self._signal, number) for number in (signal.SIGSTOP, signal.SIGKILL))
        yield Case("robot process hangs", hang, self._continue_process, is_silent=True)
        yield Case("robot process is killed", kill, self._start_process, is_silent=True)


def stands(looks: list[list[float]], moves: str) -> float | None:
    """The time of the first observation at the final place at which the base does not drive; None if there is none.

    A base may report later that it drives: for an instant, without moving, when the agent reconnects."""
    last = looks[-1] if looks else []

    def is_there(look: list[float]) -> bool:
        if moves == "base":
            return math.dist(look[2:5], last[2:5]) < BASE_STANDS
        return all(abs(a - b) <= ARM_STANDS_RAD for a, b in zip(look[5:], last[5:], strict=True))

    came = max((number for number, look in enumerate(looks) if not is_there(look)), default=-1) + 1
    return next((look[0] for look in looks[came:-1] if not look[1]), None)


def row(which: str, case: Case, stops: Sequence[Stop]) -> dict[str, Any]:
    found: dict[str, Any] = {"robot": which, "what happens": case.what, "rounds": len(stops)}
    for what in ("noticed_ms", "stands_ms", "after_notice_ms"):
        known = [value for one in stops if (value := getattr(one, what)) is not None]
        title = f"{what.removesuffix('_ms').replace('_', ' ')}, ms"
        found |= summary(known, title, worst=f"{title}, worst")
    return found


@contextlib.contextmanager
def own_computer() -> Iterator[tuple[Namespace, str]]:
    """A network namespace that a cable connects to ours, and its address."""
    with Namespace() as robot:
        ip("link", "add", "toward", "type", "veth", "peer", "name", CABLE, "netns", robot.path)
        ip("address", "add", "10.77.0.1/24", "dev", "toward")
        ip("link", "set", "toward", "up")
        robot.ip("address", "add", "10.77.0.2/24", "dev", CABLE)
        robot.ip("link", "set", CABLE, "up")
        yield robot, "10.77.0.2"


@contextlib.contextmanager
def stage(which: str, place: System, has_networks: bool) -> Iterator[Stage]:
    with contextlib.ExitStack() as stack:
        actual, cable, host = None, None, "127.0.0.1"
        if which == "actual":
            if has_networks:
                cable, host = stack.enter_context(own_computer())
            within = cable.command() if cable else ()
            actual = stack.enter_context(
                running_stand_in(place.folder / "robot", orb=place.orb, host=host, within=within)
            )
        yield stack.enter_context(contextlib.closing(Stage(place, actual, cable)))


def main(rounds: int = 6, only: str = "", robot: str = "both") -> bool:
    has_networks = True
    try:
        own_network()
    except OSError:
        has_networks = False
        skip("network is cut", "network namespaces need root")
    rows, marks, samples = [], [], {}
    with system_on_two_floors() as place:
        for which in ("virtual", "actual") if robot == "both" else (robot,):
            with stage(which, place, has_networks) as found:
                for case in (case for case in found.cases() if only in case.what):
                    label = f"{which}: {case.what}"
                    count = max(1, rounds // (KILLS_SHARE if "killed" in case.what else 1))
                    stops = [found.round(case) for _ in progress(range(count), label)]
                    rows.append(row(which, case, stops))
                    samples[label] = [one.stands_ms for one in stops if one.stands_ms is not None]
                    worst = rows[-1]["after notice, ms, worst"]
                    if not case.is_silent and worst is not None:
                        marks.append(at_most(f"{label}: stands after notice, worst, ms", worst, MAX_MS))
    return summarize("stops", f"a robot at {SPEED_CAP:g} m/s that has to stop", rows, marks, samples, "ms")


if __name__ == "__main__":
    run(main, rounds="of each case", only="only cases with these words in their name", robot="virtual|actual|both")

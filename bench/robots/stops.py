"""Time until a robot is stationary after an emergency stop, and after the loss of a process, unit or network.

    python -m bench.robots.stops [--rounds 20]

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
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench.common.harness import progress, run
from bench.robots.recorded_robot import FLOOR, HANG_S, NAME, RecordedRobot, system_on_two_floors
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.high_controller import SPEED_CAP
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.stubs import _GlobalIDL
from testkit.actual_robot import StandIn, running_stand_in
from testkit.json_process import Process, checkout_command
from testkit.namespaces import Namespace, ip, own_network
from testkit.processes import ROBOCORBA, Running, eventually
from testkit.report import at_most, quantile, summarize

MAX_MS = 100.0
PATIENCE_S = 60.0
#: Velocity on a circle with a radius of 1.5 m [m/s] and [rad/s].
CIRCLE = SPEED_CAP, 0.0, SPEED_CAP / 1.5
FULL_SPEED_M_S, ARM_SPEED_RAD_S = 0.97 * SPEED_CAP, 0.65
#: Time for which a stop is observed [s], time for which a process is paused [s], and the greatest movement of an arm
#: that counts as stationary [rad].
WATCH_S, PAUSE_S, ARM_STANDS_RAD = 0.8, 2.5, math.radians(0.1)
#: Distance from its final place within which a base stands if it does not drive [m, rad].
BASE_STANDS = 0.005
#: Divisor of the number of rounds in cases that kill a process, because its restart takes long.
KILLS_SHARE = 4
CABLE = "cable"


class Stop(NamedTuple):
    """One round, with times since the fault. notice_ms: until it was noticed, None if that was impossible. stands_ms:
    until the robot was stationary, None if that was not observed. reported_ms: until the agent's state had `reason`.
    back_ms: from the end of the fault until the robot could run a program again."""

    notice_ms: float | None
    stands_ms: float | None
    reported_ms: float | None
    back_ms: float
    reason: str


class Case(NamedTuple):
    """A kind of fault. happens: causes it, and may return its time if that is not the time of the call. over: ends it.
    is_silent: no process is left to notice it; then there is no mark."""

    what: str
    happens: Callable[[], float | None]
    over: Callable[[], object] = lambda: None
    moves: str = "base"
    is_silent: bool = False


class Stage:
    """One robot, which is restarted after its process was killed. actual: the stand-in of an actual robot, cable: the
    network namespace that it is in."""

    def __init__(
        self, folder: Path, orb: Orb, system: Running, actual: StandIn | None, cable: Namespace | None
    ) -> None:
        self._folder, self._orb, self._system, self._actual, self._cable = folder, orb, system, actual, cable
        self._starts = 0
        self.robot = self._start()
        what = ("units", str(actual.naming)) if actual else ("building", str(orb.naming), FLOOR, NAME)
        command = (*(cable.command() if cable else ()), *checkout_command("bench.robots.watcher", *what))
        self._watcher = Process(command, folder / f"watcher-{what[0]}.log")
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
        called = time.monotonic()
        began = case.happens() or called
        reported_s, reason = (None, "") if case.is_silent else self._reported()
        time.sleep(max(0.0, began + WATCH_S - time.monotonic()))
        looks = [look for look in self._watcher.ask("since then", PATIENCE_S) if look[0] >= began]
        stands_s = self._stands(looks, case.moves)
        case.over()
        over = time.monotonic()
        noticed = [one["at"] for one in self.robot.stops(began) if one["event"] == "stop" and not case.is_silent]
        eventually(self._is_back, PATIENCE_S, "that the robot is back")
        notice_ms, stands_ms, reported_ms = (
            None if at is None else (at - began) * 1e3 for at in (next(iter(noticed), None), stands_s, reported_s)
        )
        return Stop(notice_ms, stands_ms, reported_ms, (time.monotonic() - over) * 1e3, reason)

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
            if moves == "arms":
                return bool(abs(actor.joint_velocities).max() > ARM_SPEED_RAD_S)
            return math.hypot(*actor.velocity[:2]) > FULL_SPEED_M_S

        eventually(is_moving, PATIENCE_S, f"{moves} that move")

    def _reported(self) -> tuple[float, str]:
        def stop_reason() -> str:
            state = self.robot.agent.state()
            return state.reason if state.condition is AgentCondition.STOPPED else ""

        reason = eventually(stop_reason, PATIENCE_S, "that the agent reports the stop")
        return time.monotonic(), str(reason)

    @staticmethod
    def _stands(looks: list[list[float]], moves: str) -> float | None:
        """The time of the first observation at the final place at which the base does not drive; None if there is none.

        A base may report later that it drives: for an instant, without moving, when the agent reconnects."""
        last = looks[-1] if looks else []

        def is_there(look: list[float]) -> bool:
            if moves == "base":
                return math.dist(look[2:5], last[2:5]) < BASE_STANDS
            return all(abs(a - b) <= ARM_STANDS_RAD for a, b in zip(look[5:], last[5:], strict=True))

        came = max((number for number, look in enumerate(looks) if not is_there(look)), default=-1) + 1
        return next((look[0] for look in looks[came:-1] if not look[1]), None)

    def _is_back(self) -> bool:
        """Whether the robot can run a program again."""
        try:
            state = self.robot.agent.state()
            if state.condition is AgentCondition.STOPPED:
                self.robot.agent.reset_stop()
            elif state.condition is not AgentCondition.IDLE:
                self.robot.agent.abort()
            return self.robot.agent.state().condition is AgentCondition.IDLE
        except (NotReachable, RobotError):
            return False

    # ---- what happens ----

    def stop_by_command(self) -> float:
        """Returns the time at which the agent got the call, since the command's Python takes longer to start than the
        robot to stop."""
        asked = time.monotonic()
        command = (ROBOCORBA, "stop", NAME, "--naming", str(self._orb.naming))
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)
        return float(self.robot.stops(asked)[0]["at"])

    def hang_adaptor(self) -> float:
        """Returns the time at which the hanging write began."""
        asked = time.monotonic()
        self._signal(signal.SIGUSR1)
        hangs = eventually(lambda: self.robot.stops(asked), PATIENCE_S, "an adaptor that hangs")
        return float(hangs[0]["at"])

    def stop_while_it_hangs(self) -> float:
        self.hang_adaptor()
        time.sleep(0.03)  # its last command is still valid
        began = time.monotonic()
        self.robot.agent.stop()
        return began

    def continue_process(self) -> None:
        time.sleep(PAUSE_S)
        self._signal(signal.SIGCONT)

    def start_process(self) -> None:
        self.robot.close()
        time.sleep(3.0)  # its lease
        self.robot = self._start()

    def _signal(self, number: signal.Signals) -> None:
        os.kill(self.robot.process.pid, number)

    def cases(self) -> Iterator[Case]:
        def stop() -> None:
            self.robot.agent.stop()

        yield Case("emergency stop over CORBA", stop)
        if self._actual:
            yield Case("emergency stop, arms move", stop, moves="arms")
        yield Case("`robocorba stop`", self.stop_by_command)
        wait = partial(time.sleep, HANG_S)
        yield Case("emergency stop, adaptor hangs", self.stop_while_it_hangs, wait)
        yield Case("adaptor hangs", self.hang_adaptor, wait)
        if self._actual:
            server = self._system.pid
            yield Case("simulation server is killed", lambda: os.kill(server("simulation"), signal.SIGKILL))
            faults = self._actual.faults
            yield Case("a unit is lost", lambda: faults.lost("MnpR", True), faults.none)
            yield Case(
                "a unit has an alarm", lambda: faults.alarm("MnpR", 0x99, _GlobalIDL.FAULT, "too hot"), faults.none
            )
        if cable := self._cable:
            pull, plug = (partial(cable.ip, "link", "set", CABLE, state) for state in ("down", "up"))
            yield Case("network is cut", pull, plug)
        hang, kill = (partial(self._signal, number) for number in (signal.SIGSTOP, signal.SIGKILL))
        yield Case("robot process hangs", hang, self.continue_process, is_silent=True)
        yield Case("robot process is killed", kill, self.start_process, is_silent=True)


def row(which: str, case: Case, stops: list[Stop]) -> dict[str, Any]:
    def of(values: list[float | None], share: float) -> float | None:
        known = [value for value in values if value is not None]
        return quantile(known, share) if known else None

    stands = [one.stands_ms for one in stops]
    after = [None if one.stands_ms is None else one.stands_ms - (one.notice_ms or 0.0) for one in stops]
    return {
        "robot": which,
        "what happens": case.what,
        "rounds": len(stops),
        "noticed after, ms": of([one.notice_ms for one in stops], 0.5),
        "stands after, ms": of(stands, 0.5),
        "worst": of(stands, 1.0),
        "after notice, ms": of(after, 0.5),
        "worst after notice": of(after, 1.0),
        "reported after, ms": of([one.reported_ms for one in stops], 0.5),
        "back after, ms": of([one.back_ms for one in stops], 0.5),
        "the agent says": stops[-1].reason[:40],
    }


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


def main(rounds: int = 20, only: str = "", robot: str = "both") -> bool:
    has_networks = True
    try:
        own_network()
    except OSError:
        has_networks = False
    found: list[tuple[str, Case, list[Stop]]] = []
    with tempfile.TemporaryDirectory() as name, system_on_two_floors(Path(name)) as (system, orb):
        folder = Path(name)
        for which in ("virtual", "actual") if robot == "both" else (robot,):
            with contextlib.ExitStack() as stack:
                actual, cable, host = None, None, "127.0.0.1"
                if which == "actual":
                    if has_networks:
                        cable, host = stack.enter_context(own_computer())
                    within = cable.command() if cable else ()
                    actual = stack.enter_context(running_stand_in(folder / "robot", orb=orb, host=host, within=within))
                stage = stack.enter_context(contextlib.closing(Stage(folder, orb, system, actual, cable)))
                for case in stage.cases():
                    if only in case.what:
                        count = max(1, rounds // (KILLS_SHARE if "killed" in case.what else 1))
                        stops = [stage.round(case) for _ in progress(range(count), f"{which}: {case.what}")]
                        found.append((which, case, stops))
    rows = [row(*one) for one in found]
    labels = [f"{which}: {case.what}" for which, case, _ in found]
    marks = [
        at_most(f"{label}: stands after notice, worst, ms", one["worst after notice"], MAX_MS)
        for label, one, (_, case, _) in zip(labels, rows, found, strict=True)
        if not case.is_silent and one["worst after notice"] is not None
    ]

    def draw(axes: Axes) -> None:
        for number, (_, _, stops) in enumerate(found):
            for column, style in (("stands_ms", "|b"), ("notice_ms", ".r")):
                values = [getattr(one, column) for one in stops if getattr(one, column) is not None]
                axes.plot(values, [number] * len(values), style)
        axes.set(xscale="symlog", xlabel="ms after it happened: noticed (dots), stationary (bars)")
        axes.set_yticks(range(len(labels)), labels, fontsize=7)
        axes.invert_yaxis()

    return summarize("stops", f"a robot at {SPEED_CAP:g} m/s that has to stop", rows, marks, draw)


if __name__ == "__main__":
    run(main, rounds="of each case", only="only cases with these words in their name", robot="virtual|actual|both")

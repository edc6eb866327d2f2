"""Time until a robot is stationary after an emergency stop, and after the loss of a process, unit or network.

    python -m bench.robots.stops [--rounds 20]

A real robot process in a real system, virtual and then with the actual robot's stand-in, drives around a circle at the
default speed cap, or moves both arms. As root, the actual robot runs in a network namespace of its own, whose cable is
pulled; otherwise that case is left out.

A fault is noticed when the control agent begins to stop the robot's adaptor. bench/robots/watcher.py observes from
outside when the robot is stationary. All rounds use the same robot; one that does not come back ends the bench."""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.namespaces import CLONE_NEWNET, Namespace
from bench.common.processes import Process
from bench.robots.place import FLOOR, NAME, RecordedRobot, faults, servers, stand_in
from bench.robots.recorded_robot import HANG_S
from robocorba.control.agent import AgentCondition
from robocorba.control.high_controller import SPEED_CAP
from robocorba.corba.orb import Orb
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import dumps
from robocorba.settings import Address
from robocorba.stubs import _GlobalIDL
from robocorba.testing.processes import ROBOCORBA, Running, eventually
from robocorba.testing.report import PROGRESS, at_most, quantile, summarize

BENCH = "stops"
MAX_MS = 100.0
PATIENCE_S = 60.0
#: Velocity on a circle with a radius of 1.5 m [m/s] and [rad/s].
CIRCLE = SPEED_CAP, 0.0, SPEED_CAP / 1.5
FULL_SPEED_M_S, ARM_SPEED_RAD_S = 0.97 * SPEED_CAP, 0.65
#: Time for which a stop is observed [s], time for which a process is paused [s], and the greatest movement of an arm
#: that counts as stationary [rad].
WATCH_S, PAUSE_S, ARM_STANDS_RAD = 0.8, 2.5, math.radians(0.1)
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
    """A kind of fault. happens: causes it, and returns its time. over: ends it. has_mark: the robot must be stationary
    within MAX_MS after the notice."""

    what: str
    happens: Callable[[], float]
    over: Callable[[], None] = lambda: None
    moves: str = "base"
    is_silent: bool = False
    has_mark: bool = True


class Stage:
    """One robot, which is restarted after its process was killed. naming: that of an actual robot."""

    def __init__(
        self, folder: Path, orb: Orb, system: Running, naming: Address | None, cable: Namespace | None
    ) -> None:
        self._folder, self._orb, self._system, self._naming, self._cable = folder, orb, system, naming, cable
        self._starts = 0
        self._stack = contextlib.ExitStack()
        self.robot = self._start()
        within = cable.command() if cable else ()
        what = ("units", str(naming)) if naming else ("building", str(orb.naming), FLOOR, NAME)
        command = (*within, sys.executable, "-m", "bench.robots.watcher", *what)
        self._watcher = self._stack.enter_context(Process(command, folder / f"watcher-{what[0]}.log"))
        self._watcher.receive(PATIENCE_S)

    def close(self) -> None:
        self.robot.close()
        self._stack.close()

    def _start(self) -> RecordedRobot:
        self._starts += 1
        adaptor = ("--adaptor", "smartpal", "--", "--naming", str(self._naming)) if self._naming else ()
        return RecordedRobot(
            self._folder / f"{'actual' if adaptor else 'virtual'}-{self._starts}", self._orb, "5,2,0", adaptor
        )

    # ---- a round ----

    def round(self, case: Case) -> Stop:
        self._set_off(case.moves)
        time.sleep(random.uniform(0.0, 0.1))
        self._watcher.ask("so far", PATIENCE_S)
        began = case.happens()
        reported_s, reason = (None, "") if case.is_silent else self._reported()
        time.sleep(max(0.0, began + WATCH_S - time.monotonic()))
        looks = [look for look in self._watcher.ask("since then", PATIENCE_S) if look[0] >= began]
        stands_s = self._stands(looks, case.moves)
        case.over()
        over = time.monotonic()
        stops = [one for one in self.robot.stops(began) if one["event"] == "stop"]
        self._come_back()
        return Stop(
            (stops[0]["at"] - began) * 1e3 if stops and not case.is_silent else None,
            (stands_s - began) * 1e3 if stands_s else None,
            (reported_s - began) * 1e3 if reported_s else None,
            (time.monotonic() - over) * 1e3,
            reason,
        )

    def _set_off(self, moves: str) -> None:
        builder = ProgramBuilder("stop me")
        if moves == "arms":
            with builder.repeat(100):
                builder.mhand_posture("both", "ready").mhand_posture("both", "tuck")
        else:
            builder.mbase_velocity(*CIRCLE, 600.0)
        agent = self.robot.agent
        agent.load(dumps(builder.program()))
        agent.run()
        eventually(lambda: self._moves(moves), PATIENCE_S, f"{moves} that move")

    def _moves(self, moves: str) -> bool:
        actor = self.robot.agent.state().actor
        if moves == "arms":
            return bool(abs(actor.joint_velocities).max() > ARM_SPEED_RAD_S)
        return math.hypot(*actor.velocity[:2]) > FULL_SPEED_M_S

    def _reported(self) -> tuple[float, str]:
        def stop_reason() -> str:
            state = self.robot.agent.state()
            return state.reason if state.condition is AgentCondition.STOPPED else ""

        reason = eventually(stop_reason, PATIENCE_S, "that the agent reports the stop")
        return time.monotonic(), str(reason)

    @staticmethod
    def _stands(looks: list[list[float]], moves: str) -> float | None:
        """The time of the first observation after the last movement; None if there is none."""
        last = looks[-1] if looks else []
        for earlier, look in zip(reversed(looks[:-1]), reversed(looks), strict=False):
            arms = zip(earlier[5:], last[5:], strict=True)
            is_moving = earlier[1] if moves == "base" else any(abs(a - b) > ARM_STANDS_RAD for a, b in arms)
            if is_moving:
                return None if look is last else look[0]
        return looks[0][0] if looks else None

    def _come_back(self) -> None:
        """Wait until the robot can run a program again."""

        def is_back() -> bool:
            try:
                state = self.robot.agent.state()
                if state.condition is AgentCondition.STOPPED:
                    self.robot.agent.reset_stop()
                elif state.condition is not AgentCondition.IDLE:
                    self.robot.agent.abort()
                return self.robot.agent.state().condition is AgentCondition.IDLE
            except (NotReachable, RobotError):
                return False

        eventually(is_back, PATIENCE_S, "that the robot is back")

    # ---- what happens ----

    def stop(self) -> float:
        began = time.monotonic()
        self.robot.agent.stop()
        return began

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
        os.kill(self.robot.process.pid, signal.SIGUSR1)
        hangs = eventually(lambda: self.robot.stops(asked), PATIENCE_S, "an adaptor that hangs")
        return float(hangs[0]["at"])

    def stop_while_it_hangs(self) -> float:
        self.hang_adaptor()
        time.sleep(0.03)  # its last command is still valid
        return self.stop()

    def wait_for_adaptor(self) -> None:
        time.sleep(HANG_S)

    def hang_process(self) -> float:
        began = time.monotonic()
        os.kill(self.robot.process.pid, signal.SIGSTOP)
        return began

    def let_process_go_on(self) -> None:
        time.sleep(PAUSE_S)
        os.kill(self.robot.process.pid, signal.SIGCONT)

    def kill_process(self) -> float:
        began = time.monotonic()
        os.kill(self.robot.process.pid, signal.SIGKILL)
        return began

    def start_process(self) -> None:
        self.robot.close()
        time.sleep(3.0)  # its lease
        self.robot = self._start()

    def kill_server(self) -> float:
        began = time.monotonic()
        os.kill(self._system.pid("simulation"), signal.SIGKILL)
        return began

    def lose_unit(self) -> float:
        began = time.monotonic()
        self._faults.lost("MnpR", True)
        return began

    def alarm(self) -> float:
        began = time.monotonic()
        self._faults.alarm("MnpR", 0x99, _GlobalIDL.FAULT, "too hot")
        return began

    def no_faults(self) -> None:
        self._faults.none()

    def pull_cable(self) -> float:
        assert self._cable
        began = time.monotonic()
        self._cable.ip("link", "set", CABLE, "down")
        return began

    def plug_cable(self) -> None:
        assert self._cable
        self._cable.ip("link", "set", CABLE, "up")

    @property
    def _faults(self) -> Any:
        assert self._naming
        return faults(self._orb, self._naming)

    # ---- all of it ----

    def cases(self) -> Iterator[Case]:
        yield Case("emergency stop over CORBA", self.stop)
        if self._naming:
            yield Case("emergency stop, arms move", self.stop, moves="arms")
        yield Case("`robocorba stop`", self.stop_by_command)
        yield Case("emergency stop, adaptor hangs", self.stop_while_it_hangs, self.wait_for_adaptor)
        yield Case("adaptor hangs", self.hang_adaptor, self.wait_for_adaptor)
        yield Case("simulation server is killed", self.kill_server)
        if self._naming:
            yield Case("a unit is lost", self.lose_unit, self.no_faults)
            yield Case("a unit has an alarm", self.alarm, self.no_faults)
        if self._cable:
            yield Case("network is cut", self.pull_cable, self.plug_cable)
        yield Case("robot process hangs", self.hang_process, self.let_process_go_on, is_silent=True, has_mark=False)
        yield Case("robot process is killed", self.kill_process, self.start_process, is_silent=True, has_mark=False)


def row(which: str, case: Case, stops: list[Stop]) -> dict[str, Any]:
    def of(values: list[float | None], share: float) -> float | None:
        known = [value for value in values if value is not None]
        return quantile(known, share) if known else None

    after = [one.stands_ms - (one.notice_ms or 0.0) if one.stands_ms is not None else None for one in stops]
    return {
        "robot": which,
        "what happens": case.what,
        "rounds": len(stops),
        "noticed after, ms": of([one.notice_ms for one in stops], 0.5),
        "stands after, ms": of([one.stands_ms for one in stops], 0.5),
        "worst": of([one.stands_ms for one in stops], 1.0),
        "after notice, ms": of(after, 0.5),
        "worst after notice": of(after, 1.0),
        "reported after, ms": of([one.reported_ms for one in stops], 0.5),
        "back after, ms": of([one.back_ms for one in stops], 0.5),
        "the agent says": stops[-1].reason[:40],
    }


def own_network() -> bool:
    """Move this process and its children into a network namespace of their own; returns whether that is allowed."""
    if ctypes.CDLL(None).unshare(CLONE_NEWNET):
        return False
    subprocess.run(("ip", "link", "set", "lo", "up"), check=True)
    return True


@contextlib.contextmanager
def own_computer() -> Iterator[tuple[Namespace, str]]:
    """A network namespace that a cable connects to ours, and its address."""
    with Namespace() as robot:
        here, there = "10.77.0.1/24", "10.77.0.2/24"
        command = ("ip", "link", "add", "toward", "type", "veth", "peer", "name", CABLE, "netns", robot.path)
        subprocess.run(command, check=True)
        subprocess.run(("ip", "address", "add", here, "dev", "toward"), check=True)
        subprocess.run(("ip", "link", "set", "toward", "up"), check=True)
        robot.ip("address", "add", there, "dev", CABLE)
        robot.ip("link", "set", CABLE, "up")
        yield robot, there.split("/")[0]


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=20, help="of each case (default: %(default)s)")
    parser.add_argument("--only", default="", metavar="WORDS", help="only cases with these words in their name")
    parser.add_argument("--robot", choices=("virtual", "actual"), help="only this one")
    options = parser.parse_args()
    has_networks = own_network()
    found: list[tuple[str, Case, list[Stop]]] = []
    with tempfile.TemporaryDirectory() as name, servers(Path(name)) as system, Orb(system.naming) as orb:
        folder = Path(name)
        for which in (options.robot,) if options.robot else ("virtual", "actual"):
            with contextlib.ExitStack() as stack:
                naming, cable = None, None
                if which == "actual":
                    host = "127.0.0.1"
                    if has_networks:
                        cable, host = stack.enter_context(own_computer())
                    naming = stack.enter_context(stand_in(folder, orb, host, cable.command() if cable else ()))
                stage = stack.enter_context(contextlib.closing(Stage(folder, orb, system, naming, cable)))
                for case in stage.cases():
                    if options.only not in case.what:
                        continue
                    rounds = max(1, options.rounds // (KILLS_SHARE if "killed" in case.what else 1))
                    with PROGRESS.status(f"{which}: {case.what}"):
                        found.append((which, case, [stage.round(case) for _ in range(rounds)]))
    rows = [row(*one) for one in found]
    marks = [
        at_most(
            f"{one['robot']}: {one['what happens']}: stands after notice, worst, ms", one["worst after notice"], MAX_MS
        )
        for one, (_, case, _) in zip(rows, found, strict=True)
        if case.has_mark and one["worst after notice"] is not None
    ]

    def draw(axes: Axes) -> None:
        labels = [f"{one['robot']}: {one['what happens']}" for one in rows]
        for number, (_, _, stops) in enumerate(found):
            stands = [one.stands_ms for one in stops if one.stands_ms is not None]
            axes.plot(stands, [number] * len(stands), "|", color="tab:blue")
            noticed = [one.notice_ms for one in stops if one.notice_ms is not None]
            axes.plot(noticed, [number] * len(noticed), ".", color="tab:orange", markersize=4)
        axes.set(xscale="symlog", xlabel="ms after it happened: noticed (dots), stationary (bars)")
        axes.set_yticks(range(len(labels)), labels, fontsize=7)
        axes.invert_yaxis()

    title = f"a robot at {SPEED_CAP:g} m/s that has to stop"
    return 0 if summarize(RESULTS / BENCH, title, rows, marks, draw) else 1


if __name__ == "__main__":
    sys.exit(main())

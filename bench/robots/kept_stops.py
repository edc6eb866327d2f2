"""Emergency stops that anything might end but a reset.

    python -m bench.robots.kept_stops --stops 200 [--only hangs]

A robot process in a running system drives in a circle by its program, and by orders 20 times a second. In each round
something happens around the time of a stop: the simulation server or the robot hangs for 0 to 8 s (SIGSTOP), is killed
and restarts, both, the adaptor is switched, or another operator resets an earlier stop. The stop is made by the command
`robocorba stop`, at the simulation server alone, or at the agent alone, and repeated until it is confirmed. From then
on the robot is ordered to drive, to run its program and to switch its adaptor, and may be killed once more.

A stop is lost if the body moves a second after the stop was confirmed and the last fault was over, or if the robot is
not STOPPED in the end. Then a reset must let the robot drive again."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench.common.harness import progress, run
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.corba.remote_database import RemoteFloor
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.processes import ROBOCORBA, Launcher, drain, eventually, forked_processes, hang
from testkit.report import at_most, quantile, summarize
from testkit.simulation import GONE, Place, simulation

NAME, FLOOR, AT = "S1", "L1", "3,5,0"
#: A circle of 0.5 m [m/s, m/s, rad/s].
CIRCLE = 0.2, 0.0, 0.4
#: Interval between orders to drive, and between observations [s].
DRIVE_S, LOOK_S = 0.05, 0.05
#: Longest hang, longest time between fault and stop, and for which the robot is observed after both [s].
HANG_S, APART_S, WATCH_S = 8.0, 1.5, 2.5
#: Time after the stop and the last fault within which a body may still move [s]: commands hold for 0.1 s.
GRACE_S = 1.0
#: Speed from which a body moves [m/s].
MOVES_M_S = 0.02
#: Timeout of calls, of the command, and of everything that has to come about at some time [s].
CALL_LIMIT_S, COMMAND_LIMIT_S, PATIENCE_S = 3.0, 10.0, 60.0
FAULTS = (
    *("none", "server hangs", "robot hangs", "both hang", "server killed", "robot killed", "both killed"),
    *("adaptor switched", "earlier stop reset"),
)
WAYS = ("command", "server", "agent")


class Outcome(NamedTuple):
    """A round. confirmed_s: until the stop was confirmed. silent: commands that printed nothing within COMMAND_LIMIT_S.
    lost: what showed that the stop was lost, or empty. reset_s: until the robot drove again, with `resets` calls."""

    fault: str
    way: str
    confirmed_s: float
    silent: int
    lost: str
    reset_s: float
    resets: int


class Stage:
    """The robot, which is started again whenever its process ends, what orders it to drive, and what observes it."""

    def __init__(self, place: Place, launch: Launcher, seed: int) -> None:
        self.place, self._launch = place, launch
        self._random = random.Random(seed)
        self._state = launch.folder / "robot"
        program = dumps(ProgramBuilder("circle").mbase_velocity(*CIRCLE, 600.0).program())
        self._program = launch.folder / "circle.json"
        self._program.write_text(program)
        self._starts = 0
        self._closing = threading.Event()
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._pid = 0
        self._is_ordering = False
        self._reset_began = 0.0
        self._looks: list[tuple[float, float]] = []
        self._floor: RemoteFloor | None = None
        self._threads = [
            Repeating("driver", self._drive, DRIVE_S),
            Repeating("witness", self._look, LOOK_S),
            Repeating("orders", self._order, 0.3),
        ]

    def start(self) -> Stage:
        self._keeper.start()
        eventually(lambda: self._pid, PATIENCE_S, "the robot")
        for thread in self._threads:
            thread.start()
        return self

    def close(self) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.close()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        self._keeper.join(PATIENCE_S)

    # ---- all the time ----

    def _keep(self) -> None:
        """Start the robot again at once, as a fleet does with --restart."""
        while not self._closing.is_set():
            self._starts += 1
            where = ("--floor", FLOOR, "--at", AT, "--channel", "main", "--program", str(self._program))
            more = ("--naming", str(self.place.running.naming), "--state", str(self._state))
            process = self._launch(ROBOCORBA, "robot", NAME, *where, *more)
            assert process.stdout is not None
            if process.stdout.readline() == "ready\n":
                drain(process)
                self._pid = process.pid
            process.wait()
            self._pid = 0

    def _drive(self) -> None:
        if self._is_ordering:
            with contextlib.suppress(RoboCorbaError):
                agent = RemoteAgent(self.place.orb, NAME, 0.3)
                while self._is_ordering:
                    with contextlib.suppress(RobotError):
                        agent.drive(CIRCLE, 0.5)
                    time.sleep(DRIVE_S)

    def _order(self) -> None:
        """Everything else that could let a robot move."""
        if self._is_ordering:
            with contextlib.suppress(RoboCorbaError):
                agent = RemoteAgent(self.place.orb, NAME, 0.3)
                order = self._random.choice([agent.run, agent.resume, lambda: agent.switch("simulated", ())])
                order()

    def _look(self) -> None:
        try:
            if self._floor is None:
                self._floor = RemoteFloor(self.place.database, FLOOR)
            self._floor.follow()
            view = self._floor.view
            (number,) = [number for number, body in view.bodies.items() if body.name == NAME]
            row = view.motion(number)
            self._looks.append((time.monotonic(), float((row["vx"] ** 2 + row["vy"] ** 2) ** 0.5)))
        except (RoboCorbaError, ValueError, KeyError):
            self._floor = None

    # ---- a round ----

    def round(self, fault: str, way: str) -> Outcome:
        self._set_off()
        begun = time.monotonic()
        happening = threading.Thread(target=self._happen, args=(fault, self._random.uniform(0.0, 2 * APART_S)))
        happening.start()
        time.sleep(self._random.uniform(0.0, 2 * APART_S))
        self._is_ordering = True
        asked = time.monotonic()
        silent = self._stop(way)
        confirmed = time.monotonic()
        happening.join()
        if self._reset_began > asked:  # then it may have ended this stop
            silent += self._stop(way)
        if self._random.random() < 0.3:
            self._happen("robot killed", 0.0)
        over = time.monotonic()
        eventually(lambda: self._condition() is not None, PATIENCE_S, "a robot that answers")
        time.sleep(WATCH_S)
        until = time.monotonic()
        quiet_from = max(over, confirmed) + GRACE_S
        speeds = [speed for at, speed in self._looks if quiet_from < at < until]
        lost = ""
        if max(speeds, default=0.0) > MOVES_M_S:
            lost = f"moves at {max(speeds):.2f} m/s"
        elif (condition := self._condition()) is not AgentCondition.STOPPED:
            lost = f"is {condition}"
        self._looks = [look for look in self._looks if look[0] > begun]
        self._is_ordering = False
        began = time.monotonic()
        resets = self._reset()
        return Outcome(fault, way, confirmed - asked, silent, lost, time.monotonic() - began, resets)

    def _set_off(self) -> None:
        self._is_ordering = True
        eventually(self._moves, PATIENCE_S, "a robot that drives")

    def _moves(self) -> bool:
        since = time.monotonic() - 0.5
        return any(at > since and speed > 5 * MOVES_M_S for at, speed in self._looks[-20:])

    def _condition(self) -> AgentCondition | None:
        with contextlib.suppress(NotReachable, RobotError):
            return RemoteAgent(self.place.orb, NAME, 0.3).state().condition
        return None

    def _reset(self) -> int:
        """Reset until the robot drives again; returns the number of calls."""
        calls = 0

        def reset() -> bool:
            nonlocal calls
            if self._condition() is not AgentCondition.STOPPED:
                return self._condition() is not None
            calls += 1
            with contextlib.suppress(NotReachable, RobotError):
                RemoteAgent(self.place.orb, NAME, 0.3).reset_stop()
            return False

        eventually(reset, PATIENCE_S, "the end of a stop")
        return calls

    # ---- stops ----

    def _stop(self, way: str) -> int:
        """Stop until that is confirmed; returns how often the command printed nothing."""
        silent = 0
        ways: dict[str, Callable[[], object]] = {"command": self._by_command, "server": self._by_server}
        stop = ways.get(way, lambda: RemoteAgent(self.place.orb, NAME, 0.5).stop())

        def is_confirmed() -> bool:
            nonlocal silent
            try:
                stop()
            except subprocess.TimeoutExpired:
                silent += 1
                return False
            except (RoboCorbaError, subprocess.CalledProcessError, *GONE):
                return False
            return True

        eventually(is_confirmed, PATIENCE_S, f"a stop by {way}")
        return silent

    def _by_command(self) -> None:
        running = self.place.running
        command = (ROBOCORBA, "stop", NAME, "--naming", str(running.naming), "--state", str(running.state))
        subprocess.run(command, check=True, capture_output=True, timeout=COMMAND_LIMIT_S)

    def _by_server(self) -> None:
        orb = self.place.orb
        server = orb.reference(orb.uri(self.place.server), RoboCorba.SimulationServer, CALL_LIMIT_S)
        server.stopRobots([NAME], "bench")

    # ---- faults ----

    def _happen(self, fault: str, pause_s: float) -> None:
        time.sleep(pause_s)
        hangs = fault.endswith(("hangs", "hang"))
        pids = []
        if fault.startswith(("server", "both")):
            pids.append(eventually(lambda: self.place.pid("simulation"), PATIENCE_S, "the server"))
        if fault.startswith(("robot", "both")):
            pids.append(eventually(lambda: self._pid, PATIENCE_S, "the robot"))
        if hangs:
            for pid in pids:
                hang(pid)
            time.sleep(self._random.uniform(0.0, HANG_S))
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT if hangs else signal.SIGKILL)
        if pids and not hangs:
            eventually(lambda: self._is_again(pids), PATIENCE_S, "processes that were killed")
        with contextlib.suppress(RoboCorbaError):
            if fault == "adaptor switched":
                RemoteAgent(self.place.orb, NAME, 0.5).switch("simulated", ())
            elif fault == "earlier stop reset":
                RemoteAgent(self.place.orb, NAME, 0.5).stop()
                self._reset_once()

    def _reset_once(self) -> None:
        time.sleep(self._random.uniform(0.0, 0.5))
        agent, self._reset_began = RemoteAgent(self.place.orb, NAME, 0.5), time.monotonic()
        agent.reset_stop()

    def _is_again(self, pids: list[int]) -> bool:
        server = self.place.pid("simulation")
        return server not in (0, *pids) and self._pid not in (0, *pids)


@contextlib.contextmanager
def stage(folder: Path, seed: int) -> Iterator[Stage]:
    with (
        forked_processes(),
        simulation(folder, sensors=1) as place,
        Launcher(folder) as launch,
        contextlib.closing(Stage(place, launch, seed).start()) as found,
    ):
        yield found


def main(stops: int = 200, seed: int = 1, only: str = "") -> bool:
    chosen = random.Random(seed)
    faults = [fault for fault in FAULTS if only in fault]
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as name, stage(Path(name), seed) as place:
        for number in progress(range(stops), "stops"):
            outcome = place.round(faults[number % len(faults)], chosen.choice(WAYS))
            outcomes.append(outcome)
            if outcome.lost or outcome.silent:
                print(f"MISSED in round {number + 1}: {outcome}", flush=True)
    rows: list[dict[str, Any]] = []
    for fault in faults:
        ours = [one for one in outcomes if one.fault == fault]
        if ours:
            rows.append(
                {
                    "around the stop": fault,
                    "stops": len(ours),
                    "lost": sum(bool(one.lost) for one in ours),
                    "confirmed after, s": quantile([one.confirmed_s for one in ours], 0.5),
                    "worst, s": max(one.confirmed_s for one in ours),
                    "silent commands": sum(one.silent for one in ours),
                    "resets, worst": max(one.resets for one in ours),
                    "drives again after, s": quantile([one.reset_s for one in ours], 0.5),
                }
            )
    ways = Counter(one.way for one in outcomes)
    title = "emergency stops during faults: " + ", ".join(f"{count} by {way}" for way, count in sorted(ways.items()))
    marks = [
        at_most("lost stops", sum(bool(one.lost) for one in outcomes), 0),
        at_most("commands that printed nothing within 10 s", sum(one.silent for one in outcomes), 0),
    ]

    def draw(axes: Axes) -> None:
        for fault in faults:
            values = sorted(one.confirmed_s for one in outcomes if one.fault == fault)
            axes.plot(values, [(index + 1) / len(values) for index in range(len(values))], label=fault)
        axes.set(xlabel="s until the stop is confirmed", ylabel="share of stops")
        axes.legend(fontsize=6)

    return summarize("kept_stops", title, rows, marks, draw)


if __name__ == "__main__":
    run(main, stops="number of rounds", seed="for what happens when", only="only faults with these words in their name")

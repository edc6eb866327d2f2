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
import random
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from bench.common.harness import folder_of_bench, progress, run
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.system.repeating import Repeating
from testkit.faults import COMMAND_LIMIT_S, PATIENCE_S, WAYS, hang_for, kill, stop_robot
from testkit.processes import ROBOCORBA, drain, eventually, forked_processes
from testkit.report import at_most, distribution, quantile, summarize
from testkit.simulation import Place, RemoteFloor, simulation

NAME, FLOOR, AT = "S1", "L1", "3,5,0"
#: A circle of 0.5 m [m/s, m/s, rad/s].
CIRCLE = 0.2, 0.0, 0.4
#: Interval between orders to drive, between observations, and between other orders [s].
DRIVE_S, LOOK_S, ORDER_S = 0.05, 0.05, 0.3
#: Longest hang, longest time between fault and stop, and for which the robot is observed after both [s].
HANG_S, APART_S, WATCH_S = 8.0, 1.5, 2.5
#: Time after the stop and the last fault within which a body may still move [s]: commands hold for 0.1 s.
GRACE_S = 1.0
#: Speed from which a body moves [m/s].
MOVES_M_S = 0.02
FAULTS = (
    *("none", "server hangs", "robot hangs", "both hang", "server killed", "robot killed", "both killed"),
    *("adaptor switched", "earlier stop reset"),
)


class Outcome(NamedTuple):
    """A round. confirmed_s: until the stop was confirmed. silent: commands that printed nothing in time. lost: what
    showed that the stop was lost, or empty. reset_s: until the robot drove again, with `resets` calls."""

    fault: str
    way: str
    confirmed_s: float
    silent: int
    lost: str
    reset_s: float
    resets: int


class Stage:
    """The robot, which is started again whenever its process ends, what orders it to drive, and what observes it."""

    def __init__(self, place: Place, folder: Path, seed: int) -> None:
        self.place, self._folder = place, folder
        self._random = random.Random(seed)
        self._program = folder / "circle.json"
        self._program.write_text(dumps(ProgramBuilder("circle").mbase_velocity(*CIRCLE, 600.0).program()))
        self._closing = threading.Event()
        self._pid = 0
        self._is_ordering = False
        self._reset_began = 0.0
        self._looks: list[tuple[float, float]] = []
        self._floor: RemoteFloor | None = None

    @contextlib.contextmanager
    def running(self) -> Iterator[Stage]:
        keeper = threading.Thread(target=self._keep, daemon=True)
        keeper.start()
        eventually(lambda: self._pid, PATIENCE_S, "the robot")
        with contextlib.ExitStack() as stack:
            for name, call, interval_s in (
                ("driver", self._drive, DRIVE_S),
                ("witness", self._look, LOOK_S),
                ("orders", self._order, ORDER_S),
            ):
                stack.enter_context(contextlib.closing(Repeating(name, call, interval_s).start()))
            yield self
        self._closing.set()
        kill(self._pid)
        keeper.join(PATIENCE_S)

    # ---- all the time ----

    def _agent(self) -> RemoteAgent:
        return RemoteAgent(self.place.orb, NAME, 0.3)

    def _keep(self) -> None:
        """Start the robot again at once, as a fleet does with --restart."""
        while not self._closing.is_set():
            where = ("--floor", FLOOR, "--at", AT, "--channel", "main", "--program", str(self._program))
            more = ("--naming", str(self.place.running.naming), "--state", str(self._folder / "robot"))
            process = self.place.launch(ROBOCORBA, "robot", NAME, *where, *more)
            assert process.stdout is not None
            if process.stdout.readline() == "ready\n":
                drain(process)
                self._pid = process.pid
            process.wait()
            self._pid = 0

    def _drive(self) -> None:
        if self._is_ordering:
            with contextlib.suppress(RoboCorbaError):
                agent = self._agent()
                while self._is_ordering:
                    with contextlib.suppress(RobotError):
                        agent.drive(CIRCLE, 0.5)
                    time.sleep(DRIVE_S)

    def _order(self) -> None:
        """Everything else that could let a robot move."""
        if self._is_ordering:
            with contextlib.suppress(RoboCorbaError):
                agent = self._agent()
                self._random.choice([agent.run, agent.resume, lambda: agent.switch("simulated", ())])()

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
        self._is_ordering = True
        eventually(lambda: self._fastest(time.monotonic() - 0.5) > 5 * MOVES_M_S, PATIENCE_S, "a robot that drives")
        begun = time.monotonic()
        happening = threading.Thread(target=self._happen, args=(fault, self._random.uniform(0.0, 2 * APART_S)))
        happening.start()
        time.sleep(self._random.uniform(0.0, 2 * APART_S))
        asked = time.monotonic()
        silent = stop_robot(self.place.running, self.place.orb, NAME, way)
        confirmed = time.monotonic()
        happening.join()
        if self._reset_began > asked:  # then it may have ended this stop
            silent += stop_robot(self.place.running, self.place.orb, NAME, way)
        if self._random.random() < 0.3:
            self._happen("robot killed", 0.0)
        over = time.monotonic()
        eventually(lambda: self._condition() is not None, PATIENCE_S, "a robot that answers")
        time.sleep(WATCH_S)
        lost = ""
        if (fastest := self._fastest(max(over, confirmed) + GRACE_S)) > MOVES_M_S:
            lost = f"moves at {fastest:.2f} m/s"
        elif (condition := self._condition()) is not AgentCondition.STOPPED:
            lost = f"is {condition}"
        self._looks = [look for look in self._looks if look[0] > begun]
        self._is_ordering = False
        began = time.monotonic()
        resets = self._reset()
        return Outcome(fault, way, confirmed - asked, silent, lost, time.monotonic() - began, resets)

    def _fastest(self, since: float) -> float:
        return max((speed for at, speed in list(self._looks) if at > since), default=0.0)

    def _condition(self) -> AgentCondition | None:
        with contextlib.suppress(NotReachable, RobotError):
            return self._agent().state().condition
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
                self._agent().reset_stop()
            return False

        eventually(reset, PATIENCE_S, "the end of a stop")
        return calls

    def _happen(self, fault: str, pause_s: float) -> None:
        time.sleep(pause_s)
        of: dict[str, Callable[[], int]] = {"server": lambda: self.place.pid("simulation"), "robot": lambda: self._pid}
        pids = [eventually(pid, PATIENCE_S, who) for who, pid in of.items() if fault.startswith((who, "both"))]
        if "hang" in fault:
            hang_for(self._random.uniform(0.0, HANG_S), *pids)
        elif pids:
            for pid in pids:
                kill(pid)
            eventually(
                lambda: not {pid() for pid in of.values()} & {0, *pids}, PATIENCE_S, "processes that were killed"
            )
        with contextlib.suppress(RoboCorbaError):
            if fault == "adaptor switched":
                self._agent().switch("simulated", ())
            elif fault == "earlier stop reset":
                self._agent().stop()
                time.sleep(self._random.uniform(0.0, 0.5))
                agent, self._reset_began = self._agent(), time.monotonic()
                agent.reset_stop()


def main(stops: int = 200, seed: int = 1, only: str = "") -> bool:
    chosen = random.Random(seed)
    faults = [fault for fault in FAULTS if only in fault]
    outcomes: dict[str, list[Outcome]] = {}
    with (
        folder_of_bench() as folder,
        forked_processes(),
        simulation(folder, sensors=1) as place,
        Stage(place, folder, seed).running() as stage,
    ):
        for number in progress(range(stops), "stops"):
            outcome = stage.round(faults[number % len(faults)], chosen.choice(WAYS))
            outcomes.setdefault(outcome.fault, []).append(outcome)
            if outcome.lost or outcome.silent:
                print(f"MISSED in round {number + 1}: {outcome}", flush=True)
    rows = [
        {
            "around the stop": fault,
            "stops": len(found),
            "lost": sum(bool(one.lost) for one in found),
            "confirmed after, s": quantile([one.confirmed_s for one in found], 0.5),
            "worst, s": max(one.confirmed_s for one in found),
            "silent commands": sum(one.silent for one in found),
            "resets, worst": max(one.resets for one in found),
            "drives again after, s": quantile([one.reset_s for one in found], 0.5),
        }
        for fault, found in outcomes.items()
    ]
    marks = [
        at_most("lost stops", sum(row["lost"] for row in rows), 0),
        at_most(
            f"commands that printed nothing within {COMMAND_LIMIT_S:g} s", sum(r["silent commands"] for r in rows), 0
        ),
    ]
    samples = {fault: [one.confirmed_s for one in found] for fault, found in outcomes.items()}
    draw = distribution(samples, "s until the stop is confirmed", "share of stops")
    return summarize("kept_stops", "emergency stops during faults", rows, marks, draw)


if __name__ == "__main__":
    run(main, stops="number of rounds", seed="for what happens when", only="only faults with these words in their name")

"""Emergency stops that anything might end but a reset.

    python -m bench.robots.kept_stops --stops 200 [--only hangs]

A robot process in a running system drives in a circle by its program. In each round something happens around the time
of a stop: the simulation server or the robot hangs for 0 to 8 s (SIGSTOP), is killed and restarts, or both. The stop is
made by the command `robocorba stop`, at the simulation server alone, or at the agent alone, and repeated until it is
confirmed. All the time the robot is ordered to drive, to run and resume its program and to switch its adaptor.

A stop is lost if the body moves a second after the stop was confirmed and the fault was over, or if the robot is not
STOPPED in the end. Then a reset must let the robot drive again."""

from __future__ import annotations

import contextlib
import random
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from bench.common.harness import System, progress, run, sampled, system
from bench.robots.watcher import body_of
from robocorba.errors.base import RoboCorbaError
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.faults import COMMAND_LIMIT_S, PATIENCE_S, WAYS, hang_for, kill, stop_robot
from testkit.processes import ROBOCORBA, drain, eventually
from testkit.report import at_most, quantile, summarize

#: Timeout for a robot to start [s].
START_LIMIT_S = 300.0
NAME, FLOOR, AT = "S1", "L1", "3,5,0"
#: A circle of 0.5 m [m/s, m/s, rad/s].
CIRCLE = 0.2, 0.0, 0.4
#: Intervals between orders and between observations [s].
ORDER_S, LOOK_S = 0.2, 0.05
#: Longest hang, longest time between fault and stop, and for which the robot is observed after both [s].
HANG_S, APART_S, WATCH_S = 8.0, 3.0, 2.5
#: Time after the stop and the fault within which a body may still move [s]: commands hold for 0.1 s.
GRACE_S = 1.0
FAULTS = ("none", "server hangs", "robot hangs", "both hang", "server killed", "robot killed", "both killed")


class Outcome(NamedTuple):
    """A round. confirmed_s: until the stop was confirmed. silent: commands that printed nothing in time. lost: what
    showed that the stop was lost, or empty."""

    fault: str
    confirmed_s: float
    silent: int
    lost: str


class Stage:
    """The robot, which is started again after its process was killed, and what orders it to drive."""

    def __init__(self, place: System, seed: int) -> None:
        self._place, self._random = place, random.Random(seed)
        self._program = place.folder / "circle.json"
        self._program.write_text(dumps(ProgramBuilder("circle").mbase_velocity(*CIRCLE, 600.0).program()))
        self._look = body_of(place.orb, FLOOR, NAME)
        self._pid, self._closing = 0, threading.Event()
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._keeper.start()
        eventually(lambda: self._pid, START_LIMIT_S, "the robot")

    def close(self) -> None:
        self._closing.set()
        kill(self._pid)
        self._keeper.join(PATIENCE_S)

    def _keep(self) -> None:
        """Start the robot again whenever its process ends, as a fleet does with --restart."""
        where = ("--floor", FLOOR, "--at", AT, "--channel", "main", "--program", str(self._program))
        more = ("--naming", str(self._place.orb.naming), "--state", str(self._place.folder / "robot"))
        while not self._closing.is_set():
            process = self._place.launch(ROBOCORBA, "robot", NAME, *where, *more)
            assert process.stdout is not None
            if process.stdout.readline() == "ready\n":
                drain(process)
                self._pid = process.pid
            process.wait()
            self._pid = 0

    def _agent(self) -> RemoteAgent:
        return RemoteAgent(self._place.orb, NAME, 0.3)

    def _order(self) -> None:
        with contextlib.suppress(RoboCorbaError):
            agent = self._agent()
            orders = (
                partial(agent.drive, CIRCLE, 0.5),
                agent.run,
                agent.resume,
                partial(agent.switch, "simulated", ()),
            )
            self._random.choice(orders)()

    def _is_moving(self) -> bool:
        with contextlib.suppress(RoboCorbaError, ValueError, KeyError):
            return bool(self._look()[0])
        return False

    def _condition(self) -> AgentCondition | None:
        with contextlib.suppress(RoboCorbaError):
            return self._agent().state().condition
        return None

    def round(self, fault: str, way: str) -> Outcome:
        with sampled(self._order, ORDER_S), sampled(self._is_moving, LOOK_S) as looks:
            eventually(lambda: any(is_moving for _, is_moving in looks[-5:]), PATIENCE_S, "a robot that drives")
            happening = threading.Thread(target=self._happen, args=(fault, self._random.uniform(0.0, APART_S)))
            happening.start()
            time.sleep(self._random.uniform(0.0, APART_S))
            asked = time.monotonic()
            silent = stop_robot(self._place.running, self._place.orb, NAME, way)
            confirmed = time.monotonic()
            happening.join()
            over = time.monotonic()
            eventually(lambda: self._condition() is not None, PATIENCE_S, "a robot that answers")
            time.sleep(WATCH_S)
            condition = self._condition()
            lost = "moves" if any(is_moving for at, is_moving in looks if at > over + GRACE_S) else ""
            if condition is not AgentCondition.STOPPED:
                lost = f"is {condition}"
        eventually(self._is_reset, PATIENCE_S, "the end of a stop")
        return Outcome(fault, confirmed - asked, silent, lost)

    def _is_reset(self) -> bool:
        with contextlib.suppress(RoboCorbaError):
            self._agent().reset_stop()
        return self._condition() not in (AgentCondition.STOPPED, None)

    def _happen(self, fault: str, pause_s: float) -> None:
        time.sleep(pause_s)
        server = partial(self._place.running.pid, "simulation")
        of: dict[str, Callable[[], int]] = {"server": server, "robot": lambda: self._pid}
        pids = [eventually(pid, PATIENCE_S, who) for who, pid in of.items() if fault.startswith((who, "both"))]
        if "hang" in fault:
            hang_for(self._random.uniform(0.0, HANG_S), *pids)
            return
        for pid in pids:
            kill(pid)
        eventually(lambda: not {pid() for pid in of.values()} & {0, *pids}, START_LIMIT_S, "processes that were killed")


def main(stops: int = 200, seed: int = 1, only: str = "") -> bool:
    chosen = random.Random(seed)
    faults = [fault for fault in FAULTS if only in fault]
    outcomes: dict[str, list[Outcome]] = {}
    with system() as place, contextlib.closing(Stage(place, seed)) as stage:
        for number in progress(range(stops), "stops"):
            outcome = stage.round(faults[number % len(faults)], chosen.choice(WAYS))
            outcomes.setdefault(outcome.fault, []).append(outcome)
            if outcome.lost or outcome.silent:
                print(f"MISSED in round {number + 1}: {outcome}", flush=True)
    samples = {fault: [one.confirmed_s for one in found] for fault, found in outcomes.items()}
    rows = [
        {
            "around the stop": fault,
            "stops": len(found),
            "lost": sum(bool(one.lost) for one in found),
            "confirmed after, s": quantile(samples[fault], 0.5),
            "worst, s": max(samples[fault]),
            "silent": sum(one.silent for one in found),
        }
        for fault, found in outcomes.items()
    ]
    marks = [
        at_most("lost stops", sum(row["lost"] for row in rows), 0),
        at_most(f"commands that printed nothing within {COMMAND_LIMIT_S:g} s", sum(row["silent"] for row in rows), 0),
    ]
    return summarize("kept_stops", "emergency stops during faults", rows, marks, samples, "s")


if __name__ == "__main__":
    run(main, stops="number of rounds", seed="for what happens when", only="only faults with these words in their name")

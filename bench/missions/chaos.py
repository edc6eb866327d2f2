"""Missions with one random fault each.

    python -m bench.missions.chaos --missions 20

Three robots of two sub-networks carry a table to and fro. In each mission a robot is killed, hangs or has an emergency
stop, a channel is killed, or a robot blocks the goal. Every mission must end within its deadline: done, or with a
reason that names the fault. Afterwards no robot moves or holds anything, and the next mission must reach its own fault.
The last mission has no fault and must be done."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from omniORB import CORBA

from bench import RESULTS
from robocorba.control.agent import AgentCondition
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.missions.subplan import Carry
from robocorba.stubs import RoboCorba
from robocorba.testing.missions import FLOOR, MissionSystem, Start, missions, save_three_rooms
from robocorba.testing.processes import eventually
from robocorba.testing.report import PROGRESS, at_most, quantile, summarize

NAME = "mission_chaos"
TABLE, GOALS = "table", ((3.8, 2.6), (2.2, 2.6))
#: Start poses of robots, far from both ends of the table's path.
STARTS = (
    Start(0.5, 0.5, 0.0, "lab"),
    Start(5.4, 4.5, math.pi, "lab"),
    Start(7.0, 2.6, math.pi, "hall"),
    Start(8.5, 1.0, math.pi, "hall"),
    Start(8.5, 4.0, math.pi, "hall"),
)
PHASES = ("gathering", "gripping", "carrying", "putting down")
#: Time limit from the fault to the end of a mission [s]: members time out after 4 s and have 25 s for a safe end.
DEADLINE_S = 45.0
#: The same if the goal is blocked [s]: the carry's limit is three times its duration plus 20 s.
BLOCKED_DEADLINE_S = 100.0
#: Duration of a hang [s], longer than every timeout of a mission's messages.
HANG_S = 8.0
PARKED_M = 0.3


class Outcome(NamedTuple):
    """The outcome of a mission. end_s: time from the fault to the end. wrong: errors found."""

    fault: str
    result: str
    reason: str
    end_s: float
    wrong: tuple[str, ...]


class Chaos:
    """Successive missions in one system."""

    def __init__(self, place: MissionSystem, seed: int) -> None:
        self.place, self._random = place, random.Random(seed)
        self._count = 0
        self._parked: Any = None
        self._crew: dict[str, Start] = {}
        self._restore()

    def names(self) -> list[str]:
        """The names of the faults."""
        return [
            "helper killed before it accepts",
            *(f"helper killed while {phase}" for phase in PHASES),
            *(f"leader killed while {phase}" for phase in ("gathering", "carrying")),
            "helper hangs while carrying",
            "helper stopped while carrying",
            "leader stopped while carrying",
            "leader's channel killed while carrying",
            "helper's channel killed while carrying",
            "somebody stands in the way",
        ]

    def mission(self, fault: str) -> Outcome:
        """Run a mission with a fault, or without one if it is empty."""
        wrong: list[str] = []
        self._restore()
        lab = [name for name, at in self._crew.items() if at.channel == "lab"]
        leader = self._random.choice(lab)
        others = [name for name in self._crew if name != leader]
        user = self._carry(leader)
        names = "somebody"
        try:
            names = self._cause(fault, leader, others, user) if fault else ""
        except AssertionError as late:
            wrong.append(f"did not reach its fault: {str(late)[:300]}")
        began = time.monotonic()
        limit_s = BLOCKED_DEADLINE_S if "way" in fault or not fault else DEADLINE_S
        try:
            out, err = user.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            wrong.append(f"did not end within {limit_s:g} s")
            user.kill()
            out, err = user.communicate()
        end_s = time.monotonic() - began
        last = (err or out).strip().splitlines()[-1]
        result, _, rest = last.partition("\t")
        reason = rest.partition("\t")[2] or ("" if result == "done" else last)
        if "Traceback" in err:
            wrong.append(f"the user sees {err[-200:]}")
        if result != "done" and fault and not re.search(names, reason or last):
            wrong.append(f"the reason does not match {names}: {reason!r}")
        if not fault and result != "done":
            wrong.append(f"without a fault: {reason}")
        wrong += self._aftermath()
        return Outcome(fault or "none", result if result == "done" else "ended", reason, end_s, tuple(wrong))

    # ---- faults: each waits for its phase and returns the pattern that the reason must match ----

    def _cause(self, fault: str, leader: str, others: Sequence[str], user: subprocess.Popen[str]) -> str:
        helper = self._random.choice(others)
        phase = fault.rpartition(" while ")[2]
        if fault.startswith("helper killed before"):
            self._kill(helper)
            return rf"\b{helper}\b|helpers are needed"
        if fault == "somebody stands in the way":
            return self._park(leader, user)
        self._await(phase, leader, user)
        if fault.startswith("helper killed"):
            self._kill(helper)
            return rf"\b{helper}\b"
        if fault.startswith("leader killed"):
            self._kill(leader)
            return f"{leader}|not reachable|not answer"
        if fault.startswith("helper hangs"):
            process = self.place.robots[helper]
            os.kill(process.pid, signal.SIGSTOP)
            time.sleep(HANG_S)
            os.kill(process.pid, signal.SIGCONT)
            return rf"\b{helper}\b"
        if "stopped" in fault:
            stopped = helper if fault.startswith("helper") else leader
            self.place.agent(stopped).stop()
            return rf"\b{stopped}\b|emergency stop"
        channel = self._crew[leader].channel if fault.startswith("leader") else self._crew[helper].channel
        self.place.kill_server(f"events_{channel}")
        return "silent|has left|channel|not answer"

    def _await(self, phase: str, leader: str, user: subprocess.Popen[str]) -> None:
        if phase == "carrying":
            self.place.carrying(leader, TABLE, user, self._random.uniform(0.02, 0.8))
            return
        self.place.at_phase(leader, phase, user)
        time.sleep(self._random.uniform(0.0, 0.5))

    def _kill(self, name: str) -> None:
        self.place.robots.pop(name).kill()
        self._crew.pop(name)

    def _park(self, leader: str, user: subprocess.Popen[str]) -> str:
        """Register a foreign robot at a carrier's place at the goal."""
        self.place.at_phase(leader, "gripping", user)
        kept = self.place.kept(leader)
        assert kept is not None
        limits = RoboCorba.MotionLimits(1.0, 2.0, 2.0, 4.0)
        for subplan in kept.plan.subplans:  # one of the places at the goal is free, unless the path is short
            carry = next(step for step in subplan.steps if isinstance(step, Carry))
            (x, y, heading), (ahead, left, _) = carry.rows[-1][1:4], carry.place
            c, s = math.cos(heading), math.sin(heading)
            at = RoboCorba.Pose(FLOOR, x + c * ahead - s * left, y + s * ahead + c * left, 0.0)
            with contextlib.suppress(RoboCorba.PlaceTaken):
                about = RoboCorba.RobotDescription("parked", at, PARKED_M, 500.0, limits)
                self._parked = self.place.server.registerRobot(about)
                break
        assert self._parked is not None, "no room at the goal for a robot that blocks it"
        deadline = time.monotonic() + 15.0
        while user.poll() is None and time.monotonic() < deadline:  # keep its lease
            self._parked.command(RoboCorba.Velocity(0.0, 0.0, 0.0), 0.5)
            time.sleep(0.2)
        return ""

    # ---- before and after ----

    def _goal(self) -> tuple[float, float]:
        at = self.place.body(TABLE)
        return max(GOALS, key=lambda goal: math.dist(goal, at[:2]))

    def _carry(self, leader: str) -> subprocess.Popen[str]:
        x, y = self._goal()
        return self.place.mission(leader, TABLE, f"{FLOOR}:{x},{y}")

    def _restore(self) -> None:
        """Start robots until there are three, one of them in the other sub-network."""
        while len(self._crew) < 3:
            channel = "hall" if all(at.channel != "hall" for at in self._crew.values()) else "lab"
            _, bodies = self.place.bodies()
            there = [at for name, at in bodies.items()]
            start = max(STARTS, key=lambda at: min((math.dist((at.x, at.y), one[:2]) for one in there), default=9.0))
            self._count += 1
            name = f"r{self._count}"
            self._crew[name] = start._replace(channel=channel)
            self.place.start({name: self._crew[name]})

    def _aftermath(self) -> list[str]:
        """Errors in the state of robots and table after the mission."""
        wrong: list[str] = []
        if self._parked is not None:
            with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):  # its lease is over
                self._parked.deregister()
            self._parked = None
        names = list(self._crew)
        for name in names:
            with contextlib.suppress(RoboCorbaError):
                agent = self.place.agent(name)
                if agent.state().condition is AgentCondition.STOPPED and not _soon(partial(_reset, agent), 15.0):
                    wrong.append(f"the emergency stop of {name} cannot be reset")
        if not _soon(lambda: all(map(self.place.is_free, names)), 40.0):
            wrong.append(f"not free: {[name for name in names if not self.place.is_free(name)]}")
        if not _soon(lambda: self.place.names() == set(names), 10.0):
            wrong.append(f"logged on: {self.place.names()}, expected: {names}")
        if held := self.place.holding():
            wrong.append(f"still held: {held}")
        if not self.place.is_stationary((*names, TABLE)):
            wrong.append("something moves")
        if not 0.4 < self.place.body(TABLE).x < 5.6:
            wrong.append(f"the table is at {self.place.body(TABLE)}")
        return wrong


def _reset(agent: RemoteAgent) -> bool:
    try:
        agent.reset_stop()
    except NotReachable:
        raise
    except RoboCorbaError:
        return agent.state().condition is not AgentCondition.STOPPED
    return True


def _soon(is_so: Callable[[], bool], limit_s: float) -> bool:
    try:
        eventually(is_so, limit_s)
    except AssertionError:
        return False
    return True


def row(fault: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    ends = [one.end_s for one in outcomes]
    return {
        "fault": fault,
        "missions": len(outcomes),
        "done": sum(one.result == "done" for one in outcomes),
        "ended safely": sum(one.result != "done" and not one.wrong for one in outcomes),
        "wrong": sum(bool(one.wrong) for one in outcomes),
        "s to the end": quantile(ends, 0.5),
        "most": max(ends),
    }


def main() -> int:
    """Exit code: 0 if every mission ended correctly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=20, help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="seed of faults and times (default: %(default)s)")
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        with missions(folder, save_three_rooms(folder)) as place:
            chaos = Chaos(place, options.seed)
            order = random.Random(options.seed)
            faults: list[str] = []
            while len(faults) < options.missions:
                faults += order.sample(chaos.names(), len(chaos.names()))
            for number, fault in enumerate([*faults[: options.missions], ""], 1):
                with PROGRESS.status(f"mission {number} of {options.missions + 1}: {fault or 'without a fault'}"):
                    outcomes.append(chaos.mission(fault))
                one = outcomes[-1]
                print(f"{number}\t{one.fault}\t{one.result}\t{one.end_s:.1f} s\t{one.reason}\t{one.wrong}", flush=True)
    by_fault = {fault: [one for one in outcomes if one.fault == fault] for fault in sorted({o.fault for o in outcomes})}
    marks = [at_most("missions with errors", sum(bool(one.wrong) for one in outcomes), 0)]
    title = f"{options.missions} missions of three robots, with a fault each, and one without"
    rows = [row(fault, those) for fault, those in by_fault.items()]
    return 0 if summarize(RESULTS / NAME, title, rows, marks, lambda axes: _draw(axes, outcomes)) else 1


def _draw(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    for fault in sorted({one.fault for one in outcomes}):
        ends = [one.end_s for one in outcomes if one.fault == fault]
        axes.plot(ends, [fault] * len(ends), "o")
    axes.set(xlabel="s from the fault to the end")


if __name__ == "__main__":
    sys.exit(main())

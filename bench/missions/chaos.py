"""Missions with one random fault each.

    python -m bench.missions.chaos --missions 20 [--only FAULT]

Three of five robots of two sub-networks carry a table to and fro. In each mission a robot is killed, hangs or has an
emergency stop, a channel or a server is killed, or a robot blocks the goal. Every mission must end within its deadline.
After a kill or a hang it must be done: another robot takes the place of the one that is gone, or leads on. After an
emergency stop, and where the goal is blocked, it may also end with a reason that names the fault. Afterwards no robot
moves or holds anything, and the next mission must reach its own fault. The last mission has no fault."""

from __future__ import annotations

import contextlib
import math
import os
import random
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from omniORB import CORBA

from bench.common.harness import progress, run
from bench.missions.crew import Crew
from robocorba.missions.subplan import Carry
from robocorba.stubs import RoboCorba
from testkit.missions import FLOOR, MissionSystem, RobotStart, save_three_rooms
from testkit.missions import missions as mission_system
from testkit.report import at_least, at_most, quantile, summarize

TABLE, GOALS = "table", ((3.8, 2.6), (2.2, 2.6))
#: Start poses of robots, far from both ends of the table's path, and not before the door.
STARTS = (
    RobotStart(0.5, 0.5, 0.0, "lab"),
    RobotStart(5.4, 4.5, math.pi, "lab"),
    RobotStart(9.4, 2.6, math.pi, "hall"),
    RobotStart(8.5, 1.0, math.pi, "hall"),
    RobotStart(8.5, 4.0, math.pi, "hall"),
)
FAULTS = (
    "helper killed before it accepts",
    *(f"helper killed while {phase}" for phase in ("gathering", "gripping", "carrying", "putting down")),
    *(f"leader killed while {phase}" for phase in ("gathering", "carrying")),
    "helper hangs while carrying",
    "leader hangs while carrying",
    *(f"leader killed while {phase}" for phase in ("asking", "gripping", "putting down")),
    *(f"{server} killed while carrying" for server in ("simulation", "map_editor", "omniNames")),
    "helper stopped while carrying",
    "leader stopped while carrying",
    "leader's channel killed while carrying",
    "helper's channel killed while carrying",
    "somebody stands in the way",
)
#: Time limit from the fault to the end of a mission [s]: members time out after 4 s, have 25 s for a safe end, find
#: others within 60 s, and begin again.
DEADLINE_S = 180.0
#: The same if the goal is blocked [s]: the carry's limit is three times its duration plus 20 s, at each attempt.
BLOCKED_DEADLINE_S = 600.0
#: Largest distance of the table from its goal [m].
NEAR_M = 0.01
#: Least share of the missions that survive a kill or a hang.
SURVIVING = 0.95
#: Servers that are killed; their names begin these faults.
SERVERS = ("simulation", "map_editor", "omniNames")
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

    @property
    def is_survivable(self) -> bool:
        """Whether the mission must be done all the same."""
        return "stop" not in self.fault and "way" not in self.fault


class Chaos:
    """Successive missions in one system."""

    def __init__(self, place: MissionSystem, seed: int) -> None:
        self.place, self._random = place, random.Random(seed)
        self._parked: Any = None
        self._crew = Crew(place, STARTS, TABLE)

    def mission(self, fault: str) -> Outcome:
        """Run a mission with a fault, or without one if it is empty."""
        wrong: list[str] = []
        self._crew.restore()
        leader = self._random.choice([name for name, at in self._crew.members.items() if at.channel == "lab"])
        table = self.place.body(TABLE)
        x, y = max(GOALS, key=lambda goal: math.dist(goal, table[:2]))
        user = self.place.mission(leader, TABLE, f"{FLOOR}:{x},{y}")
        names = "somebody"
        try:
            names = self._cause(fault, leader, user) if fault else ""
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
        off_m = math.dist(self.place.body(TABLE)[:2], (x, y))
        if result == "done" and off_m > NEAR_M:
            wrong.append(f"the table is {1000 * off_m:.0f} mm from its goal")
        reason = rest.partition("\t")[2] or ("" if result == "done" else last)
        if "Traceback" in err:
            wrong.append(f"the user sees {err[-200:]}")
        if result != "done" and not fault:
            wrong.append(f"without a fault: {reason}")
        elif result != "done" and not re.search(names, reason or last):
            wrong.append(f"the reason does not match {names}: {reason!r}")
        wrong += self._aftermath()
        return Outcome(fault or "none", result if result == "done" else "ended", reason, end_s, tuple(wrong))

    # ---- faults ----

    def _cause(self, fault: str, leader: str, user: subprocess.Popen[str]) -> str:
        """Wait for the phase of a fault and cause it; returns the pattern that the reason must match."""
        what, _, phase = fault.partition(" while ")
        if phase == "asking":
            time.sleep(self._random.uniform(0.0, 1.5))
        elif phase == "carrying":
            self.place.carrying(leader, TABLE, user, self._random.uniform(0.02, 0.8))
        elif phase:
            self.place.at_phase(leader, phase, user)
            time.sleep(self._random.uniform(0.0, 0.5))
        if what == "somebody stands in the way":
            self._park(leader, user)
            return ""
        if what.split()[0] in SERVERS:
            self.place.kill_server(what.split()[0])
            return "."
        kept = self.place.kept(leader)
        members = [subplan.robot for subplan in kept.plan.subplans] if kept and phase else list(self._crew.members)
        helper = self._random.choice([name for name in members if name != leader])
        victim = leader if fault.startswith("leader") else helper
        if "channel" in what:
            self.place.kill_server(f"events_{self._crew.members[victim].channel}")
            return "silent|has left|channel|not answer"
        if "killed" in what:
            self._crew.kill(victim)
            if victim == leader:
                return f"{leader}|not reachable|not answer"
            return rf"\b{helper}\b" if phase else rf"\b{helper}\b|helpers are needed"
        if "hangs" in what:
            pid = self.place.robots[victim].pid
            os.kill(pid, signal.SIGSTOP)
            time.sleep(HANG_S)
            os.kill(pid, signal.SIGCONT)
            return rf"\b{victim}\b"
        self.place.agent(victim).stop()
        return rf"\b{victim}\b|emergency stop"

    def _park(self, leader: str, user: subprocess.Popen[str]) -> None:
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

    def _aftermath(self) -> list[str]:
        """Errors in the state of robots and table after the mission."""
        if self._parked is not None:
            with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):  # its lease is over
                self._parked.deregister()
            self._parked = None
        wrong = self._crew.aftermath()
        if not 0.4 < self.place.body(TABLE).x < 5.6:
            wrong.append(f"the table is at {self.place.body(TABLE)}")
        return wrong


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


def main(missions: int = 20, seed: int = 1, only: str = "") -> bool:
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder, mission_system(Path(folder), save_three_rooms(Path(folder))) as place:
        chaos, order = Chaos(place, seed), random.Random(seed)
        faults: list[str] = []
        while len(faults) < missions:
            faults += [only] if only else order.sample(FAULTS, len(FAULTS))
        for fault in progress([*faults[:missions], ""], "missions"):
            one = chaos.mission(fault)
            outcomes.append(one)
            print(
                f"{len(outcomes)}\t{one.fault}\t{one.result}\t{one.end_s:.1f} s\t{one.reason}\t{one.wrong}", flush=True
            )
    by_fault = {fault: [one for one in outcomes if one.fault == fault] for fault in sorted({o.fault for o in outcomes})}
    survivable = [one for one in outcomes if one.is_survivable]
    done = sum(one.result == "done" for one in survivable)
    marks = [
        at_most("missions with errors", sum(bool(one.wrong) for one in outcomes), 0),
        at_least("share of the missions that survive a kill or a hang", done / max(1, len(survivable)), SURVIVING),
    ]
    title = f"{missions} missions of three of {len(STARTS)} robots, with a fault each, and one without"

    def draw(axes: Axes) -> None:
        axes.plot([one.end_s for one in outcomes], [one.fault for one in outcomes], "o")
        axes.set(xlabel="s from the fault to the end")

    return summarize("mission_chaos", title, [row(*each) for each in by_fault.items()], marks, draw)


if __name__ == "__main__":
    run(main, seed="of faults and times", only="this fault only")

"""Lateness of a robot's 50 Hz control loop while another process keeps a core busy.

    python -m bench.robots.control [--seconds 20]

A real robot process runs a program in a real system: the base drives, arms and lumbar move; first the virtual robot,
then the actual robot's stand-in. A process keeps the last core busy. All other processes may run on all cores, as for
a user."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.harness import run
from bench.robots.recorded_robot import RecordedRobot, system_on_two_floors
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.orb.orb import Orb
from robocorba.robot.high_controller import SPEED_CAP, TICK_S
from robocorba.robot.kinematics.smartpal import (
    BASE_LIMITS,
    JOINT_ACCELERATION,
    JOINT_LOWER,
    JOINT_SPEED,
    JOINT_UPPER,
    JOINTS,
)
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import Program, dumps
from testkit.actual_robot import running_stand_in
from testkit.json_process import busy_process
from testkit.report import PROGRESS, at_most, summarize, summary

MAX_P99_MS = 5.0
#: Time between the program's start and the first measured tick [s].
WARM_UP_S = 3.0
#: Tolerance of limits, for rounding.
SLACK = 1e-6


def program() -> Program:
    """A program of some minutes."""
    builder = ProgramBuilder("work")
    with builder.repeat(100):
        builder.mhand_posture("both", "ready").mbase_by(ahead=1.0, turn=0.8).lumbar(-0.1, 0.3).mbase_by(ahead=-1.0)
        builder.mhand_posture("both", "tuck").mbase_by(left=0.5, turn=-0.8).lumbar(0.0, 0.0).mbase_by(left=-0.5)
    return builder.program()


def lateness_s(begun: Floats) -> tuple[Floats, int]:
    """Lateness of ticks that began at these times [s], and the number of missed ticks.

    As in the controller, ticks are due every TICK_S; after a tick that is later than that, the schedule restarts. The
    due time of the first tick is unknown: the earliest tick of a schedule counts as on time."""
    grids: list[list[float]] = [[]]
    due = missed = 0
    offset = float(begun[0])
    for at in begun.tolist():
        ahead = at - (offset + due * TICK_S)
        if ahead > TICK_S:
            missed += int(ahead / TICK_S)
            offset, due, ahead = at, 0, 0.0
            grids.append([])
        grids[-1].append(ahead)
        due += 1
    return np.concatenate([np.array(grid) - min(grid) for grid in grids if grid]), missed


def broken_limits(ticks: Floats) -> dict[str, int]:
    """Numbers of commands beyond each limit, by its name."""
    time_s, heading, base = ticks[:, 4], ticks[:, 5], ticks[:, 6:9]
    joints, speeds = ticks[:, 9 : 9 + len(JOINTS)], ticks[:, 9 + len(JOINTS) :]
    c, s = np.cos(heading), np.sin(heading)
    velocity = np.column_stack((c * base[:, 0] - s * base[:, 1], s * base[:, 0] + c * base[:, 1]))
    passed = np.maximum(np.diff(time_s), TICK_S)[:, np.newaxis]
    more = 1.0 + SLACK
    found = {
        "base: speed": np.hypot(base[:, 0], base[:, 1]) > SPEED_CAP * more,
        "base: turn": np.abs(base[:, 2]) > BASE_LIMITS.turn_speed * more,
        "base: acceleration": np.hypot(*np.diff(velocity, axis=0).T) > BASE_LIMITS.acceleration * TICK_S * more,
        "base: turn acceleration": np.abs(np.diff(base[:, 2])) > BASE_LIMITS.turn_acceleration * TICK_S * more,
        "joints: position": (joints < JOINT_LOWER - SLACK) | (joints > JOINT_UPPER + SLACK),
        "joints: speed": np.abs(speeds) > JOINT_SPEED * more,
        "joints: acceleration": np.abs(np.diff(speeds, axis=0)) > JOINT_ACCELERATION * passed * more + SLACK,
        "joints: leaps": np.abs(np.diff(joints, axis=0)) > JOINT_SPEED * passed * more + SLACK,
    }
    return {name: int(np.count_nonzero(is_beyond)) for name, is_beyond in found.items()}


def measure(folder: Path, orb: Orb, seconds: float, adaptor: Sequence[str]) -> Floats:
    """All ticks of some seconds of the program."""
    with contextlib.closing(RecordedRobot(folder, orb, "4,3,0", adaptor)) as robot:
        robot.agent.load(dumps(program()))
        robot.agent.run()
        time.sleep(WARM_UP_S)
        began = time.monotonic()
        time.sleep(seconds)
        ended = time.monotonic()
        if (state := robot.agent.state()).program.reason:
            sys.exit(f"control: the program ended: {state.program.reason}")
        robot.agent.abort()
        time.sleep(0.5)
    ticks = robot.ticks()
    return ticks[(ticks[:, 0] >= began) & (ticks[:, 0] < ended)]


def row(which: str, ticks: Floats, seconds: float) -> tuple[dict[str, Any], list[float]]:
    late_s, missed = lateness_s(ticks[:, 0])
    late_ms = (late_s * 1e3).tolist()
    work_ms = ((ticks[:, 3] - ticks[:, 0]) * 1e3).tolist()
    found = {
        "robot": which,
        "ticks": len(ticks),
        "due": round(seconds / TICK_S),
        "missed": missed,
        **summary(late_ms, "late p50, ms", "p99", "worst"),
        **summary(work_ms, "a tick's work p50, ms", "work p99, ms"),
        "beyond limits": sum(broken_limits(ticks).values()),
    }
    return found, late_ms


def main(seconds: float = 20.0) -> bool:
    busy = max(os.sched_getaffinity(0))
    rows, late = [], {}
    with system_on_two_floors() as (folder, _, _, orb), contextlib.ExitStack() as stack:
        stack.enter_context(busy_process(folder, [busy]))
        for which in ("virtual", "actual"):
            with PROGRESS.status(f"{which}: {seconds:g} s"):
                adaptor: tuple[str, ...] = ()
                if which == "actual":
                    robot = stack.enter_context(running_stand_in(folder / "robot", orb=orb))
                    adaptor = ("smartpal", "--naming", str(robot.naming))
                ticks = measure(folder / which, orb, seconds, adaptor)
            found, late[which] = row(which, ticks, seconds)
            rows.append(found)
            for limit, count in broken_limits(ticks).items():
                if count:
                    print(f"{which}: {count} commands exceed the limit of {limit}")
    marks = [
        at_most(f"{one['robot']}: {what}", one[column], limit)
        for one in rows
        for what, column, limit in (
            ("late, p99, ms", "p99", MAX_P99_MS),
            ("ticks missed", "missed", 0),
            ("commands beyond a limit", "beyond limits", 0),
        )
    ]
    title = f"control loop at {1 / TICK_S:g} Hz, {seconds:g} s, core {busy} kept busy"
    return summarize("control", title, rows, marks, late, "late, ms")


if __name__ == "__main__":
    run(main, seconds="for each of the two robots")

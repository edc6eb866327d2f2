"""Deviation between a virtual and an actual robot that have run the same program.

    python -m bench.robots.virtual_and_actual --runs 3

The sample program both-floors runs in the sample building five-floors. Each run has its own servers, so that the
elevator starts on the same floor, and each actual run its own stand-in with another noise seed. It stands in a world of
one floor, the upper one, whose wall its sensor has to see."""

from __future__ import annotations

import contextlib
import math
from importlib.resources import files
from pathlib import Path

from bench.common.harness import folder_of_bench, progress, run
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentState, ProgramResult
from robocorba.robot.kinematics.body import SmartPalBody
from testkit.actual_robot import running_stand_in
from testkit.processes import running_system
from testkit.report import at_most, summarize
from testkit.virtual_and_actual import BASE_M, HAND_M, TURNED_RAD, difference, robot_process

ROBOT = "A"
SAMPLES = Path(str(files("robocorba") / "samples"))
BUILDING, PROGRAM = SAMPLES / "five-floors.yaml", SAMPLES / "both-floors.json"
WHERE = ("--floor", "L1", "--at", "17,9.25,1.57", "--channel", "main")
#: Largest differences at the end.
LIMITS = {"base, m": BASE_M, "turned, deg": math.degrees(TURNED_RAD), "hand, m": HAND_M}
WORLD = ("--world", str(BUILDING), "--world-floor", "L2", "--world-at", "17", "9.25", "1.57")


def last_state(folder: Path, adaptor: str, seed: int) -> AgentState:
    """The robot's state after its program; one that does not end done ends the bench."""
    folder.mkdir()
    with (
        running_system(folder, "--building", str(BUILDING)) as (running, _),
        Orb(running.naming) as orb,
        contextlib.ExitStack() as stack,
    ):
        arguments = list(WHERE)
        if adaptor == "smartpal":
            actual = stack.enter_context(running_stand_in(folder, "--seed", str(seed), *WORLD, orb=orb))
            arguments += ["--adaptor", "smartpal", "--", "--naming", str(actual.naming)]
        robot = stack.enter_context(robot_process(folder, orb, ROBOT, *arguments))
        robot.robocorba("program", "run", str(PROGRAM), "--robot", ROBOT)
        state = robot.agent.state()
        assert (state.adaptor, state.program.result) == (adaptor, ProgramResult.DONE)
        return state


def main(runs: int = 1) -> bool:
    rows, body = [], SmartPalBody()
    with folder_of_bench() as folder:
        for number in progress(range(1, runs + 1), "runs"):
            states = [
                last_state(folder / f"{number}-{adaptor}", adaptor, number) for adaptor in ("simulated", "smartpal")
            ]
            end = difference(*states, body)
            off = end.base_m, math.degrees(end.turned_rad), max(end.hands_m.values())
            rows.append({"run": number, **dict(zip(LIMITS, off, strict=True))})
    columns = {what: [row[what] for row in rows] for what in LIMITS}
    marks = [at_most(f"{what}, at the end", max(columns[what]), limit) for what, limit in LIMITS.items()]
    title = f"{PROGRAM.stem} on a virtual and on an actual robot"
    return summarize("virtual_and_actual", title, rows, marks)


if __name__ == "__main__":
    run(main)

"""robocorba program run, pause, resume, step, answer, abort: run a program on a robot, and control it."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from pathlib import Path as File
from typing import TYPE_CHECKING, Annotated

import typer

from robocorba.commands.options import COMPLETIONS, Naming, RobotName, connected
from robocorba.commands.program import app, read
from robocorba.commands.waiting import Outage, StopSignal
from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.system.printing import Console, line

if TYPE_CHECKING:
    from robocorba.robot.agent_state import AgentState
    from robocorba.robot.corba.remote_agent import RemoteAgent

#: Interval between requests for the robot's progress [s].
POLL_INTERVAL_S = 0.1
KEYS = "p: pause  r: resume  s: step  q: end"


@app.command()
def run(
    file: Annotated[File, typer.Argument(metavar="FILE", help="Program file, or - for the standard input.")],
    robot: Annotated[
        str, typer.Option(metavar="NAME", help="Robot to run it on.", autocompletion=COMPLETIONS["robot"])
    ],
    step: Annotated[bool, typer.Option("--step", help="Pause before each icon.")] = False,
    naming: Naming = None,
) -> None:
    """Run a program on a robot and print each icon as it begins. Ctrl-C ends the program and stops the robot.

    Exit code 0 if the program completes. In a terminal p pauses, s steps, r resumes, q ends."""
    from robocorba.robot.corba.remote_agent import RemoteAgent
    from robocorba.robot.programs.program import dumps

    with connected("program run", naming) as orb:
        agent = RemoteAgent(orb, robot)
        agent.load(dumps(read("run", file)))
        stop = StopSignal()
        agent.run(step)
        with _keys() as keys:
            if keys is not None:
                Console(stderr=True).print(KEYS, style="dim")
            ended = _follow(agent, stop, keys)
    report = ended.program
    reasons = filter(None, [report.reason])
    line(report.result.name.lower(), f"{report.icons_done} icons", f"{report.seconds:.1f} s", *reasons)
    if report.result.name != "DONE":
        raise typer.Exit(1)


def _follow(agent: RemoteAgent, stop: StopSignal, keys: int | None) -> AgentState:
    """Follow the program to its end; print each icon that begins, and where it pauses."""
    printed = 0
    was_paused = is_ending = False
    outage = Outage()
    while True:
        try:
            state = agent.state()
            begun = agent.begun(printed)
            outage.note_answer()
        except NotReachable as error:
            outage.note_failure(error)
            stop.wait(POLL_INTERVAL_S)
            continue
        for icon in begun:
            line(icon.icon, icon.kind, f"{icon.seconds:.1f} s")
            printed = icon.number + 1
        is_paused = state.condition.name == "PAUSED"
        if is_paused and not was_paused:
            line(state.program.icon, state.program.kind, "paused")
        was_paused = is_paused
        if state.program.result.name != "NO_RESULT":
            return state
        if stop.wait(POLL_INTERVAL_S) and not is_ending:
            is_ending = True
            agent.abort()
        if keys is not None:
            _handle_keys(agent, keys)


def _handle_keys(agent: RemoteAgent, keys: int) -> None:
    orders = {"p": agent.pause, "r": agent.resume, "s": agent.step, "q": agent.abort}
    while select.select([keys], [], [], 0.0)[0]:
        key = os.read(keys, 1).decode(errors="replace")
        with contextlib.suppress(IllegalOrder):  # the program has just ended
            if key in orders:
                orders[key]()
        if not key:
            return


@contextlib.contextmanager
def _keys() -> Iterator[int | None]:
    """File descriptor of the terminal's keys, unbuffered and without echo; None without a terminal."""
    if not sys.stdin.isatty():
        yield None
        return
    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    tty.setcbreak(number)
    try:
        yield number
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _add_order(order: str, help: str) -> None:
    @app.command(order, help=help)
    def give(robot: RobotName, naming: Naming = None) -> None:
        from robocorba.robot.corba.remote_agent import RemoteAgent

        with connected(f"program {order}", naming) as orb:
            getattr(RemoteAgent(orb, robot), order)()


_add_order("pause", "Pause a robot's program until `resume` or `step`.")
_add_order("resume", "Continue a robot's program.")
_add_order("step", "Continue a robot's program to the next icon.")
_add_order("abort", "End a robot's program.")


@app.command()
def answer(
    robot: RobotName,
    yes: Annotated[str, typer.Argument(metavar="yes|no", help="Answer. Without it, print the question.")] = "",
    naming: Naming = None,
) -> None:
    """Answer a question that a robot's program asks with the icon `confirm`. Exit code 1 if it asks none."""
    from robocorba.robot.corba.remote_agent import RemoteAgent

    if yes not in ("yes", "no", ""):
        raise typer.BadParameter(f"{yes!r} is neither yes nor no")
    with connected("program answer", naming) as orb:
        agent = RemoteAgent(orb, robot)
        asked = agent.question()
        if yes or not asked.number:
            agent.answer(asked.number, yes == "yes")
        line(robot, asked.text, yes or "?")

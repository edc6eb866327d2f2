"""The same program on a virtual and an actual robot, and how much their final states differ."""

from __future__ import annotations

import contextlib
import math
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentState
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import Side
from testkit.processes import ROBOCORBA, Launcher, drain

#: Maximum differences at the end: position of the base [m], heading [rad], position of a hand [m].
BASE_M, TURNED_RAD, HAND_M = 0.010, math.radians(0.5), 0.005
#: Timeout of a command, and of the end of a robot process [s].
RUN_LIMIT_S, END_LIMIT_S = 180.0, 60.0


class StateDifference(NamedTuple):
    """Differences between two robots. hands_m: each hand in the frame of its robot."""

    base_m: float
    turned_rad: float
    hands_m: dict[Side, float]


def difference(one: AgentState, other: AgentState, body: SmartPalBody) -> StateDifference:
    """The differences between the states of two robots."""
    a, b = one.actor, other.actor
    hands = {side: math.dist(body.hand(side, a.joints).position, body.hand(side, b.joints).position) for side in Side}
    turned = abs(math.remainder(a.heading - b.heading, math.tau))
    return StateDifference(math.dist((a.x, a.y), (b.x, b.y)), turned, hands)


class RobotProcess(NamedTuple):
    """A robot process. robocorba: runs a `robocorba` command in its folder and returns its output."""

    folder: Path
    agent: RemoteAgent
    robocorba: Callable[..., str]


@contextlib.contextmanager
def robot_process(folder: Path, orb: Orb, name: str, *arguments: str) -> Iterator[RobotProcess]:
    """`robocorba robot NAME ...`, ready, until the end of the `with`."""
    settings = {"ROBOCORBA_NAMING": str(orb.naming), "ROBOCORBA_STATE": str(folder / "state")}
    with Launcher(folder) as launch:
        process = launch(ROBOCORBA, "robot", name, *arguments, **settings)
        assert process.stdout is not None
        assert process.stderr is not None
        if process.stdout.readline() != "ready\n":
            raise AssertionError(process.stderr.read())
        drain(process)

        def robocorba(*command: str) -> str:
            other = launch(ROBOCORBA, *command, **settings)
            out, err = other.communicate(timeout=RUN_LIMIT_S)
            assert other.returncode == 0, out + err
            return out

        yield RobotProcess(folder, RemoteAgent(orb, name), robocorba)
        process.send_signal(signal.SIGTERM)
        process.wait(END_LIMIT_S)

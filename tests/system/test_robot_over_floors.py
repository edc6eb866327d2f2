"""A program over two floors, run by the command in a robot process."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import pytest

from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.corba.remote.data_pool import RemotePool
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import dumps
from robocorba.supervision.launch import LoggedProcess
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, drain, eventually

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

#: Time limit for each part [s].
PATIENCE_S = 180.0


class Ride(NamedTuple):
    """The command that runs the program."""

    command: LoggedProcess
    agent: RemoteAgent
    pool: RemotePool


@pytest.fixture(scope="module")
def ride(system: Running, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ride]:
    folder = tmp_path_factory.mktemp("ride")
    builder = ProgramBuilder("ride").mhand_posture("both", "tuck").mbase_path("L2", 15.0, 5.0, heading=1.0)
    builder.mhand_posture("both", "ready").gripper("right", "open").say("robot.there", {"floor": "L2"})
    (folder / "ride.json").write_text(dumps(builder.program()))
    naming = ("--naming", str(system.naming))
    with Launcher(folder) as launch, Orb(system.naming) as orb:
        where = ("--floor", "L1", "--at", "14,5,0", "--channel", "main", "--state", str(folder / "state"))
        robot = launch(ROBOCORBA, "robot", "A", *where, *naming)
        assert robot.stdout is not None and robot.stderr is not None
        assert robot.stdout.readline() == "ready\n", robot.stderr.read()
        drain(robot)
        run = ("program", "run", str(folder / "ride.json"), "--robot", "A")
        with LoggedProcess(folder / "errors", ROBOCORBA, *run, *naming) as command:
            yield Ride(command, RemoteAgent(orb, "A"), RemotePool.of_robot(orb, "A"))


@pytest.mark.timeout(4 * PATIENCE_S)
def test_it_rides_to_another_floor_and_ends_there(ride: Ride) -> None:
    eventually(lambda: ride.agent.state().at.floor == "L2", PATIENCE_S, "on the other floor")
    printed = []
    while line := ride.command.read_line(PATIENCE_S):
        printed.append(line.rstrip("\n"))
    assert (ride.command.wait(PATIENCE_S), ride.command.log_tail()) == (0, "")
    assert [line.split("\t")[1] for line in printed[:-1]] == [
        *("mhand_posture", "mbase_path", "mhand_posture", "gripper", "say")
    ]
    assert printed[-1].startswith("done\t5 icons\t")
    at = ride.agent.state().at
    assert (at.floor, at.x, at.y, at.heading) == (
        "L2",
        *(pytest.approx(value, abs=0.004) for value in (15.0, 5.0, 1.0)),
    )
    assert ride.pool.floor == "L2"
    assert [body.name for body in ride.pool.content().came if body.name == "A"] == ["A"]

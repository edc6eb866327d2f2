"""A fleet of real robots: one is killed, the others go on, and all that still run log off together."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent, robots
from robocorba.corba.remote.registered_robots import RegisteredRobots
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import dumps
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, command_line, drain, eventually, is_running

pytestmark = pytest.mark.system

PATIENCE_S = 60.0
FLEET = """
defaults: {floor: L1}
robots:
  - {name: Lead, program: wait.json}
  - {prefix: F, count: 2}
"""
Start = Callable[..., "Fleet"]


class Fleet:
    """A running `robocorba robots` and the lines that it has printed."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process, self.lines = process, list[str]()
        drain(process)
        threading.Thread(target=lambda: self.lines.extend(process.stdout or ()), daemon=True).start()

    def wait_for(self, line: str) -> None:
        eventually(lambda: f"{line}\n" in self.lines, PATIENCE_S, line)

    def pid_of(self, robot: str) -> int:
        children = psutil.Process(self.process.pid).children()
        return next(child.pid for child in children if f"robocorba.clients.robot {robot} " in command_line(child))

    def end(self, number: signal.Signals) -> int:
        """Its exit code."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


@pytest.fixture
def start(system: Running, tmp_path: Path) -> Iterator[Start]:
    """Starts `robocorba robots` in a folder with a fleet, and waits until all robots have started."""
    (tmp_path / "fleet.yaml").write_text(FLEET)
    (tmp_path / "wait.json").write_text(dumps(ProgramBuilder("waiting").wait(600.0).program()))
    with Launcher(tmp_path) as launch:

        def run(*arguments: str) -> Fleet:
            naming = {"ROBOCORBA_NAMING": str(system.naming), "ROBOCORBA_STATE": str(tmp_path / "state")}
            fleet = Fleet(launch(ROBOCORBA, "robots", *arguments, **naming))
            fleet.wait_for("ready")
            return fleet

        yield run


def test_one_dies_the_others_go_on_and_all_log_off(start: Start, system_orb: Orb) -> None:
    fleet, registered = start("fleet.yaml"), RegisteredRobots(system_orb)
    assert registered.floors() == {"Lead": "L1", "F1": "L1", "F2": "L1"}
    fleet.wait_for("Lead\tL1\trunning\twaiting\t0\t")
    os.kill(fleet.pid_of("F1"), signal.SIGKILL)
    fleet.wait_for("F1\tL1\tended\t\t0\tended by SIGKILL")
    assert RemoteAgent(system_orb, "Lead").state().program.name == "waiting"
    assert RemoteAgent(system_orb, "F2").state().at.floor == "L1"
    family = psutil.Process(fleet.process.pid).children(recursive=True)
    assert fleet.end(signal.SIGINT) == 1  # one failed
    assert set(registered.floors()) <= {"F1"}  # until its lease expires
    assert set(robots(system_orb)) <= {"F1"}
    assert not any(map(is_running, family))


def test_a_robot_is_started_again_if_wanted(start: Start, system_orb: Orb) -> None:
    fleet = start("--count", "1", "--prefix", "G", "--restart")
    os.kill(fleet.pid_of("G1"), signal.SIGKILL)
    eventually(lambda: any(line.startswith("G1\tL1\tidle\t\t") and "\t0\t" not in line for line in fleet.lines))
    assert RemoteAgent(system_orb, "G1").state().name == "G1"
    assert fleet.end(signal.SIGTERM) == 0
    assert "G1" not in RegisteredRobots(system_orb).floors()

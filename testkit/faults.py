"""What happens to processes and robots in tests and benches: kills, hangs, emergency stops in three ways."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable

import psutil
from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.stubs import RoboCorba
from testkit.processes import ROBOCORBA, Running, eventually, hang, is_running

#: Ways of an emergency stop: `robocorba stop`, the simulation server alone, the robot's agent alone.
WAYS = ("command", "server", "agent")
#: Timeout of the command, of calls, and until a stop is confirmed [s].
COMMAND_LIMIT_S, CALL_LIMIT_S, PATIENCE_S = 10.0, 3.0, 60.0


def kill(pid: int) -> None:
    """kill -9 a process, and wait until it has ended."""
    with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError):
        process = psutil.Process(pid)
        os.kill(pid, signal.SIGKILL)
        eventually(lambda: not is_running(process), what=f"the end of process {pid}")


def hang_for(seconds: float, *pids: int) -> None:
    """SIGSTOP processes for a time; those that were killed meanwhile are left out."""
    for pid in pids:
        hang(pid)
    time.sleep(seconds)
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def stop_robot(running: Running, orb: Orb, robot: str, way: str) -> int:
    """Stop a robot, again until that is confirmed; returns how often the command printed nothing in time."""
    silent = 0

    def by_command() -> None:
        command = (ROBOCORBA, "stop", robot, "--naming", str(running.naming), "--state", str(running.state))
        subprocess.run(command, check=True, capture_output=True, timeout=COMMAND_LIMIT_S)

    def by_server() -> None:
        server = orb.resolve("SimulationServer", RoboCorba.SimulationServer, CALL_LIMIT_S, CALL_LIMIT_S)
        server.stopRobots([robot], "bench")

    def by_agent() -> None:
        RemoteAgent(orb, robot, 0.5).stop()

    stop: Callable[[], None] = {"command": by_command, "server": by_server, "agent": by_agent}[way]

    def is_confirmed() -> bool:
        nonlocal silent
        try:
            stop()
        except subprocess.TimeoutExpired:
            silent += 1
            return False
        except (RoboCorbaError, CORBA.SystemException, subprocess.CalledProcessError):
            return False
        return True

    eventually(is_confirmed, PATIENCE_S, f"a stop of {robot} by the {way}")
    return silent

"""An emergency stop while names are stolen and the naming service hangs; and sensor servers that don't belong."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import CosNaming
import pytest
from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.corba.remote.omni_database import RemoteDatabase
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import dumps
from robocorba.simulation.sensor_admission import proof_of, read_token
from robocorba.spatial.floor_update import WHOLE
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, eventually, hang
from robocorba.testing.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

PATIENCE_S = 60.0
#: Time limit for a stopped body to stand [s]; shorter than the program below.
STANDING_S = 10.0
LONG = ProgramBuilder("long").mbase_velocity(0.2, 0.0, 0.0, 60.0).program()
EVIL = "\x1b]0;evil\x07\n\tB\tstands"


class FalseRobot(RoboCorba__POA.RobotAgent):
    """Confirms everything."""

    def _get_name(self) -> str:
        return "A"

    def stop(self) -> None:
        pass


class FalseServer(RoboCorba__POA.SimulationServer):
    """Says that all stand."""

    def stopRobots(self, robots: list[str], reason: str) -> list[Any]:
        return [RoboCorba.StopState("A", True, True, 0.0, True, "")]


@contextlib.contextmanager
def thief(orb: Orb) -> Iterator[None]:
    """Binds false objects to the names of the robot A and of the simulation server, again and again."""
    root = orb.reference(f"corbaloc:iiop:1.2@{orb.naming}/NameService", CosNaming.NamingContext)
    false = {"Robots/A": orb.activate(FalseRobot()), "SimulationServer": orb.activate(FalseServer())}
    false[f"Robots/{EVIL}"] = false["Robots/A"]
    closing, has_bound = threading.Event(), threading.Event()

    def steal() -> None:
        while not closing.is_set():
            for name, reference in false.items():
                path = [CosNaming.NameComponent(part, "") for part in f"RoboCorba/{name}".split("/")]
                with contextlib.suppress(CORBA.SystemException):
                    root.rebind(path, reference)
            has_bound.set()
            closing.wait(0.02)

    thread = threading.Thread(target=steal)
    thread.start()
    try:
        assert has_bound.wait(PATIENCE_S)
        yield
    finally:
        closing.set()
        thread.join()


@pytest.fixture
def robocorba(launch: Launcher, system: Running) -> Callable[..., tuple[int, str]]:
    """Runs `robocorba`, and returns its exit code and what it has printed."""

    def run(*arguments: str) -> tuple[int, str]:
        places = {"ROBOCORBA_NAMING": str(system.naming), "ROBOCORBA_STATE": str(system.state)}
        process = launch(ROBOCORBA, *arguments, **places)
        out, err = process.communicate(timeout=PATIENCE_S)
        return process.returncode, out + err

    return run


#: What proves that a virtual robot stands; on a busy machine its body may be seen first.
PROOFS = {"A\tstands\tthe robot confirms it", "A\tstands\tits body stands"}


def speed(orb: Orb) -> float:
    """Of the body of the robot A [m/s], only read: an order would stop the robot as well. Not from its agent, whose
    state is not updated while it is stopped."""
    update = RemoteDatabase(orb, PATIENCE_S).changes("L1", WHOLE)
    (number,) = (body.number for body in update.came if body.name == "A")
    (row,) = (row for row in update.motions if row["number"] == number)
    return math.hypot(row["vx"], row["vy"])


def drive(orb: Orb) -> RemoteAgent:
    agent = RemoteAgent(orb, "A", PATIENCE_S)
    agent.load(dumps(LONG))
    agent.run()
    eventually(lambda: speed(orb) > 0.15, PATIENCE_S, "moving")
    return agent


def check_stopped(agent: RemoteAgent, orb: Orb) -> None:
    eventually(lambda: agent.state().condition.name == "STOPPED", PATIENCE_S, "the robot has received the stop")
    eventually(lambda: speed(orb) < 0.01, STANDING_S, "the body stands")


def test_a_stop_does_not_depend_on_names(
    system: Running, system_orb: Orb, robocorba: Callable[..., tuple[int, str]], tmp_path: Path
) -> None:
    endpoint = next(process.endpoint for process in system.record().processes if process.name == "simulation")
    server = system_orb.reference(f"corbaloc:iiop:1.2@{endpoint}/SimulationServer", RoboCorba.SimulationServer, 5.0)
    where, server_log = ("--floor", "L1", "--at", "3,5,0", "--channel", "main"), system.state / "logs/simulation.log"
    with robot_process(tmp_path, system_orb, "A", *where):
        agent = drive(system_orb)
        own = agent._agent
        with thief(system_orb):
            code, printed = robocorba("stop", "--all")
            assert code == 0
            assert PROOFS & set(printed.splitlines())
            assert "\x1b" not in printed and "\nB\tstands" not in printed
            assert "evil" in printed
            check_stopped(agent, system_orb)

        def is_back() -> bool:
            bound = system_orb._names.bound("Robots/A"), system_orb._names.bound("SimulationServer")
            return bool(bound[0]._is_equivalent(own) and bound[1]._is_equivalent(server))

        eventually(is_back, PATIENCE_S, "names taken back")
        for log, name in ((tmp_path / "state/logs/robot_A.log", "Robots/A"), (server_log, "SimulationServer")):
            assert f"took back the name RoboCorba/{name}" in log.read_text()
        until = "all robots are stopped, until: robocorba stop --all --reset (emergency stop)"
        assert until in robocorba("status")[1]
        robocorba("stop", "--all", "--reset")  # also what the thief has bound, which refuses
        assert "all robots" not in robocorba("status")[1]
        drive(system_orb)
        naming = system.pid("omniNames")
        hang(naming)
        try:
            code, printed = robocorba("stop", "A")
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(naming, signal.SIGCONT)
        assert code == 0 and printed.rstrip("\n") in PROOFS
        check_stopped(agent, system_orb)


def test_a_false_sensor_server_gets_no_robots(system: Running, system_orb: Orb) -> None:
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    true = system_orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    load = RoboCorba.SensorLoad(0.0, 0.0, 0.0, 0)
    for name in ("false", "s1"):
        with pytest.raises(CORBA.NO_PERMISSION):
            server.reportSensor(name, true, load, [])
        with pytest.raises(CORBA.NO_PERMISSION):
            server.reportScans(name, [])
        with pytest.raises(RoboCorba.SensorRefused, match="token"):
            server.registerSensor(name, true, "guessed")
    # A proof that was overheard is good for the reference only that it was made for.
    token = read_token(system.state / "sensors.token")
    with pytest.raises(RoboCorba.SensorRefused):
        server.registerSensor("false", system_orb.resolve("MapEditor", CORBA.Object), proof_of(token, "false", "other"))
    assert [sensor.name for sensor in server.sensors()] == ["s1"]
    assert (system.state / "sensors.token").stat().st_mode & 0o077 == 0
    registered = server.registerSensor("more", true, proof_of(token, "more", system_orb.uri(true)))
    registered.report(load, [])
    assert [sensor.name for sensor in server.sensors()] == ["more", "s1"]

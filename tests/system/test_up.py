"""robocorba up and status with real processes, killed in every way there is."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS
from robocorba.system.settings import Address
from testkit.processes import ROBOCORBA, Running, drain, eventually, hang, is_running, read_json, refusal
from tests.damage import damage

pytestmark = [pytest.mark.system, pytest.mark.slow(60)]

Launch = Callable[..., subprocess.Popen[str]]
Start = Callable[..., Running]


def answers(planner: object) -> int:
    """The process id of the echo server that answers, 0 where none does."""
    try:
        return planner._get_mapVersion()  # type: ignore[attr-defined]
    except (CORBA.TRANSIENT, CORBA.COMM_FAILURE):
        return 0


def status(launch: Launch, running: Running, *options: str) -> tuple[int, str]:
    process = launch(ROBOCORBA, "status", "--state", str(running.state), *options)
    out, err = process.communicate(timeout=60)
    assert err == ""
    return process.returncode, out


def test_all_is_served_when_it_is_ready_and_nothing_is_left_after_ctrl_c(
    echo_up: Start, launch: Launch, client: Orb
) -> None:
    running = echo_up().wait_ready()
    pid = running.pid("echo")
    assert client.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s=1.0)._get_mapVersion() == pid
    assert running.printed == [
        "process\tpid\tobject",
        f"omniNames\t{running.pid('omniNames')}\tcorbaname::{running.naming}",
        f"echo\t{pid}\tcorbaname::{running.naming}#RoboCorba/PathPlanner",
    ]
    said = refusal(echo_up().process)
    assert f"another robocorba up (process id {running.process.pid}) uses the state folder" in said
    code, out = status(launch, running, "--json")
    names, echo = read_json(out)["processes"]
    assert code == 0
    assert (names["name"], echo["name"], echo["pid"]) == ("omniNames", "echo", pid)
    assert echo["memory_mib"] > 1 and echo["uptime_s"] > 0 and echo["restarts"] == 0
    assert [thing["name"] for thing in echo["objects"]] == ["RoboCorba/PathPlanner"]
    assert 0 < echo["objects"][0]["answered_ms"] < 60_000
    state = ("--state", str(running.state))
    found = read_json(launch(ROBOCORBA, "doctor", "--json", *state).communicate(timeout=60)[0])
    facts = {fact["what"]: fact["found"] for fact in found["facts"]}
    assert f"{running.naming}, from the state folder {running.state}; used by process" in facts["naming service"]
    assert [each["name"] for each in found["processes"]] == ["omniNames", "echo"]
    assert f"echo started with process id {pid}" in launch(ROBOCORBA, "logs", "up", *state).communicate(timeout=60)[0]
    follower = launch(ROBOCORBA, "logs", "up", "-f", "--lines", "0", *state)
    log = str(running.state / "logs" / "up.log")
    eventually(lambda: log in [file.path for file in psutil.Process(follower.pid).open_files()], what="its follower")
    hang(pid)
    code, out = status(launch, running)
    assert (code, "\tPathPlanner\tRoboCorba/PathPlanner is not reachable" in out) == (1, True)
    os.kill(pid, signal.SIGCONT)
    assert running.stop(signal.SIGINT) == 0
    assert follower.stdout and follower.stdout.readline().endswith("up stopped\n")
    follower.send_signal(signal.SIGINT)
    assert follower.wait(60.0) == 0
    assert running.left_behind() == []
    assert len(running.descendants) == 3  # with the warm parent
    assert not (running.state / "up.json").exists()
    assert b"unbind" in (running.state / "omninames" / "omninames.dat").read_bytes()  # no names are left


def test_kill_9_of_the_supervisor_and_damaged_files(
    echo_up: Start, launch: Launch, client: Orb, naming_port: int
) -> None:
    running = echo_up().wait_ready()
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
    running.stop(signal.SIGKILL)
    eventually(lambda: not running.left_behind(), what="all children ended")
    assert len(running.descendants) == 3  # with the warm parent
    assert status(launch, running) == (1, f"nothing runs in {running.state}\n")  # up.json is still there
    damaged = ("ports.json", "up.json", "omninames/omninames.dat")
    for name in damaged:
        damage(running.state / name)
    running = echo_up().wait_ready()
    assert client.resolve("PathPlanner", RoboCorba.PathPlanner)._get_mapVersion() == running.pid("echo")
    assert answers(planner) == running.pid("echo")  # at the port of before
    log = (running.state / "logs" / "up.log").read_text()
    for name in damaged:
        assert (running.state / f"{name}.damaged").exists()
        assert f"{running.state / name} is damaged" in log
    running.stop(signal.SIGKILL)
    moved = echo_up(port=naming_port + 5).wait_ready()  # the same folder at another naming service
    name = ("RoboCorba/PathPlanner", RoboCorba.PathPlanner, 60.0)
    found = client.resolve_in_other_naming_service(moved.naming, *name)
    assert eventually(lambda: answers(found)) == moved.pid("echo")
    assert moved.stop(signal.SIGHUP) == 0
    assert moved.left_behind() == []


def test_ctrl_c_in_the_middle_of_the_start(echo_up: Start) -> None:
    running = echo_up(ECHO_MODE="mute")
    eventually(lambda: len(psutil.Process(running.process.pid).children(recursive=True)) >= 2, what="both started")
    running.note_descendants()
    assert running.stop(signal.SIGINT) == 0
    assert running.left_behind() == []


def test_what_a_server_started_ends_with_it(echo_up: Start) -> None:
    running = echo_up(ECHO_MODE="parent").wait_ready()
    assert len(running.descendants) == 4
    first, orphans = running.pid("echo"), psutil.Process(running.pid("echo")).children()
    os.kill(first, signal.SIGKILL)
    eventually(lambda: not any(map(is_running, orphans)), what="the killed server's child ended")
    eventually(lambda: running.pid("echo") not in (0, first), what="started again")
    running.note_descendants()
    assert running.stop() == 0
    assert running.left_behind() == []


def test_a_server_that_ignores_sigterm_is_killed(echo_up: Start) -> None:
    running = echo_up(ECHO_MODE="stubborn").wait_ready()
    began = time.monotonic()
    assert running.stop() == 0
    assert time.monotonic() - began >= 5.0, "it had no time to end by itself"
    assert running.left_behind() == []


def test_references_and_names_survive_kill_9_of_servers(echo_up: Start, client: Orb) -> None:
    running = echo_up().wait_ready()
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
    for restarts in (1, 2, 3):
        before = planner._get_mapVersion()
        os.kill(before, signal.SIGKILL)
        eventually(lambda: answers(planner) not in (0, before), what="answers again")  # noqa: B023

        def is_seen(restarts: int = restarts) -> bool:
            echo = running.record().processes[1]
            return (echo.state, echo.restarts) == ("running", restarts)

        eventually(is_seen, what="seen as running")
    first = running.pid("omniNames")
    os.kill(first, signal.SIGKILL)
    eventually(lambda: running.pid("omniNames") not in (0, first), what="started again")
    assert client.resolve("PathPlanner", RoboCorba.PathPlanner)._get_mapVersion() == running.pid("echo")
    for file in (running.state / "omninames").iterdir():  # the next one comes back empty
        file.unlink()
    os.kill(running.pid("omniNames"), signal.SIGKILL)
    assert client.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s=60.0)._get_mapVersion() == running.pid("echo")
    assert running.stop() == 0


def test_ports_in_use_are_one_line_and_ports_are_remembered(echo_up: Start, client: Orb, naming_port: int) -> None:
    """A client keeps its reference over a restart of the whole, even when the first free port has changed."""
    with socket.create_server(("127.0.0.1", naming_port)):
        said = refusal(echo_up().process)
    assert said.startswith(f"robocorba up: port {naming_port} on 127.0.0.1, wanted for the naming service, is in use")
    assert f"process {os.getpid()} (" in said
    with socket.create_server(("127.0.0.1", naming_port + 1)):
        first = echo_up().wait_ready()
        planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
        assert first.record().processes[1].endpoint == f"127.0.0.1:{naming_port + 2}"
        first.stop()
    with socket.create_server(("127.0.0.1", naming_port + 2)):
        said = refusal(echo_up().process)
    assert f"port {naming_port + 2} on 127.0.0.1, wanted for echo" in said
    second = echo_up().wait_ready()
    assert eventually(lambda: answers(planner)) == second.pid("echo")


def test_a_server_that_fails_at_start_is_named_with_its_error(echo_up: Start) -> None:
    running = echo_up(ECHO_MODE="broken")
    said = refusal(running.process)
    assert said.startswith("robocorba up: echo ended with exit code 1 before it answered a call")
    assert said.endswith(r"CRITICAL ValueError: the echo is broken\non two lines")
    log = (running.state / "logs" / "echo.log").read_text()
    assert re.fullmatch(r"\S+ CRITICAL echo ValueError: the echo is broken\\non .*Traceback.*\n", log)


def test_a_server_that_never_serves_is_named(echo_up: Start) -> None:
    said = refusal(echo_up(limit_s=5.0, ECHO_MODE="mute").process)
    assert said.startswith("robocorba up: echo did not answer within 5 s: RoboCorba/PathPlanner is not reachable")


def test_a_server_that_hangs_is_restarted(echo_up: Start, client: Orb) -> None:
    running = echo_up(hang_limit_s=2.0).wait_ready()
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
    hanging = running.pid("echo")
    os.kill(hanging, signal.SIGSTOP)
    eventually(lambda: not psutil.pid_exists(hanging), what="the end of the hanging server")
    assert eventually(lambda: answers(planner)) != hanging
    assert "echo was killed: no answer for" in (running.state / "logs" / "up.log").read_text()


@pytest.mark.parametrize(("option", "value"), [("host", "0.0.0.0"), ("host", "192.0.2.1"), ("subnets", "../lab")])
def test_hosts_and_sub_networks_that_cant_be_served_are_refused(launch: Launch, option: str, value: str) -> None:
    said = refusal(launch(ROBOCORBA, "up", "--state", "state", f"--{option}", value))
    assert said.startswith("robocorba up: ") and value in said


def test_two_instances_run_side_by_side(launch: Launch, tmp_path: Path) -> None:
    def started(*words: str) -> subprocess.Popen[str]:
        return launch(ROBOCORBA, *words, XDG_STATE_HOME=str(tmp_path))

    def printed(*words: str) -> str:
        return started(*words).communicate(timeout=60)[0]

    systems = {name: started("up", "--instance", name, "--hang-limit", "60") for name in ("anna", "bob")}
    for name, process in systems.items():
        drain(Running(process, tmp_path, Address("0.0.0.0", 1)).wait_ready().process)
        robot = started("robot", name, "--instance", name, "--floor", "L1")
        assert robot.stdout and robot.stdout.readline() == "ready\n"
    for name in systems:
        (robots,) = read_json(printed("watch", "--json", "--instance", name))["robots"]
        assert robots["name"] == name and "goal" in printed("path", "L1:17,1.2", "L1:17,4", "--instance", name)
    assert f"(process id {systems['anna'].pid}) uses the state folder" in refusal(started("up", "--instance", "anna"))
    systems["anna"].send_signal(signal.SIGINT)
    assert systems["anna"].wait(60) == 0
    nothing = f"nothing runs in {tmp_path / 'robocorba-anna'}; instances that run: bob\n"
    assert printed("status", "--instance", "anna") == nothing
    assert "instance 'anna' does not run" in refusal(started("path", "L1:1,1", "L1:2,2", "--instance", "anna"))
    assert [*read_json(printed("status", "--json", "--instance", "bob"))["robots"]] == ["bob"]


@pytest.mark.usefixtures("alone")
def test_the_real_servers(robocorba_up: Start, launch: Launch, client: Orb) -> None:
    running = robocorba_up().wait_ready()
    assert client.resolve("MapEditor", RoboCorba.MapEditor)._get_currentVersion() >= 0
    planner = client.resolve("PathPlanner", RoboCorba.PathPlanner)
    assert client.names(CHANNELS) == ["main"]  # one channel, unless there are --subnets
    assert client.resolve(f"{CHANNELS}/main", RoboCorba.EventChannel).state().links == []
    assert launch(ROBOCORBA, "status", "--state", str(running.state)).wait(60.0) == 0
    os.kill(running.pid("map_editor"), signal.SIGKILL)
    eventually(lambda: answers(planner) > 0, what="answers again")
    assert running.stop() == 0
    assert running.left_behind() == []

"""Orders for robots, the commands that they become, and robots as processes of an event loop."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robocorba.errors.services import NotReachable, ProcessExists, UnknownProcess
from robocorba.errors.simulation import InvalidChoice
from robocorba.logs import last_lines
from robocorba.processes import RobotOrder
from robocorba.settings import Address
from robocorba.supervision.launch import ModuleRun
from robocorba.supervision.order_checker import checked_places
from robocorba.supervision.output import ReadyLine
from robocorba.supervision.process import ProcessSpec
from robocorba.supervision.robots import Robots, robot_spec
from robocorba.supervision.starter import Starter

FLOORS = ["L1", "L2"]


def test_a_placed_robot_gets_the_lowest_floor() -> None:
    assert checked_places(RobotOrder("A", at=(1.0, 2.0, 0.0)), FLOORS, []).floor == "L1"
    assert checked_places(RobotOrder("A", floor="L2", at=(1.0, 2.0, 0.0)), FLOORS, []).floor == "L2"
    assert checked_places(RobotOrder("A"), FLOORS, []).floor == ""


def test_a_building_without_floors_has_no_place() -> None:
    with pytest.raises(InvalidChoice, match="no floor"):
        checked_places(RobotOrder("A", at=(0.0, 0.0, 0.0)), [], [])


def test_no_value_becomes_another_option() -> None:
    order = RobotOrder("A", "smartpal", ("--x", "-1"), "--help", (-1.5, 2.0, -0.25), "-c")
    module = robot_spec(order, Path("/state"), Address("127.0.0.1", 2809), 60.0).command
    assert isinstance(module, ModuleRun)
    command = module.arguments
    own, adaptors = command[: command.index("--")], command[command.index("--") + 1 :]
    assert adaptors == ("--x", "-1")
    assert {"--floor=--help", "--at=-1.5,2.0,-0.25", "--channel=-c", "--adaptor=smartpal"} <= set(own)


def test_a_process_says_that_it_is_ready_in_each_run() -> None:
    output = ReadyLine("robot_A", ignored="http")
    for _ in range(2):
        with pytest.raises(NotReachable):
            output.probe()
        output("http://127.0.0.1:8800/")
        output("ready")
        output.probe()


def test_the_end_of_a_log(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    assert last_lines(log, 5) == []
    log.write_bytes(b"4\n5\x00\n\xff6\n")
    (tmp_path / "a.log.1").write_text("1\n2\n3\n")
    assert last_lines(log, 2) == ["5\\x00", "\\xff6"]
    assert last_lines(log, 4) == ["3", "4", "5\\x00", "\\xff6"]
    assert last_lines(log, 100)[:3] == ["1", "2", "3"]
    assert last_lines(log, 0) == []


def test_of_a_large_log_only_the_end_is_read(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    log.write_text("x" * 999_999 + "\nlast\n")
    assert last_lines(log, 500) == ["last"]


def spec_of(script: str) -> Callable[[RobotOrder], ProcessSpec]:
    """Robots that run a script of Python."""

    def spec(order: RobotOrder) -> ProcessSpec:
        output = ReadyLine(order.process)
        return ProcessSpec(order.process, (sys.executable, "-S", "-c", script), Path.cwd(), output.probe, output, 20.0)

    return spec


async def until(condition: Callable[[], bool]) -> None:
    async def poll() -> None:
        while not condition():
            await asyncio.sleep(0.01)

    await asyncio.wait_for(poll(), 20.0)


WAITING = "import time; print('ready', flush=True); time.sleep(600)"


def test_robots_start_and_end() -> None:
    async def run() -> None:
        starter = Starter()
        robots = Robots(spec_of(WAITING), starter, lambda: None)
        robots.start(RobotOrder("A"))
        with pytest.raises(ProcessExists):
            robots.start(RobotOrder("A"))
        await until(lambda: robots.processes[0].state == "running")
        robots.end("robot_A")
        robots.end("A")  # twice, while it is ending
        await until(lambda: robots.processes == [])
        with pytest.raises(UnknownProcess):
            robots.end("A")
        robots.start(RobotOrder("B"))
        await robots.close()
        await until(lambda: robots.processes == [])
        await starter.close()

    asyncio.run(run())


@pytest.mark.parametrize(
    ("script", "problem"),
    [
        ("raise SystemExit('no such floor')", "no such floor"),
        ("print('ready', flush=True); import time; time.sleep(0.5); raise SystemExit(3)", "exit code 3"),
    ],
)
def test_a_robot_that_ended_is_shown_until_it_is_forgotten(script: str, problem: str) -> None:
    async def run() -> None:
        starter = Starter()
        robots = Robots(spec_of(script), starter, lambda: None)
        robots.start(RobotOrder("A"))
        await until(lambda: robots.processes[0].state == "ended")
        (process,) = robots.processes
        assert problem in process.problem and process.pid == 0 and process.restarts == 0
        robots.start(RobotOrder("A"))
        await until(lambda: robots.processes[0].state == "ended")
        robots.end("A")
        assert robots.processes == []
        await starter.close()

    asyncio.run(run())


def test_only_some_robots_start_at_a_time() -> None:
    async def run() -> None:
        starter = Starter()
        robots = Robots(spec_of(WAITING), starter, lambda: noted.append(states()), starting=2)

        def states() -> list[str]:
            return [process.state for process in robots.processes]

        noted: list[list[str]] = []
        for number in range(6):
            robots.start(RobotOrder(f"R{number}"))
        await until(lambda: states() == ["running"] * 6)
        assert max(seen.count("starting") for seen in noted) == 2
        await robots.close()
        await starter.close()

    asyncio.run(run())


def test_robots_are_started_again_if_wanted() -> None:
    async def run() -> None:
        starter = Starter()
        robots = Robots(spec_of(WAITING), starter, lambda: None, restarts=True)
        process = robots.start(RobotOrder("A"))
        await until(lambda: process.state == "running")
        former = process.pid
        os.kill(former, signal.SIGKILL)
        await until(lambda: process.state == "running" and process.pid not in (0, former))
        assert process.restarts == 1
        await robots.close()
        assert robots.processes == []
        await starter.close()

    asyncio.run(run())

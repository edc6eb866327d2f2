"""Robots of a system: fleet files, orders, the commands that they become, and their processes."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.maps import MapFileError
from robocorba.errors.services import NotReachable, ProcessExists, UnknownProcess
from robocorba.errors.simulation import InvalidChoice
from robocorba.system.logs import last_lines
from robocorba.system.processes import RobotOrder
from robocorba.system.settings import Address
from robocorba.system.supervision.fleet_file import InvalidFleet, group_of, read_fleet
from robocorba.system.supervision.launch import ModuleRun
from robocorba.system.supervision.order_checker import checked_places
from robocorba.system.supervision.output import ReadyLine
from robocorba.system.supervision.process import ProcessSpec
from robocorba.system.supervision.robots import MAX_ROBOTS, Robots, robot_spec
from robocorba.system.supervision.starter import Starter
from tests.waits import until

FLOORS = ["L1", "L2"]


def test_what_becomes_of_an_order_and_its_log(tmp_path: Path) -> None:
    assert checked_places(RobotOrder("A", at=(1.0, 2.0, 0.0)), FLOORS, []).floor == "L1"
    assert checked_places(RobotOrder("A", floor="L2", at=(1.0, 2.0, 0.0)), FLOORS, []).floor == "L2"
    assert checked_places(RobotOrder("A"), FLOORS, []).floor == ""
    with pytest.raises(InvalidChoice, match="no floor"):
        checked_places(RobotOrder("A", at=(0.0, 0.0, 0.0)), [], [])
    order = RobotOrder("A", "smartpal", ("--x", "-1"), "--help", (-1.5, 2.0, -0.25), "-c")
    module = robot_spec(order, Path("/state"), Address("127.0.0.1", 2809), 60.0).command
    assert isinstance(module, ModuleRun)
    command = module.arguments
    own, adaptors = command[: command.index("--")], command[command.index("--") + 1 :]
    assert adaptors == ("--x", "-1")
    assert {"--floor=--help", "--at=-1.5,2.0,-0.25", "--channel=-c", "--adaptor=smartpal"} <= set(own)
    output = ReadyLine("robot_A", ignored="http")
    for _ in range(2):
        with pytest.raises(NotReachable):
            output.probe()
        output("http://127.0.0.1:8800/")
        output("ready")
        output.probe()
    log = tmp_path / "a.log"
    assert last_lines(log, 5) == []
    log.write_bytes(b"4\n5\x00\n\xff6\n")
    (tmp_path / "a.log.1").write_text("1\n2\n3\n")
    assert last_lines(log, 2) == ["5\\x00", "\\xff6"]
    assert last_lines(log, 4) == ["3", "4", "5\\x00", "\\xff6"]
    assert last_lines(log, 100)[:3] == ["1", "2", "3"]
    assert last_lines(log, 0) == []
    large = tmp_path / "b.log"
    large.write_text("x" * 999_999 + "\nlast\n")
    assert last_lines(large, 500) == ["last"]  # only its end is read


def spec_of(script: str) -> Callable[[RobotOrder], ProcessSpec]:
    """Robots that run a script of Python."""

    def spec(order: RobotOrder) -> ProcessSpec:
        output = ReadyLine(order.process)
        return ProcessSpec(order.process, (sys.executable, "-S", "-c", script), Path.cwd(), output.probe, output, 60.0)

    return spec


def with_robots(
    script: str, test: Callable[[Robots], Awaitable[None]], note: Callable[[Robots], Any] = id, **more: Any
) -> None:
    """Run a test of robots that run a script, in an event loop. note: called with the robots after each change."""

    async def run() -> None:
        starter = Starter()
        robots = Robots(spec_of(script), starter, lambda: note(robots), **more)
        await test(robots)
        await robots.close()
        await until(lambda: robots.processes == [])
        await starter.close()

    asyncio.run(run())


WAITING = "import time; print('ready', flush=True); time.sleep(600)"


def test_robots_start_and_end() -> None:
    async def test(robots: Robots) -> None:
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

    with_robots(WAITING, test)


@pytest.mark.parametrize(
    ("script", "problem"),
    [
        ("raise SystemExit('no such floor')", "no such floor"),
        ("print('ready', flush=True); import time; time.sleep(0.5); raise SystemExit(3)", "exit code 3"),
    ],
)
def test_a_robot_that_ended_is_shown_until_it_is_forgotten(script: str, problem: str) -> None:
    async def test(robots: Robots) -> None:
        robots.start(RobotOrder("A"))
        await until(lambda: robots.processes[0].state == "ended")
        (process,) = robots.processes
        assert problem in process.problem and process.pid == 0 and process.restarts == 0
        robots.start(RobotOrder("A"))
        await until(lambda: robots.processes[0].state == "ended")
        robots.end("A")
        assert robots.processes == []

    with_robots(script, test)


def test_only_some_robots_start_at_a_time_and_they_are_started_again_if_wanted() -> None:
    noted: list[list[str]] = []

    def states(robots: Robots) -> list[str]:
        return [process.state for process in robots.processes]

    async def test(robots: Robots) -> None:
        process, *_ = [robots.start(RobotOrder(f"R{number}")) for number in range(6)]
        await until(lambda: states(robots) == ["running"] * 6)
        assert max(seen.count("starting") for seen in noted) == 2
        former = process.pid
        os.kill(former, signal.SIGKILL)
        await until(lambda: process.state == "running" and process.pid not in (0, former))
        assert process.restarts == 1

    with_robots(WAITING, test, lambda robots: noted.append(states(robots)), starting=2, restarts=True)


SAMPLES = Path(str(files("robocorba") / "samples"))
CHANNELS = ["main", "lab"]


def orders(folder: Path, content: Any) -> list[RobotOrder]:
    file = folder / "fleet.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return read_fleet(file)(FLOORS, CHANNELS)


def test_robots_of_files_and_groups(tmp_path: Path) -> None:
    found = read_fleet(SAMPLES / "fleet.yaml")(["L1", "L2"], ["main"])
    assert [order.name for order in found] == ["Courier", "Guide", *(f"Night{number}" for number in range(1, 5))]
    assert found[0].at == (17.0, 7.5, 1.57) and found[0].program == SAMPLES / "both-floors.json"
    assert {order.channel for order in found} == {"main"}
    assert [order.floor for order in found] == ["L1"] * 2 + ["L2"] * 4
    content = {
        "defaults": {"floor": "L2", "adaptor": "corba", "arguments": ["--x", "1"]},
        "robots": [{"name": "A"}, {"prefix": "B", "count": 2, "adaptor": "simulated", "arguments": []}],
    }
    first, *others = orders(tmp_path, content)
    assert first == RobotOrder("A", "corba", ("--x", "1"), "L2")
    assert others == [RobotOrder("B1", floor="L2"), RobotOrder("B2", floor="L2")]
    (placed,) = orders(tmp_path, {"robots": [{"name": "A", "at": [1, 2]}]})  # on the first floor
    assert (placed.floor, placed.at) == ("L1", (1.0, 2.0, 0.0))
    with pytest.raises(MapFileError, match="No such file"):
        read_fleet(tmp_path / "nix.yaml")
    robots: Sequence[dict[str, Any]] = [{"name": "A"}, {"prefix": "B", "count": 3}, {"name": "C", "floor": "L1"}]
    forward, backward = orders(tmp_path, {"robots": robots}), orders(tmp_path, {"robots": robots[::-1]})
    assert sorted(forward, key=lambda order: order.name) == sorted(backward, key=lambda order: order.name)
    for options, message in (
        ({"prefix": "a b", "count": 3}, "name: robots 'a b': 'a b1' is not"),
        ({"prefix": "R", "count": MAX_ROBOTS + 1}, "count: Expected `int` <= 200"),
        ({"prefix": "R", "count": 2, "program": "nix.json"}, "program: robots 'R': .*No such file"),
    ):
        with pytest.raises(InvalidFleet, match=message):
            group_of(options)
    assert len(group_of({"prefix": "R", "count": MAX_ROBOTS})(FLOORS, CHANNELS)) == MAX_ROBOTS


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("robots: [{name: A, flor: L1}]", r":1: robots\[0\]\.flor: robot 'A': there is no such key"),
        ("robots: [{name: A},\n {name: A}]", r":2: robots\[1\]\.name: robot 'A': A is the name of another robot too"),
        ("robots: [{prefix: A, count: 2}, {name: A2}]", r"robots\[1\]\.name: robot 'A2': A2 is the name of another"),
        ("robots: [{name: A, name: B}]", r"robots\[0\]\.name: given twice"),
        ("robots: [{name: A b}]", r"robots\[0\]\.name: robot 'A b': .* letters"),
        ("robots: [{name: A, floor: L9}]", r"robots\[0\]\.floor: robot 'A': there is no floor 'L9'; there are L1, L2"),
        ("robots: [{name: A, channel: nix}]", r"robots\[0\]\.channel: robot 'A': there is no channel 'nix'"),
        ("robots: [{name: A, floor: null}]", r"robots\[0\]\.floor: robot 'A': Expected `str`, got `null`"),
        ("robots: [{name: A, at: [1]}]", r"robots\[0\]\.at: robot 'A': Expected `array` of length >= 2"),
        ("robots: [{name: A, at: [1, .inf]}]", r"robots\[0\]\.at: robot 'A': inf is not a number"),
        ("robots: [{name: A, program: nix.json}]", r"robots\[0\]\.program: robot 'A': .*nix.json: No such file"),
        ("robots: [{name: A, program: fleet.yaml}]", r"robots\[0\]\.program: robot 'A': .*fleet.yaml: .*not JSON"),
        ("defaults: {adaptor: nix}\nrobots: [{name: A}]", r":1: defaults\.adaptor: robot 'A': 'nix' is not installed"),
        ("robots: [{name: A, count: 2}]", r"robots\[0\]\.count: robot 'A': a robot with a name is no group"),
        ("robots: [{prefix: A, count: 2, at: [1, 2]}]", r"robots\[0\]\.at: robots 'A': several robots can't start"),
        ("robots: [{prefix: A, count: 201}]", r"robots\[0\]\.count: robot 'A': Expected `int` <= 200"),
        ("robots: [{prefix: A}]", r"robots\[0\]: robots 'A': needs a name, or prefix and count"),
        ("robots: [{}]", r"robots\[0\]: a robot: needs a name, or prefix and count"),
        ("robots: [3]", r"robots\[0\]: Expected `object`, got `int`"),
        ("robots: []", r"robots: Expected `array` of length >= 1"),
        ("[]", "Expected `object`"),
        ("robots: [{prefix: A, count: 200}, {name: X}]", r"robots\[1\]: robot 'X': more than 200 robots"),
        ('robots: [{name: A, arguments: ["\\0"]}]', r"robots\[0\]\.arguments: robot 'A': contains a null character"),
        ("#" * 300_000, "larger than 256 KiB"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_key_and_the_robot(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(MapFileError, match=message) as wrong:
        orders(tmp_path, content)
    assert "\n" not in str(wrong.value)


anything = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 300) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
names = st.sampled_from(["A", "B", "A1", "A2", "x y", ""]) | st.text(max_size=70)
entries = st.fixed_dictionaries(
    {},
    optional={
        "name": names | anything,
        "prefix": names | anything,
        "count": st.integers(-1, 250) | anything,
        "at": st.lists(st.floats() | st.integers(), max_size=4) | anything,
        "floor": st.sampled_from(["L1", "L9"]) | anything,
        "channel": st.sampled_from(["main", "nix"]) | anything,
        "adaptor": st.sampled_from(["simulated", "nix"]) | anything,
        "arguments": st.lists(st.text(max_size=5), max_size=3) | anything,
        "flor": anything,
    },
)


@given(content=st.fixed_dictionaries({}, optional={"robots": st.lists(entries, max_size=4), "defaults": entries}))
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
def test_whatever_is_written_gives_orders_or_one_line(tmp_path: Path, content: Any) -> None:
    try:
        found = orders(tmp_path, content)
    except MapFileError as error:
        assert len(str(error).splitlines()) == 1
        return
    assert len({order.name for order in found}) == len(found) <= MAX_ROBOTS
    assert all(order.floor in ("", *FLOORS) and order.channel in ("", *CHANNELS) for order in found)
    assert len(found) == sum(1 if "name" in entry else int(entry["count"]) for entry in content["robots"])

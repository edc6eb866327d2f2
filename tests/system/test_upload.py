"""The paper's Figure 11 by uploaded programs: two actual robots on computers of their own hand over a sheet of paper,
while the link to the computer that has sent the programs is cut, five times."""

from __future__ import annotations

import contextlib
import csv
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

import numpy as np
import pytest

from robocorba.clients.hand_over import BUILDING, FLOOR, GIVER, START_POSES, TAKER
from robocorba.clients.hand_over_facts import Moment, facts, faults
from robocorba.map_editor.samples import sample_path
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.motion.robot_state import RobotState
from robocorba.system.supervision.launch import module_command
from testkit.namespaces import Namespace
from testkit.processes import ROBOCORBA, Launcher, drain, eventually, read_json
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.slow(180), pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = Path(str(files("robocorba") / "samples"))
FILES = {GIVER: SAMPLES / "hand-over-giver.json", TAKER: SAMPLES / "hand-over-taker.json"}
#: Addresses of the two computers, and the ports that others know.
PC, ROBOTS = "10.61.0.1", "10.61.0.2"
NAMING, CHANNEL = f"{PC}:2809", f"{ROBOTS}:2830"
AGENTS = {GIVER: f"{ROBOTS}:2831", TAKER: f"{ROBOTS}:2832"}
LIMIT_S, CUTS = 300.0, 5
#: What is read of the end of a file of ticks: more than two rows, of which it is asked often.
TAIL_BYTES = 8000


class Place(NamedTuple):
    """Two computers with a link. start: starts a command of `robocorba` on the robots' one and waits until it is
    ready."""

    pc: Namespace
    robots: Namespace
    folder: Path
    start: Callable[..., Popen[str]]
    adaptors: Mapping[str, tuple[str, ...]]

    def link(self, is_up: bool) -> None:
        self.pc.ip("link", "set", "eth0", "up" if is_up else "down")

    def robocorba(self, *command: str, on: Namespace | None = None, code: int = 0) -> str:
        """The output of a command, by default on the PC."""
        words = (on or self.pc).command(*module_command("robocorba"), *command, "--naming", NAMING)
        done = subprocess.run(words, capture_output=True, text=True, timeout=LIMIT_S, cwd=ROOT)
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr

    def reports(self, robot: str, since: str = "", on: Namespace | None = None) -> tuple[list[dict[str, Any]], str]:
        found = read_json(self.robocorba("program", "reports", robot, "--json", "--since", since, on=on))
        return found["reports"], found["next"]

    def agent(self, robot: str) -> Popen[str]:
        at = ("--floor", FLOOR, "--at", ",".join(map(str, START_POSES[robot])), "--channel", "hall")
        where = ("--endpoint", AGENTS[robot], "--naming", NAMING, "--state", str(self.folder / "agents"))
        record = ("--record", str(self.ticks(robot)))
        return self.start("robot", robot, "--agent-only", *at, *where, *record, "--adaptor", *self.adaptors[robot])

    def ticks(self, robot: str) -> Path:
        return self.folder / f"{robot}.csv"

    def icons_done(self, robot: str) -> int:
        """How far its program is, by what its computer has written."""
        with self.ticks(robot).open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - TAIL_BYTES))
            rows = file.read().decode().splitlines()[1:-1]  # the last one may be half written
        return int(rows[-1].split(",")[3]) if rows else 0


def seldom(condition: Callable[[], Any], what: str) -> Any:
    """As `eventually`, where each look is a process."""

    def after_a_pause() -> Any:
        pause(1.0)
        return condition()

    return eventually(after_a_pause, LIMIT_S, what)


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    try:
        pc, robots = Namespace(), Namespace()
    except OSError as error:
        pytest.skip(f"needs network namespaces: {error}")
    with pc, robots, Launcher(tmp_path) as launch:
        pc.ip("link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", robots.path)
        for computer, address in ((pc, PC), (robots, ROBOTS)):
            computer.ip("address", "add", f"{address}/24", "dev", "eth0")
            computer.ip("link", "set", "eth0", "up")

        def started(on: Namespace, *command: str) -> tuple[Popen[str], str]:
            """The process, and its line that begins with `ready`."""
            process = launch(*on.command(*command), PYTHONPATH=str(ROOT))
            assert process.stdout and process.stderr
            lines = (line.rstrip("\n") for line in process.stdout)
            ready = next((line for line in lines if line.startswith("ready")), None)
            assert ready is not None, process.stderr.read()
            drain(process)
            return process, ready

        def start(*command: str) -> Popen[str]:
            return started(robots, *module_command("robocorba"), *command)[0]

        options = ("--host", PC, "--naming-port", "2809", "--building", str(sample_path(BUILDING)), "--subnets", "lab")
        state = ("--state", str(tmp_path / "system"), "--start-limit", str(LIMIT_S), "--hang-limit", "60")
        started(pc, ROBOCORBA, "up", *options, *state)
        channel = ("--name", "hall", "--endpoint", CHANNEL, "--naming", NAMING, "--state", str(tmp_path / "hall"))
        drain(launch(*robots.command(*module_command("robocorba.servers.event_channel"), *channel)))
        _, ready = started(robots, *module_command("tests.system.robots_side"), str(tmp_path))
        adaptors = {
            robot: ("smartpal", "--", "--naming", naming)
            for robot, naming in zip((GIVER, TAKER), ready.split()[1:], strict=True)
        }
        yield Place(pc, robots, tmp_path, start, adaptors)


@pytest.mark.timeout(6 * LIMIT_S)
def test_the_paper_is_handed_over_while_the_link_is_cut_five_times(place: Place) -> None:
    agents = {robot: place.agent(robot) for robot in (GIVER, TAKER)}
    seldom(lambda: "hall" in place.robocorba("events", "stats"), "the robots' channel")

    # Refused before the run: what needs a server.
    needs = place.folder / "needs.json"
    needs.write_text('{"name": "x", "icons": [{"icon": "mbase_path", "floor": "L9", "x": 1, "y": 1}]}')
    refused = place.robocorba("program", "upload", str(needs), "--robot", GIVER, code=1)
    assert "icons[0].floor: an elevator ride needs the simulation server" in refused

    # By the robot's name, and by the address of its computer.
    assert "runs" in place.robocorba("program", "upload", str(FILES[TAKER]), "--robot", TAKER, "--run")
    assert "runs" in place.robocorba("program", "upload", str(FILES[GIVER]), "--robot", AGENTS[GIVER], "--run")
    for cut in range(CUTS):
        done = sum(map(place.icons_done, agents))
        place.link(False)
        eventually(lambda done=done: sum(map(place.icons_done, agents)) > done, LIMIT_S, "an icon without the link")
        if cut < CUTS - 1:
            place.link(True)
    assert "does not answer" in place.robocorba("program", "reports", AGENTS[GIVER], code=1)
    for robot, address in AGENTS.items():  # the last cut lasts until after both have ended
        eventually(lambda robot=robot: place.icons_done(robot) >= 10, LIMIT_S, f"most icons of {robot}")
        seldom(lambda at=address: place.reports(at, on=place.robots)[0], f"the end of {robot}")
    place.link(True)

    # Late, whole, and once.
    for robot in agents:
        seldom(lambda robot=robot: "upload" in place.robocorba("program", "reports", robot, "--json"), "a late report")
        (report,), following = place.reports(robot)
        assert (report["number"], report["upload"]) == (1, 1)
        program = report["program"]
        assert (program["name"], program["result"]) == (FILES[robot].stem, "done"), program
        assert program["icons_done"] >= 10 and program["seconds"] > 10.0
        assert place.reports(robot, following) == ([], following)
    assert faults(facts(moments(place))) == []

    # A kill of the agent: the report is there, the program is loaded, and what runs then ends as failed, once.
    _, following = place.reports(GIVER)
    wait = place.folder / "wait.json"
    wait.write_text(
        '{"name": "wait", "icons": [{"icon": "mbase_by", "ahead": -0.2}, {"icon": "wait", "seconds": 600}]}'
    )
    place.robocorba("program", "upload", str(wait), "--robot", GIVER, "--run")
    eventually(lambda: place.icons_done(GIVER) == 1, LIMIT_S)
    agents[GIVER].kill()
    agents[GIVER].wait()
    agents[GIVER] = place.agent(GIVER)
    (report,), following = place.reports(GIVER, following)
    program = report["program"]
    assert (report["number"], report["upload"], program["result"]) == (2, 2, "failed")
    assert (program["icon"], program["kind"], program["icons_done"]) == ("icons[1]", "wait", 1)
    assert place.reports(GIVER, following) == ([], following)
    # It is where it was, and can be stopped by the building's server, in which its body follows it.
    seldom(lambda: "stands" in output(place, "stop", GIVER), "a stop that is shown")
    agents[GIVER].kill()
    agents[GIVER].wait()
    agents[GIVER] = place.agent(GIVER)
    run = ("program", "run", str(wait), "--robot", GIVER)
    seldom(lambda: "is stopped" in output(place, *run, code=1), "the stop of before")
    place.robocorba("stop", GIVER, "--reset")
    for process in agents.values():
        process.send_signal(signal.SIGTERM)
        assert process.wait(LIMIT_S) == 0


def output(place: Place, *command: str, code: int = 0) -> str:
    with contextlib.suppress(AssertionError):  # the robot may not have logged on yet
        return place.robocorba(*command, code=code)
    return ""


def moments(place: Place) -> list[Moment]:
    """Both robots' states over time, from what their computers have recorded; they have one clock."""
    rows: dict[str, list[RobotState]] = {}
    for robot in (GIVER, TAKER):
        with place.ticks(robot).open(newline="") as source:
            rows[robot] = [
                RobotState(
                    *(float(row[name]) for name in ("time", "x", "y", "heading")),
                    joints=np.array([float(row[name]) for name in JOINTS]),
                )
                for row in csv.DictReader(source)
            ]
    begin = max(states[0].time for states in rows.values())
    times = {robot: [state.time for state in states] for robot, states in rows.items()}
    ends = sorted(time for found in times.values() for time in found[::2] if time >= begin)

    def at(robot: str, time: float) -> RobotState:
        return rows[robot][int(np.searchsorted(times[robot], time, "right")) - 1]

    return [Moment(time - begin, at(GIVER, time), at(TAKER, time)) for time in ends]

"""A program that is uploaded to an actual robot on a computer of its own runs there, while the link to the computer
that has sent it is cut, three times."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

import pytest

from robocorba.map_editor.samples import sample_path
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Event
from robocorba.system.supervision.launch import module_command
from testkit.namespaces import Namespace
from testkit.processes import ROBOCORBA, Launcher, drain, eventually, read_json
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.slow(90), pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
#: Addresses of the two computers, and the ports that others know.
PC, ROBOTS = "10.61.0.1", "10.61.0.2"
NAMING, CHANNEL, AGENT = f"{PC}:2809", f"{ROBOTS}:2830", f"{ROBOTS}:2831"
LIMIT_S, CUTS = 300.0, 3
#: What is read of the end of the file of ticks: more than two rows, of which it is asked often.
TAIL_BYTES = 8000


class Place(NamedTuple):
    """Two computers with a link. start: starts a command of `robocorba` on the robot's one and waits until it is
    ready. naming: of the robot itself."""

    pc: Namespace
    robots: Namespace
    folder: Path
    start: Callable[..., Popen[str]]
    naming: str

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

    def agent(self) -> Popen[str]:
        at = ("--floor", "L1", "--at", "4.9,4.5,0", "--channel", "hall")
        where = ("--endpoint", AGENT, "--naming", NAMING, "--state", str(self.folder / "agents"))
        record = ("--record", str(self.ticks))
        adaptor = ("--adaptor", "smartpal", "--", "--naming", self.naming)
        return self.start("robot", "A", "--agent-only", *at, *where, *record, *adaptor)

    @property
    def ticks(self) -> Path:
        return self.folder / "A.csv"

    def icons_done(self) -> int:
        """How far its program is, by what its computer has written."""
        with self.ticks.open("rb") as file:
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

        options = ("--host", PC, "--naming-port", "2809", "--building", str(sample_path("paper-scene")))
        state = ("--state", str(tmp_path / "system"), "--start-limit", str(LIMIT_S), "--hang-limit", "60")
        started(pc, ROBOCORBA, "up", *options, "--subnets", "lab", *state)
        channel = ("--name", "hall", "--endpoint", CHANNEL, "--naming", NAMING, "--state", str(tmp_path / "hall"))
        drain(launch(*robots.command(*module_command("robocorba.servers.event_channel"), *channel)))
        log = tmp_path / "hall" / "logs" / "events_hall.log"
        eventually(lambda: log.exists() and "bound RoboCorba/EventChannels/hall" in log.read_text(), LIMIT_S, "hall")
        _, ready = started(robots, *module_command("tests.system.robots_side"), str(tmp_path))
        yield Place(pc, robots, tmp_path, start, ready.split()[1])


@pytest.mark.timeout(6 * LIMIT_S)
def test_a_program_runs_while_the_link_is_cut_three_times(place: Place) -> None:
    visit = ProgramBuilder("visit").mbase_path("L1", 5.6, 3.6).say("there").wait_until(Event("there", "A"), 60.0)
    visit.mhand_posture("both", "carry").mbase_by(turn=0.5).mhand_posture("both", "tuck").mbase_by(turn=-0.5)
    visit.write(place.folder / "visit.json")
    agent = place.agent()

    # Refused before the run: what needs a server. By the address of its computer, and below by the robot's name.
    needs, wait = place.folder / "needs.json", place.folder / "wait.json"
    ProgramBuilder("x").mbase_path("L9", 1, 1).write(needs)
    refused = place.robocorba("program", "upload", str(needs), "--robot", AGENT, code=1)
    assert "icons[0].floor: an elevator ride needs the simulation server" in refused
    upload = ("program", "upload", str(place.folder / "visit.json"), "--robot", AGENT, "--run")
    assert "runs" in place.robocorba(*upload)
    for cut in range(CUTS):
        done = place.icons_done()
        place.link(False)
        eventually(lambda done=done: place.icons_done() > done, LIMIT_S, "an icon without the link")
        if cut < CUTS - 1:
            place.link(True)
    assert "does not answer" in place.robocorba("program", "reports", AGENT, code=1)
    # The last cut lasts until after its end; the report is late, whole, and there once.
    seldom(lambda: place.reports(AGENT, on=place.robots)[0], "the end of the program")
    place.link(True)
    (report,), following = seldom(lambda: (found := place.reports("A"))[0] and found, "a late report")
    assert (report["number"], report["upload"]) == (1, 1)
    program = report["program"]
    assert (program["name"], program["result"], program["icons_done"]) == ("visit", "done", 7), program
    assert program["seconds"] > 5.0

    # A kill of the agent: the report is there, the program is loaded, and what runs then ends as failed, once.
    ProgramBuilder("wait").mbase_by(ahead=-0.2).wait(600.0).write(wait)
    place.robocorba("program", "upload", str(wait), "--robot", "A", "--run")
    eventually(lambda: place.icons_done() == 1, LIMIT_S)
    agent.kill()
    agent.wait()
    agent = place.agent()
    (report,), following = place.reports("A", following)
    program = report["program"]
    assert (report["number"], report["upload"], program["result"]) == (2, 2, "failed")
    assert (program["icon"], program["kind"], program["icons_done"]) == ("icons[1]", "wait", 1)
    assert place.reports("A", following) == ([], following)
    # It is where it was, and can be stopped by the building's server, in which its body follows it.
    seldom(lambda: "stands" in output(place, "stop", "A"), "a stop that is shown")
    agent.kill()
    agent.wait()
    agent = place.agent()
    run = ("program", "run", str(wait), "--robot", "A")
    seldom(lambda: "is stopped" in output(place, *run, code=1), "the stop of before")
    place.robocorba("stop", "A", "--reset")
    agent.send_signal(signal.SIGTERM)
    assert agent.wait(LIMIT_S) == 0


def output(place: Place, *command: str, code: int = 0) -> str:
    with contextlib.suppress(AssertionError):  # the robot may not have logged on yet
        return place.robocorba(*command, code=code)
    return ""

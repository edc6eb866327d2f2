"""The whole system while the wall clocks of its processes are wrong, or are set: leases, programs, events, edits and
missions go on as without."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from robocorba.errors.events import Unconfirmed
from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.mission_record import MissionResult
from robocorba.stubs import RoboCorba
from testkit.missions import FLOOR, MissionSystem, RobotStart, save_three_rooms
from testkit.processes import ROBOCORBA, Launcher, Running, eventually, forked_processes, running_system
from testkit.simulation import GONE

pytestmark = [pytest.mark.system, pytest.mark.full, pytest.mark.slow(80)]

SOURCE = Path(__file__).with_name("wrong_clock.c")
HOUR_S, YEAR_S = 3600.0, 365 * 86400.0
#: How far a clock is set, or is ahead [s].
JUMPS_S = (HOUR_S, -YEAR_S)
#: Timeout of what takes a second or two [s].
LIMIT_S = 120.0
SERVERS = ("omniNames", "map_editor", "simulation", "sensor_s1", "events_lab", "events_hall", "console")
#: E leads, F carries the desk with it, and A leaves it alone; how far the clocks are ahead when they start [s].
ROBOTS = {
    "E": (RobotStart(0.7, 6.6, 0.0, "lab"), YEAR_S),
    "F": (RobotStart(3.8, 8.4, math.pi, "hall"), -YEAR_S),
    "A": (RobotStart(0.7, 1.0, 0.0, "lab"), -HOUR_S),
}
#: Where the desk may stand [m].
GOALS_X_M = (2.6, 2.2)
SHORT = dumps(ProgramBuilder("short").mbase_velocity(0.0, 0.0, 0.5, 0.4).program())


class Clocks:
    """How far the clocks of processes are ahead; see wrong_clock.c."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def set(self, pid: int, ahead_s: float) -> None:
        self._write(str(pid), ahead_s)

    def set_others(self, ahead_s: float) -> None:
        """Set the clocks of all processes that have not been set, also of those to be started."""
        self._write("all", ahead_s)

    def _write(self, name: str, ahead_s: float) -> None:
        new = self._folder / "new"
        new.write_text(str(ahead_s))
        new.replace(self._folder / name)


@contextlib.contextmanager
def wrong_clocks(folder: Path) -> Iterator[Clocks]:
    """The clocks of the processes that are started inside the `with`."""
    library, clocks = folder / "wrong_clock.so", folder / "clocks"
    clocks.mkdir()
    try:
        command = ("cc", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o", str(library), str(SOURCE))
        subprocess.run(command, check=True)
    except FileNotFoundError:
        pytest.skip("no C compiler is installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LD_PRELOAD", str(library))
        patch.setenv("CLOCKS", str(clocks))
        patch.setattr(Launcher, "nursery", None)  # its forks would have the right clock
        with forked_processes():
            yield Clocks(clocks)


class Place(MissionSystem):
    """The system, a client of it whose clock is right, and what each process of it does."""

    def __init__(self, folder: Path, running: Running, orb: Orb, launch: Launcher, clocks: Clocks) -> None:
        super().__init__(folder, running, orb, launch)
        self.clocks = clocks
        self._editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        self._planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        self._lab, hall = (EventClient(orb, name, "user", timeout_s=LIMIT_S) for name in ("lab", "hall"))
        self._events: list[Event] = []
        self._subscription = hall.subscribe(self._events.append, "t")
        self._numbers = itertools.count()

    def end(self) -> None:
        self._subscription.end()
        super().end()

    def pid(self, name: str) -> int:
        if name == "up":
            return self.running.process.pid
        return self.robots[name].pid if name in self.robots else self.running.pid(name)

    def restart(self, name: str, ahead_s: float) -> None:
        """Kill a server, which `up` starts again on a machine whose clock is ahead."""
        self.clocks.set_others(ahead_s)
        before = self.kill_server(name)
        eventually(lambda: self.is_back(name, before), LIMIT_S, f"another {name}")
        self.clocks.set(self.pid(name), ahead_s)
        self.clocks.set_others(0.0)

    def log_ons(self) -> dict[str, float]:
        """When each robot has logged on; empty while the simulation server is away."""
        with contextlib.suppress(*GONE):
            return {client.name: client.since for client in self.server.clients()}
        return {}

    def check_event(self) -> None:
        """An event arrives in the other sub-network: it has not expired."""
        number = next(self._numbers)
        eventually(lambda: self._has_pushed(number), LIMIT_S, "a push")
        eventually(lambda: any(event.payload == number for event in list(self._events)), LIMIT_S, f"event {number}")

    def check_servers(self) -> None:
        """An event arrives, an edit is planned with, and the console serves its page."""
        self.check_event()
        eventually(self._has_edited, LIMIT_S, "an edit")
        eventually(self._is_served, LIMIT_S, "the console's page")

    def drive(self) -> None:
        """A robot does a program to its end; once more where an answer was lost: its clock, set, ends connections."""
        agent = self.agent("A")

        def result() -> ProgramResult | None:
            with contextlib.suppress(NotReachable, IllegalOrder):
                agent.load(SHORT)
                agent.run()
                eventually(lambda: agent.state().program.result is not ProgramResult.NO_RESULT, LIMIT_S, "its end")
                return agent.state().program.result
            return None

        assert eventually(result, LIMIT_S, "the program's end") is ProgramResult.DONE

    def status(self) -> list[dict[str, Any]]:
        """What `robocorba status` prints of each process."""
        process = self._launch(ROBOCORBA, "status", "--json", "--state", str(self.running.state))
        out, err = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0, err
        return json.loads(out)["processes"]

    def _has_pushed(self, number: int) -> bool:
        with contextlib.suppress(Unconfirmed, NotReachable, *GONE):
            self._lab.push("t", number, expiry_s=LIMIT_S)
            return True
        return False

    def _has_edited(self) -> bool:
        number = next(self._numbers)
        ends = (RoboCorba.XY(9.5, 4.5), RoboCorba.XY(9.5, 4.9))
        with contextlib.suppress(*GONE):
            self._editor.create(FLOOR, RoboCorba.Element(aWall=RoboCorba.Wall(f"new-{number}", *ends, 2.0)))
            return bool(self._planner.getPath(RoboCorba.Point(FLOOR, 7.0, 1.0), RoboCorba.Point(FLOOR, 9.0, 1.0)))
        return False

    def _is_served(self) -> bool:
        endpoint = next(each.endpoint for each in self.running.record().processes if each.name == "console")
        with contextlib.suppress(OSError), urllib.request.urlopen(f"http://{endpoint}/", timeout=5.0) as page:
            return b"RoboCorba" in page.read()
        return False

    @contextlib.contextmanager
    def carried(self) -> Iterator[None]:
        """A mission that is carried out meanwhile, ends well, and is listed with the time that it took."""
        began = time.monotonic()
        goal_x_m = next(x_m for x_m in GOALS_X_M if abs(self.body("desk").x - x_m) > 0.2)
        user = self.mission("E", "desk", f"{FLOOR}:{goal_x_m},7.6")
        self.at_phase("E", "gathering", user)  # before, it fails where a server is away
        name = self.led_by("E")
        yield
        code, out, err = self.outcome(user)
        assert code == 0, (out, err)
        content = self.ended(name)
        assert (content.result, content.phases[-1].name) == (MissionResult.DONE, "backing off")
        took_s = time.monotonic() - began
        assert 0.0 < content.ended - content.begun < took_s
        assert all(0.0 <= phase.ended - phase.begun < took_s for phase in content.phases)


def set_clocks(place: Place) -> None:
    """Of each process in turn, while it runs."""
    since = eventually(place.log_ons, LIMIT_S, "log-ons")
    with ThreadPoolExecutor(1) as robot:
        for name in (*SERVERS, "up", *place.robots):
            program = robot.submit(place.drive)
            for ahead_s in (*JUMPS_S, 0.0):
                place.clocks.set(place.pid(name), ahead_s)
                place.check_event()
            place.check_servers()
            program.result(LIMIT_S)
            eventually(lambda since=since: place.log_ons() == since, LIMIT_S, f"the log-ons of before, {name}")
    place.clocks.set_others(YEAR_S)  # of `robocorba status`
    assert {(each["state"], 0.0 < each["uptime_s"] < HOUR_S) for each in place.status()} == {("running", True)}
    place.clocks.set_others(0.0)


def restart_with_wrong_clocks(place: Place) -> None:
    """Each server in turn; robots stay logged on."""
    steps = itertools.cycle(JUMPS_S)
    for name in SERVERS:
        since = eventually(place.log_ons, LIMIT_S, "log-ons")
        place.restart(name, next(steps))
        place.check_servers()
        eventually(lambda before=since: place.log_ons() == before, LIMIT_S, "the same log-ons")
        eventually(lambda: place.is_free("A"), LIMIT_S, "A has its session")
        place.drive()


@pytest.mark.timeout(1800)
def test_all_goes_on_with_clocks_that_are_wrong_and_set(tmp_path: Path) -> None:
    """The leader's computer is a year ahead when it starts, and its member's a year behind."""
    more = ("--building", str(save_three_rooms(tmp_path)), "--subnets", "lab,hall", "--console", "--console-port", "0")
    with (
        wrong_clocks(tmp_path) as clocks,
        running_system(tmp_path, *more, "--sensors", "1") as (running, launch),
        Orb(running.naming, call_timeout_s=5.0) as orb,
        Place(tmp_path, running, orb, launch, clocks) as place,
    ):
        for name in (*SERVERS, "up"):
            clocks.set(place.pid(name), 0.0)
        for name, (start, ahead_s) in ROBOTS.items():
            clocks.set_others(ahead_s)
            place.start({name: start})
            clocks.set(place.pid(name), ahead_s)
        clocks.set_others(0.0)
        with place.carried():
            set_clocks(place)
            restart_with_wrong_clocks(place)

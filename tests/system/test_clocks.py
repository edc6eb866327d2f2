"""The whole system while the wall clocks of its processes are wrong, or are set: leases, programs, events, edits and
missions go on as without.

ROBOCORBA_ALL_CLOCKS=1 does a mission for each step of the clocks, over all processes, while they run and between
restarts; otherwise one mission sees all steps."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import time
import urllib.request
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from robocorba.control.agent_state import ProgramResult
from robocorba.corba.event_client import Event, EventClient
from robocorba.corba.orb import Orb
from robocorba.errors.events import Unconfirmed
from robocorba.errors.services import NotReachable
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import dumps
from robocorba.simulation.mission_record import MissionResult
from robocorba.stubs import RoboCorba
from robocorba.testing.missions import FLOOR, MissionSystem, RobotStart, save_three_rooms
from robocorba.testing.processes import ROBOCORBA, Launcher, Running, eventually, running_system
from robocorba.testing.simulation import GONE
from tests.system.wrong_clocks import HOUR_S, JUMPS_S, YEAR_S, Clocks, wrong_clocks

pytestmark = [pytest.mark.system, pytest.mark.full, pytest.mark.slow]

#: Timeout of what takes a second or two [s].
LIMIT_S = 60.0
SERVERS = ("omniNames", "map_editor", "simulation", "sensor_s1", "events_lab", "events_hall", "console")
#: Who carries the desk, which A leaves alone; the leader first.
CREW = {"E": RobotStart(0.7, 6.6, 0.0, "lab"), "F": RobotStart(3.8, 8.4, math.pi, "hall")}
ALONE = {"A": RobotStart(0.7, 1.0, 0.0, "lab")}
#: Where the desk may stand [m].
GOALS_X_M = (2.6, 2.2)
SHORT = dumps(ProgramBuilder("short").mbase_velocity(0.0, 0.0, 0.5, 0.4).program())
DOES_ALL = os.environ.get("ROBOCORBA_ALL_CLOCKS") == "1"


class Place:
    """The system, a client of it whose clock is right, and what each process of it does."""

    def __init__(self, missions: MissionSystem, running: Running, launch: Launcher, clocks: Clocks) -> None:
        self.missions, self.running, self.clocks, self._launch = missions, running, clocks, launch
        self._editor = missions.orb.resolve("MapEditor", RoboCorba.MapEditor)
        self._planner = missions.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        self._lab, hall = (EventClient(missions.orb, name, "user", timeout_s=LIMIT_S) for name in ("lab", "hall"))
        self._events: list[Event] = []
        self._subscription = hall.subscribe(self._events.append, "t")
        self._numbers = itertools.count()

    def close(self) -> None:
        self._subscription.end()

    def pid(self, name: str) -> int:
        """Of a server, a robot, or `up` itself."""
        if name == "up":
            return self.running.process.pid
        return self.missions.robots[name].pid if name in self.missions.robots else self.running.pid(name)

    @property
    def names(self) -> tuple[str, ...]:
        return (*SERVERS, "up", *self.missions.robots)

    def kill(self, name: str, ahead_s: float) -> None:
        """Kill a server, which `up` starts again on a machine whose clock is ahead."""
        self.clocks.set_others(ahead_s)
        before = self.missions.kill_server(name)
        eventually(lambda: self.missions.is_back(name, before), LIMIT_S, f"another {name}")
        self.clocks.set(self.pid(name), ahead_s)
        self.clocks.set_others(0.0)

    def restart_robots(self, ahead_s: float) -> None:
        """Where they are: the leader with a clock that is ahead, its member with one that is behind."""
        for name, by_s in (("E", ahead_s), ("F", -ahead_s), ("A", 0.0)):
            at = self.missions.body(name)
            self.missions.kill(name)
            self.clocks.set_others(by_s)
            self.missions.start({name: RobotStart(*at, {**CREW, **ALONE}[name].channel)})
            self.clocks.set(self.missions.robots[name].pid, by_s)
        self.clocks.set_others(0.0)

    def log_ons(self) -> dict[str, float]:
        """When each robot has logged on; empty while the simulation server is away."""
        with contextlib.suppress(*GONE):
            return {client.name: client.since for client in self.missions.server.clients()}
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
        """A robot does a program to its end."""
        agent = self.missions.agent("A")
        agent.load(SHORT)
        agent.run()
        eventually(lambda: agent.state().program.result is not ProgramResult.NO_RESULT, LIMIT_S, "the program's end")
        assert agent.state().program.result is ProgramResult.DONE

    def status(self) -> list[dict[str, Any]]:
        """What `robocorba status` prints of each process."""
        process = self._launch(ROBOCORBA, "status", "--json", "--state", str(self.running.state))
        out, err = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0, err
        found: list[dict[str, Any]] = json.loads(out)["processes"]
        return found

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
    def mission(self) -> Iterator[None]:
        """A mission that is carried out meanwhile, ends well, and is listed with the time that it took."""
        began = time.monotonic()
        goal_x_m = next(x_m for x_m in GOALS_X_M if abs(self.missions.body("desk").x - x_m) > 0.2)
        user = self.missions.mission("E", "desk", f"{FLOOR}:{goal_x_m},7.6")
        self.missions.at_phase("E", "gathering", user)  # before, it fails where a server is away
        yield
        code, out, err = self.missions.outcome(user)
        assert code == 0, (out, err)
        content = self.missions.control.missions_since(0)[-1].content
        assert (content.result, content.phases[-1].name) == (MissionResult.DONE, "backing off")
        took_s = time.monotonic() - began
        assert 0.0 < content.ended - content.begun < took_s
        assert all(0.0 <= phase.ended - phase.begun < took_s for phase in content.phases)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """A running system; the leader's computer is a year ahead when it starts, and its member's a year behind."""
    folder = tmp_path_factory.mktemp("clocks")
    more = ("--building", str(save_three_rooms(folder)), "--subnets", "lab,hall", "--console", "--console-port", "0")
    with (
        wrong_clocks(folder) as clocks,
        running_system(folder, *more, "--sensors", "1") as (running, launch),
        Orb(running.naming, call_timeout_s=5.0) as orb,
        MissionSystem(folder, running, orb, launch) as missions,
    ):
        for name in (*SERVERS, "up"):
            clocks.set(running.process.pid if name == "up" else running.pid(name), 0.0)
        for name, ahead_s in (("E", YEAR_S), ("F", -YEAR_S), ("A", -HOUR_S)):
            clocks.set_others(ahead_s)
            missions.start({name: {**CREW, **ALONE}[name]})
            clocks.set(missions.robots[name].pid, ahead_s)
        clocks.set_others(0.0)
        with contextlib.closing(Place(missions, running, launch, clocks)) as place:
            yield place


def set_clocks(place: Place, steps_s: Sequence[float]) -> None:
    """Of each process in turn, while it runs."""
    since = place.log_ons()
    with ThreadPoolExecutor(1) as robot:
        for name in place.names:
            program = robot.submit(place.drive)
            for ahead_s in (*steps_s, 0.0):
                place.clocks.set(place.pid(name), ahead_s)
                place.check_event()
            place.check_servers()
            program.result(LIMIT_S)
            assert place.log_ons() == since, name
    place.clocks.set_others(YEAR_S)  # of `robocorba status`
    assert {(each["state"], 0.0 < each["uptime_s"] < HOUR_S) for each in place.status()} == {("running", True)}
    place.clocks.set_others(0.0)


def restart_with_wrong_clocks(place: Place, steps_s: Sequence[float]) -> None:
    """Each server in turn; robots stay logged on."""
    steps = itertools.cycle(steps_s)
    for name in SERVERS:
        since = place.log_ons()
        place.kill(name, next(steps))
        place.check_servers()
        eventually(lambda before=since: place.log_ons() == before, LIMIT_S, "the same log-ons")
        eventually(lambda: place.missions.is_free("A"), LIMIT_S, "A has its session")
        place.drive()


def test_all_goes_on_with_clocks_that_are_wrong_and_set(place: Place) -> None:
    with place.mission():
        set_clocks(place, JUMPS_S)
        restart_with_wrong_clocks(place, JUMPS_S)


if DOES_ALL:

    @pytest.mark.parametrize("ahead_s", JUMPS_S)
    def test_all_goes_on_while_clocks_are_set(place: Place, ahead_s: float) -> None:
        with place.mission():
            set_clocks(place, (ahead_s,))

    @pytest.mark.parametrize("ahead_s", JUMPS_S)
    def test_all_goes_on_over_restarts_with_wrong_clocks(place: Place, ahead_s: float) -> None:
        place.restart_robots(ahead_s)
        with place.mission():
            restart_with_wrong_clocks(place, (ahead_s,))

"""A running system whose every interface is called."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omniORB import CORBA

from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.simulation.sensor_admission import proof_of
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.names import CHANNELS, ROBOTS, SENSOR_TOKEN, SENSORS
from testkit.actual_robot import StandIn, running_stand_in
from testkit.buildings import two_floors
from testkit.fuzzing.examples import OTHER, OURS, ROBOT, TEXTS
from testkit.fuzzing.values import Seen
from testkit.heartbeats import heartbeats
from testkit.processes import Running, eventually, running_system
from testkit.simulation import about

#: Time limit for the start of a robot [s].
START_LIMIT_S = 180.0
#: Time limit for a place of a robot that is to log on; sessions that nobody uses expire after two seconds [s].
PLACE_LIMIT_S = 60.0


class _Consumer(RoboCorba__POA.EventConsumer):
    """A consumer that takes whatever arrives."""

    push = pushRuns = pushTogether = disconnect_push_consumer = lambda self, *arguments: None


class FuzzedSystem:
    """A running system with two channels, two robots, one sensor server, and a stand-in for an actual robot. A thread
    keeps the session of a third robot. numbers: of the further robots that log on."""

    def __init__(self, running: Running, orb: Orb, stand_in: StandIn | None = None) -> None:
        self.running, self.orb, self.stand_in = running, orb, stand_in
        self.editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        self.planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        self.server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        self.database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        self.control = orb.resolve("MissionControl", RoboCorba.MissionControl)
        self.supervisor = orb.reference((running.state / "supervisor.ior").read_text(), RoboCorba.Supervisor)
        self.sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
        self.channel = orb.resolve(f"{CHANNELS}/a", RoboCorba.EventChannel)
        ior = (running.state / "administrator.ior").read_text()
        self.administrator = orb.reference(ior, RoboCorba.SimulationAdministrator)
        for number, name in enumerate((ROBOT, OTHER)):
            order = RoboCorba.RobotOrder(name, "simulated", [], "L1", True, 3.0 + 3 * number, 3.0, 0.0, "a")
            self.supervisor.startRobot(order)
        eventually(self._are_ready, START_LIMIT_S, "the robots")
        self.agent = orb.resolve(f"{ROBOTS}/{ROBOT}", RoboCorba.RobotAgent)
        self.consumer = orb.activate(_Consumer())
        dead = orb.reference("corbaloc::127.0.0.1:9/nobody", RoboCorba.EventConsumer)
        references = [self.consumer, dead, self.server, self.channel, self.sensor, self.agent]
        self.seen = Seen(TEXTS, references)
        self.numbers = itertools.count()
        self._session: Any = None
        self._heartbeats = heartbeats(lambda: filter(None, [self._session]))
        self.before = self.processes()

    def close(self) -> None:
        self._heartbeats.close()

    def processes(self) -> dict[str, tuple[int, int]]:
        """Process id and number of restarts of each process of the system."""
        found = {one.name: (one.processId, one.restarts) for one in self.supervisor.processes()}
        return {name: one for name, one in found.items() if not name.startswith("robot_") or name[6:] in (ROBOT, OTHER)}

    def ended(self) -> set[str]:
        """The processes that have another process id or more restarts than at the start, or are gone."""
        now = self.processes()
        return {name for name, one in self.before.items() if now.get(name) != one}

    def _are_ready(self) -> bool:
        robots = [one for one in self.supervisor.processes() if one.name.startswith("robot_")]
        return len(robots) == 2 and all(one.phase == RoboCorba.PROCESS_READY for one in robots)

    def session(self) -> Any:
        """The session of our robot, a new one if it has ended."""
        try:
            self._session.heartbeat()
        except (AttributeError, CORBA.SystemException):
            self._session = self.new_session(OURS)
        return self._session

    def new_session(self, name: str = "") -> Any:
        """The session of a robot that logs on now, as soon as there is a place: earlier ones may have to expire."""
        name = name or f"f{next(self.numbers)}"
        places = [(x, y) for y in (8.0, 6.5, 1.5) for x in range(2, 16, 2)]

        def log_on() -> Any:
            for x, y in places:
                with contextlib.suppress(RoboCorba.PlaceTaken):
                    return self.server.registerRobot(about(name, float(x), y))
            return None

        return eventually(log_on, PLACE_LIMIT_S, "place for a robot")

    def registration(self) -> Any:
        """A registration of the sensor server under a second name."""
        token = (self.running.state / SENSOR_TOKEN).read_text().strip()
        proof = proof_of(token, "fuzz", self.orb.uri(self.sensor))
        return self.server.registerSensor("fuzz", self.sensor, proof)

    def by_key(self, key: str, interface: Any) -> Any:
        """An object of channel a by its key, such as feed."""
        endpoint = next(one.endpoint for one in self.running.record().processes if one.name == "events_a")
        return self.orb.reference(f"corbaloc:iiop:1.2@{endpoint}/{CHANNELS}/a/{key}", interface)

    def unit(self, name: str, interface: Any) -> Any:
        """A unit of the stand-in."""
        assert self.stand_in
        return self.stand_in.unit(name, interface)

    def proxy(self, kind: str, interface: Any) -> Any:
        """A fresh proxy of channel a."""
        admin = self.channel.for_suppliers() if kind.endswith("consumer") else self.channel.for_consumers()
        return getattr(admin, f"obtain_{kind}")()._narrow(interface)


@contextlib.contextmanager
def fuzzed_system(folder: Path) -> Iterator[FuzzedSystem]:
    """A system whose logs are in folder/state/logs, until the end of the `with`."""
    native.save(two_floors(), folder / "two-floors.yaml")
    with (
        running_system(folder, "--building", "two-floors.yaml", "--subnets", "a,b", "--hang-limit", "0") as (
            running,
            _,
        ),
        Orb(running.naming, call_timeout_s=30.0) as orb,
        running_stand_in(folder / "actual", orb=orb) as stand_in,
        contextlib.closing(FuzzedSystem(running, orb, stand_in)) as system,
    ):
        yield system

"""A running simulation for tests and benches, with robots, an administrator, and kills of the processes involved."""

from __future__ import annotations

import contextlib
import math
import random
import re
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

import msgspec
from omniORB import CORBA

from robocorba.map_editor.corba import maps
from robocorba.map_editor.geometry import landing_line
from robocorba.map_editor.model import Elevator
from robocorba.map_editor.spatial.floor_update import FloorUpdate, FloorView
from robocorba.map_editor.spatial.pose import XY
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_database import changes
from robocorba.stubs import RoboCorba
from testkit.heartbeats import heartbeats
from testkit.json_process import checkout_command
from testkit.processes import Launcher, Running, eventually, running_system

#: Time within which a dead robot's name, place and slot are free again [s].
RELEASE_LIMIT_S = 3.0
#: Time before a kill whose poses may be lost [s].
LOST_S = 0.2
#: Time limit of a call [s]: a picture takes long on a machine that is busy with something else.
CALL_LIMIT_S = 60.0
#: Exceptions of a call whose server died or is restarting.
GONE = (CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT)
STAND = RoboCorba.Velocity(0.0, 0.0, 0.0)
NO_MOUNT = RoboCorba.Mount(0.0, 0.0, 0.0)
NO_NOISE = RoboCorba.ScanNoise(0.0, 0.0, 0.0, 0)
#: Motion limits of test robots [m/s, rad/s, m/s^2, rad/s^2].
LIMITS = (1.0, 2.0, 2.0, 4.0)
RADIUS_M = 0.3
#: Four rays: ahead, to the left, to the back, to the right.
CROSS = RoboCorba.ScanSpec(0.0, math.pi / 2, 4, 30.0, 0.0, NO_NOISE)


def about(
    name: str,
    x: float,
    y: float,
    heading: float = 0.0,
    floor: str = "L1",
    radius: float = RADIUS_M,
    mass: float = 50.0,
    limits: tuple[float, float, float, float] = LIMITS,
) -> Any:
    """Build a RobotDescription."""
    start = RoboCorba.Pose(floor, x, y, heading)
    return RoboCorba.RobotDescription(name, start, radius, mass, RoboCorba.MotionLimits(*limits))


@contextlib.contextmanager
def simulation(folder: Path, sensors: int = 2) -> Iterator[Place]:
    """`robocorba up` with the sample building and `sensors` virtual sensor servers; one at a time in a process."""
    with (
        running_system(folder, "--sensors", str(sensors)) as (running, launch),
        Orb(running.naming, call_timeout_s=CALL_LIMIT_S) as orb,
        contextlib.closing(Place(running, orb, launch)) as place,
    ):
        yield place


class RemoteFloor:
    """Local copy of a floor of `database`, a RoboCorba::OmniDatabase. Not thread-safe."""

    def __init__(self, database: Any, floor: str) -> None:
        self._database = database
        self.view = FloorView(floor)

    def follow(self) -> FloorUpdate:
        """Update `view`: the first time by the whole floor, later by changes. Returns the update.

        Raises UnknownFloor, NotReachable."""
        update = changes(self._database, self.view.floor, self.view.version)
        self.view.apply(update)
        return update


class Place:
    """The simulation of a running system, and the robots of this process; a thread sends their heartbeats."""

    def __init__(self, running: Running, orb: Orb, launch: Launcher) -> None:
        self.running, self.orb, self.launch = running, orb, launch
        self.pid, self.kill, self.is_again = running.pid, running.kill, running.is_again
        self.server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        self.database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        self.editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        self.administrator = orb.reference(
            (running.state / "administrator.ior").read_text(), RoboCorba.SimulationAdministrator
        )
        self._sessions: list[Any] = []
        self._heartbeats = heartbeats(lambda: self._sessions)

    def close(self) -> None:
        self._heartbeats.close()

    # ---- robots ----

    def log_on(self, name: str, x: float, y: float, *more: Any, **others: Any) -> Any:
        """Log a robot on until `let_go`; arguments as those of `about`. Returns its session."""
        session = self.server.registerRobot(about(name, x, y, *more, **others))
        self._sessions.append(session)
        return session

    def let_go(self) -> None:
        """Log all robots of this process off."""
        while self._sessions:
            with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):
                self._sessions.pop().deregister()

    @property
    def names(self) -> set[str]:
        """Names of all logged-on robots."""
        return {client.name for client in self.server.clients()}

    # ---- floors ----

    def elevator(self, floors: int = 2) -> Elevator:
        """The fastest elevator that serves at least `floors` floors."""
        found = [maps.element_of(one.value) for one in self.editor.elements(RoboCorba.ELEVATOR_ELEMENT, "")]
        fit = [one for one in found if isinstance(one, Elevator) and len(one.floors()) >= floors]
        return max(fit, key=lambda one: one.speed)

    def body(self, floor: str, name: str) -> Any:
        """The row of MOTION of a body on a floor; None if it is not there."""
        copy = RemoteFloor(self.database, floor)
        copy.follow()
        number = next((number for number, body in copy.view.bodies.items() if body.name == name), None)
        return None if number is None else copy.view.motion(number)

    def remove_outlines(self, *floors: str) -> None:
        """Let floors have no bounds, so that robots have room outside of the building."""
        for floor in floors:
            found = self.editor.read(RoboCorba.ElementId(RoboCorba.FLOOR_ELEMENT, "", floor))
            unbounded = found.value._v
            unbounded.outline = []
            version = self.editor.change("", RoboCorba.Element(aFloor=unbounded), found.changedAt)
        eventually(lambda: self.server._get_state().mapVersion >= version, what="floors without bounds")

    # ---- processes ----

    def endpoint(self, name: str) -> str:
        return next(process.endpoint for process in self.running.record().processes if process.name == name)


def landing(elevator: Elevator, floor: str, away_m: float) -> XY:
    """A point in front of an elevator's doors on a floor, or inside the cabin for a negative `away_m`."""
    door = next(door for door in elevator.doors if door.floor == floor)
    (ax, ay), (bx, by) = landing_line(elevator, door).coords
    x, y = (ax + bx) / 2, (ay + by) / 2
    along = (by - ay, ax - bx)
    is_outward = (x - elevator.at[0]) * along[0] + (y - elevator.at[1]) * along[1] > 0
    share = (1 if is_outward else -1) * away_m / math.hypot(*along)
    return x + share * along[0], y + share * along[1]


def drive_to(session: Any, to: XY, speed: float = 1.0, near_m: float = 0.05, limit_s: float = 60.0) -> Any:
    """Drive a robot straight to a point, until it stands there; return its state."""

    def has_come() -> Any:
        state = session.state()
        dx, dy = to[0] - state.at.x, to[1] - state.at.y
        away, c, s = math.hypot(dx, dy), math.cos(state.at.heading), math.sin(state.at.heading)
        if away <= near_m:
            session.command(STAND, 0.0)
            return state if speed_of(state) < 0.001 else None
        share = min(speed, 2.0 * away) / away
        session.command(RoboCorba.Velocity((c * dx + s * dy) * share, (c * dy - s * dx) * share, 0.0), 0.5)
        return None

    return eventually(has_come, limit_s, f"{session._get_name()} at {to}")


def speed_of(state: Any) -> float:
    """Speed of a RobotState [m/s]."""
    return math.hypot(state.moving.ahead, state.moving.left)


def away(state: Any, place: Any) -> float:
    """Distance from a RobotState to a Pose [m]; infinite on another floor."""
    return math.dist((state.at.x, state.at.y), (place.x, place.y)) if state.at.floor == place.floor else math.inf


def is_gone(session: Any) -> bool:
    """Whether the robot of a session is logged off."""
    try:
        session.heartbeat()
    except CORBA.OBJECT_NOT_EXIST:
        return True
    return False


def error_lines(state: Path) -> list[str]:
    """Lines of the servers' logs that report errors."""
    lines = [line for log in sorted((state / "logs").glob("*.log")) for line in log.read_text().splitlines()]
    return [line[:600] for line in lines if re.search(r"\b(ERROR|CRITICAL)\b|Traceback", line)]


# ---- kills ----

CLIENT = checkout_command("testkit.simulation_client")
CLIENTS, ROBOTS_EACH = 3, 4
#: Speed of the clients' robots [m/s].
CLIENT_SPEED = 0.5
#: Time within which robots of a dead client stop [s]; their commands are valid for 0.5 s.
STOP_S = 1.5
#: Timeout for a killed process to be back [s].
BACK_LIMIT_S = 60.0
#: Tolerance of a robot's place after a restart [m].
SLACK_M = 0.03
CHAIR = "room-101-chair-1"
MISSION = "fetch"
PASSAGE = [RoboCorba.FloorArea("L1", [RoboCorba.XY(0.0, 0.0), RoboCorba.XY(9.0, 0.0), RoboCorba.XY(9.0, 9.0)])]


class ClientProcess:
    """A process of `simulation_client`, which logs its robots on at its start. rows: name, floor, x, y [m]."""

    def __init__(self, place: Place, number: int) -> None:
        self.number = number
        self.rows = [
            (f"r{number}-{each}", f"L{each % 3 + 1}", 60.0 + 2.0 * number, 2.0 * each) for each in range(ROBOTS_EACH)
        ]
        self.names = {name for name, *_ in self.rows}
        self.is_whole = True
        self.process: Popen[str] = place.launch(*CLIENT, str(place.running.naming))
        self._send(msgspec.json.encode(self.rows).decode())

    def wait_ready(self) -> ClientProcess:
        assert self.process.stdout is not None and self.process.stderr is not None
        assert self.process.stdout.readline() == "ready\n", self.process.stderr.read()
        return self

    def drive(self) -> None:
        self._send("drive")

    def report(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        self._send("report")
        found: dict[str, Any] = msgspec.json.decode(self.process.stdout.readline())
        return found

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def _send(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()


class Outcome(NamedTuple):
    """Result of one round: kill -9 of a client and of a sensor server, then of the simulation server. Times in s.

    stop_s: until the dead client's robots stopped. free_s: until their names, places and slots were free.
    sensor_s: until the sensor server served again. scan_s: longest scan of a live client meanwhile. back_s: from the
    kill of the simulation server to its first answer. lost_m: largest distance of a robot from its last known place
    after the restart. faults: violated requirements."""

    stop_s: float
    free_s: float
    sensor_s: float
    scan_s: float
    back_s: float
    lost_m: float
    faults: tuple[str, ...]

    @property
    def is_right(self) -> bool:
        """Whether there were no faults; the bench judges the times."""
        return not self.faults


class Chaos:
    """Kills with three client processes whose robots drive; every other round one robot holds a chair and one rides."""

    def __init__(self, place: Place, seed: int, lost_s: float = LOST_S) -> None:
        """lost_s: time before a kill whose poses may be lost [s]; longer on a busy machine."""
        self.place, self._random, self._lost_s = place, random.Random(seed), lost_s
        self._rounds = 0
        chair, self._elevator = place.body("L1", CHAIR), place.elevator()
        self._grasp = RoboCorba.XY(chair["x"], chair["y"] + 0.25)
        self._holder_at = chair["x"], chair["y"] + 0.7
        self._rider_at = landing(self._elevator, self._elevator.floors()[0], 0.8)
        self._mission = 0
        place.remove_outlines("L1", "L2", "L3")
        self._clients = [ClientProcess(place, number) for number in range(CLIENTS)]
        for client in self._clients:
            client.wait_ready()

    def close(self) -> None:
        """Kill the clients."""
        for client in self._clients:
            client.kill()

    def round(self) -> Outcome:
        """Kill processes, and wait until the system is restored."""
        self._faults: list[str] = []
        self._drive()
        stop_s, free_s, sensor_s, scan_s = self._kill_client_and_sensor()
        self._drive()
        back_s, lost_m = self._kill_server()
        self._clients = [client if client.is_whole else self._replaced(client) for client in self._clients]
        self._rounds += 1
        return Outcome(stop_s, free_s, sensor_s, scan_s, back_s, lost_m, tuple(self._faults))

    def _replaced(self, client: ClientProcess) -> ClientProcess:
        """Replace a client that has lost robots."""
        client.kill()
        eventually(lambda: not client.names & self.place.names)
        return ClientProcess(self.place, client.number).wait_ready()

    def _check(self, is_right: object, fault: str) -> None:
        if not is_right:
            self._faults.append(fault)

    def _drive(self) -> None:
        """Wait until all robots of all clients drive."""
        for client in self._clients:
            client.drive()
        names = set().union(*(client.names for client in self._clients))
        eventually(lambda: names <= {name for name, speed in self._speeds().items() if speed > 0.3}, what="all drive")
        for client in self._clients:
            client.report()
        time.sleep(self._random.uniform(0.1, 0.4))

    def _speeds(self) -> dict[str, float]:
        """Speeds of all bodies, by name [m/s]."""
        found = {}
        for floor in ("L1", "L2", "L3"):
            copy = RemoteFloor(self.place.database, floor)
            copy.follow()
            for number, body in copy.view.bodies.items():
                motion = copy.view.motion(number)
                found[body.name] = math.hypot(motion["vx"], motion["vy"])
        return found

    # ---- a client and a sensor server ----

    def _kill_client_and_sensor(self) -> tuple[float, float, float, float]:
        number, sensor = self._rounds % CLIENTS, f"sensor_s{self._rounds % 2 + 1}"
        dead = self._clients.pop(number)
        dead.kill()
        pid = self.place.kill(sensor)
        killed = time.monotonic()
        speeds = self._speeds
        eventually(lambda: not any(speeds().get(name, 0.0) for name in dead.names), what="the dead robots are stopped")
        stop_s = time.monotonic() - killed
        eventually(lambda: not dead.names & self.place.names, what="the dead robots are logged off")
        self._check(not dead.names & self._speeds().keys(), "the body of a dead robot is still there")
        for name, floor, x, y in dead.rows:
            self.place.server.registerRobot(about(name, x, y, floor=floor)).deregister()
        free_s = time.monotonic() - killed

        def is_back() -> bool:
            return self.place.is_again(sensor, pid) and len(self.place.server.sensors()) == 2

        eventually(is_back, BACK_LIMIT_S, "the sensor server is back")
        sensor_s = time.monotonic() - killed
        self._clients.insert(number, ClientProcess(self.place, dead.number).wait_ready())
        live = [client.report() for client in self._clients if client.process is not self._clients[number].process]
        for report in live:
            self._check(not report["lost"], f"sessions lost by the kill of others: {report['lost']}")
            self._check(not report["wrong"], f"{report['wrong'][:3]}")
            self._check(report["scans"], "no scans")
        return stop_s, free_s, sensor_s, max(took for report in live for took in report["scans"])

    # ---- the server ----

    def _kill_server(self) -> tuple[float, float]:
        place, wants = self.place, self._rounds % 2 == 0
        holder = place.log_on("holder", *self._holder_at)
        rider = place.log_on("rider", *self._rider_at)
        before = place.log_on("newcomer", 80.0, 2.0, floor="L2")
        self._mission = place.database.putMission(RoboCorba.MissionRecord(MISSION, self._mission, b"document"))
        holder.grip(CHAIR, self._grasp)
        rider.callElevatorTogether(self._elevator.name, self._elevator.floors()[1], "party", 1)
        holder.reserveAreas(PASSAGE, 300.0)
        rider.reserveAreas(PASSAGE, 300.0)
        if not wants:
            holder.releaseAreas()
            holder.release()
            rider.giveUpElevator()
        before.deregister()
        newcomer = place.log_on("newcomer", 82.0, 2.0, floor="L1")
        pid = place.kill("simulation")
        killed = time.monotonic()
        eventually(self._answers, BACK_LIMIT_S, "the server is back")
        back_s = time.monotonic() - killed

        with self._expecting("the robot that holds"):
            self._check(holder.state().holding == (CHAIR if wants else ""), f"the grip is not as it was ({wants})")
        with self._expecting("the robot that rides"):
            is_riding = rider.state().riding.phase != RoboCorba.NO_RIDE
            self._check(is_riding == wants, f"the ride is not as it was ({wants})")
            is_granted = rider.reservation().phase == RoboCorba.AREAS_GRANTED
            self._check(is_granted != wants, f"the reservation is not as it was ({wants})")
        with self._expecting("the robot that had just logged on"):
            at = newcomer.state().at
            self._check((at.floor, at.x, at.y) == ("L1", 82.0, 2.0), f"the robot that had just logged on is at {at}")
        kept = [(mission.name, mission.current) for mission in place.database.missions()]
        self._check(kept == [(MISSION, self._mission)], f"missions are {kept}")
        lost_m = max(self._check_stationary(client, killed) for client in self._clients)
        eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S, "the new process is recorded")
        place.let_go()
        return back_s, lost_m

    @contextlib.contextmanager
    def _expecting(self, role: str) -> Iterator[None]:
        try:
            yield
        except CORBA.OBJECT_NOT_EXIST:
            self._faults.append(f"the session was lost: {role}")

    def _answers(self) -> bool:
        try:
            return bool(self.place.server._get_state().limit)
        except GONE:
            return False

    def _check_stationary(self, client: ClientProcess, killed: float) -> float:
        """Check that a client's robots keep their sessions, are stationary until commanded, and are where they were
        shortly before the kill; return the largest distance from there [m]."""
        reports: list[dict[str, Any]] = []

        def has_seen_all() -> bool:
            reports.append(client.report())
            robots = reports[-1]["robots"]
            return bool(reports[-1]["lost"]) or all(
                len(robot["resting"]) == 2 and robot["resting"][1][0] > robot["resting"][0][0] + 0.3
                for robot in robots.values()
            )

        eventually(has_seen_all, BACK_LIMIT_S, "the clients observe their robots again")
        last = reports[-1]
        self._check(not last["lost"], f"sessions lost by the kill of the server: {last['lost']}")
        if last["lost"]:
            client.is_whole = False
            return 0.0
        wrong = [one for report in reports for one in report["wrong"]]
        self._check(not wrong, f"{wrong[:3]}")
        lost_m = 0.0
        for name in client.names:
            (seen_at, *seen, _, _), (first, after) = last["robots"][name]["driving"][0], last["robots"][name]["resting"]
            self._check(first[3] == after[3] == 0.0, f"{name} still drives at {first[3]:g} m/s")
            self._check(first[1:3] == after[1:3], f"{name} was moved")
            lost_m = max(lost_m, math.dist(seen, first[1:3]))
            may_m = CLIENT_SPEED * (self._lost_s + max(0.0, killed - seen_at)) + SLACK_M
            self._check(
                math.dist(seen, first[1:3]) <= may_m, f"{name} was set back by {math.dist(seen, first[1:3]):g} m"
            )
        return lost_m

"""Missions of real robot processes in a running system, and their observation through the simulation server."""

from __future__ import annotations

import contextlib
import json
import math
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, Door, Element, Floor, FloorMap, MapObject, Wall
from robocorba.map_editor.spatial.floor_update import WHOLE
from robocorba.map_editor.topology import topological_map
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.missions.subplan import StoredPlan
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.corba.remote_data_pool import RemotePool
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.mission_record import MissionContent, MissionResult, MissionState
from robocorba.simulation.registry import Pose
from robocorba.simulation.store import SimulationStore
from robocorba.stubs import RoboCorba
from robocorba.system.names import MISSIONS
from testkit.buildings import with_all
from testkit.processes import ROBOCORBA, Launcher, Running, drain, eventually, forked_processes, running_system

FLOOR = "L1"
#: Time limits for the start of a robot and for a mission [s].
START_LIMIT_S, MISSION_LIMIT_S = 120.0, 240.0


def three_rooms() -> Building:
    """West: a room of 6 x 5 m with a table for three robots. East: one of 4 x 5 m with a door to it. North: a separate
    one of 6 x 5 m with a desk for two robots."""
    outline = ((0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (6.0, 5.0), (6.0, 10.0), (0.0, 10.0))
    ends = [*zip(outline, (*outline[1:], outline[0]), strict=True), ((6.0, 0.0), (6.0, 5.0)), ((0.0, 5.0), (6.0, 5.0))]
    elements: list[Element] = [Wall(f"wall-{number}", a, b) for number, (a, b) in enumerate(ends)]
    elements += [
        MapObject("table", BoxShape((1.2, 0.8)), (2.2, 2.6), height=0.7, movable=True),
        MapObject("desk", BoxShape((1.0, 0.8)), (2.2, 7.6), height=0.7, movable=True),
        Door("door", (6.0, 1.9), (6.0, 3.3)),
    ]
    building = Building("three rooms", {FLOOR: FloorMap(Floor(FLOOR, 1, 0.0, outline=outline))})
    building = with_all(building, [(FLOOR, element) for element in elements])
    floor = building.floors[FLOOR]
    building.floors[FLOOR] = msgspec.structs.replace(floor, topological=topological_map(building, FLOOR))
    return building


class RobotStart(NamedTuple):
    """Start pose of a robot [m, rad], and its sub-network. adaptor: its name and arguments, empty for a virtual robot.
    within: prefix of the command line, such as one that runs it in another network namespace."""

    x: float
    y: float
    heading: float
    channel: str
    adaptor: tuple[str, ...] = ()
    within: tuple[str, ...] = ()
    floor: str = FLOOR


class BodyPose(NamedTuple):
    """A body of the simulation at one time [m, rad]."""

    x: float
    y: float
    heading: float


@contextlib.contextmanager
def missions(folder: Path, building: Path | Building, subnets: str = "lab,hall") -> Iterator[MissionSystem]:
    """`robocorba up` on a building; ended with all its robots. One at a time in a process."""
    file = saved(building, folder)
    with (
        forked_processes(),
        running_system(folder, "--building", str(file), "--subnets", subnets) as (running, launch),
        Orb(running.naming, call_timeout_s=5.0) as orb,
        MissionSystem(folder, running, orb, launch) as place,
    ):
        yield place


class MissionSystem:
    """A running system. robots: their processes, by name."""

    def __init__(self, folder: Path, running: Running, orb: Orb, launch: Launcher) -> None:
        self.folder, self.running, self.orb, self._launch = folder, running, orb, launch
        self.kill_server, self.is_back = running.kill, running.is_again
        self.robots: dict[str, subprocess.Popen[str]] = {}
        self._database = RemoteDatabase(orb, 5.0)
        self.control = RemoteMissionControl(orb, 5.0)
        self.server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)

    def __enter__(self) -> MissionSystem:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    # ---- robots ----

    def start(self, starts: Mapping[str, RobotStart], *options: str) -> None:
        """Start robots simultaneously, with options of `robocorba robot`, and wait until all are ready."""
        for name, at in starts.items():
            where = ("--floor", at.floor, "--at", f"{at.x},{at.y},{at.heading}", "--channel", at.channel)
            adaptor = ("--adaptor", at.adaptor[0], "--", *at.adaptor[1:]) if at.adaptor else ()
            self.robots[name] = self.robocorba(name, "robot", name, *where, *options, *adaptor, within=at.within)
        for name in starts:
            process = self.robots[name]
            assert process.stdout is not None and process.stderr is not None
            if process.stdout.readline() != "ready\n":
                raise AssertionError(f"{name} did not start: {process.stderr.read()}")
            drain(process)

    def kill(self, name: str) -> None:
        """kill -9 a robot, and wait until it is logged off."""
        process = self.robots.pop(name)
        process.kill()
        process.communicate()
        eventually(lambda: name not in self.names(), what=f"{name} is logged off")

    def end(self) -> None:
        """End all robots with SIGTERM; fails if one does not end."""
        for process in self.robots.values():
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGTERM)
        for name, process in self.robots.items():
            try:
                process.wait(60.0)
            except subprocess.TimeoutExpired:
                raise AssertionError(f"{name} hangs") from None
        self.robots.clear()

    def names(self) -> set[str]:
        """The names of the robots that are logged on."""
        return {client.name for client in self.server.clients()}

    def agent(self, name: str) -> RemoteAgent:
        return RemoteAgent(self.orb, name)

    def is_free(self, name: str) -> bool:
        """Whether a robot is idle and stationary."""
        try:
            state = self.agent(name).state()
        except NotReachable:
            return False
        return state.condition is AgentCondition.IDLE and math.hypot(*state.actor.velocity[:2]) < 0.01

    # ---- missions ----

    def mission(self, leader: str, table: str, to: str) -> subprocess.Popen[str]:
        """Start `robocorba mission start move-table`. leader: empty for the nearest free robot."""
        arguments = ("--table", table, "--to", to, *(("--leader", leader) if leader else ()))
        return self.robocorba("user", "mission", "start", "move-table", *arguments)

    def outcome(self, user: subprocess.Popen[str]) -> tuple[int, str, str]:
        """Wait for the end of a mission's command: its exit code, stdout and stderr."""
        out, err = user.communicate(timeout=MISSION_LIMIT_S)
        return user.returncode, out, err

    def result(self, user: subprocess.Popen[str], limit_s: float) -> tuple[str, str]:
        """The result that a mission's command prints last, such as done, and the rest of that line; `error` and the
        last line otherwise. The command is killed if it does not end within `limit_s`."""
        try:
            out, err = user.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            user.kill()
            out, err = user.communicate()
            err += f"did not end within {limit_s:g} s"
        last = (err or out).strip().splitlines()[-1]
        result, _, rest = last.partition("\t")
        return (result, rest) if result in {each.value for each in MissionResult} else ("error", last)

    def robocorba(self, user: str, *arguments: str, within: tuple[str, ...] = ()) -> subprocess.Popen[str]:
        environment = {"ROBOCORBA_NAMING": str(self.running.naming), "ROBOCORBA_STATE": str(self.folder / user)}
        return self._launch(*within, ROBOCORBA, *arguments, **environment)

    def command(self, leader: str, *arguments: str) -> str:
        """Run `robocorba mission ...`, which must succeed; return its output."""
        return self.printed("mission", *arguments, user=leader)

    def printed(self, *arguments: str, user: str = "user") -> str:
        """What a command of `robocorba` prints, which must succeed."""
        out, err = (process := self.robocorba(user, *arguments)).communicate(timeout=60.0)
        assert process.returncode == 0, err
        return out

    def refusal(self, user: str, *arguments: str) -> str:
        """Run `robocorba mission ...`, which must be refused; return the error."""
        process = self.robocorba(user, "mission", *arguments)
        _, err = process.communicate(timeout=60.0)
        assert process.returncode == 1, err
        return err

    def led_by(self, leader: str) -> str:
        """The name of the mission that a robot leads, by mission control."""
        (name,) = (
            state.name
            for state in self.control.missions_since(0)
            if state.content.leader == leader and state.content.is_running
        )
        return name

    def ended(self, mission: str) -> MissionContent:
        """A mission once mission control says that it has ended."""

        def content() -> MissionContent | None:
            found = self.control.mission(mission).content
            return None if found.is_running else found

        return eventually(content, what=f"{mission} has ended")

    def missions_since(self, version: int) -> list[MissionState]:
        """The missions that changed after a version; empty while mission control does not answer."""
        with contextlib.suppress(NotReachable):
            return self.control.missions_since(version)
        return []

    def kept(self, leader: str) -> StoredPlan | None:
        """The plan of the mission that a robot leads, or led last."""
        plans = RemotePool(self.orb, leader, 3.0).plans()
        return StoredPlan.decode(plans[-1].content) if plans else None

    def at_phase(self, leader: str, phase: str, user: subprocess.Popen[str]) -> None:
        """Wait until a phase has begun, which may be over by then; fails if the mission ends before."""

        def is_there() -> bool:
            assert user.poll() is None, f"it ended before {phase}: {user.communicate()}"
            return self.has_begun(leader, phase)

        eventually(is_there, MISSION_LIMIT_S, phase)

    def has_begun(self, leader: str, phase: str) -> bool:
        """Whether the phase has begun in the running mission that a robot leads."""
        kept = self.kept(leader)
        return (kept is not None and kept.phase == phase) or phase in self._begun(leader)

    def _begun(self, leader: str) -> set[str]:
        """The phases that have begun of the running mission that a robot leads, by its record."""
        contents = (state.content for state in self.missions_since(0))
        return {
            phase.name
            for content in contents
            if content.leader == leader and content.is_running
            for phase in content.phases
        }

    def carrying(self, leader: str, table: str, user: subprocess.Popen[str], moved_m: float = 0.1) -> None:
        """Wait until the table has moved by `moved_m` in the phase `carrying`."""
        before = self.body(table)
        self.at_phase(leader, "carrying", user)
        eventually(lambda: math.dist(before[:2], self.body(table)[:2]) > moved_m, what="the table moves")

    def report(self, leader: str) -> dict[str, Any]:
        """The report of the mission that a robot led last."""
        files = sorted((self.folder / leader / MISSIONS).glob("*/report.json"), key=lambda file: file.stat().st_mtime)
        found: dict[str, Any] = json.loads(files[-1].read_text())
        return found

    # ---- the simulation ----

    def bodies(self) -> tuple[float, dict[str, BodyPose]]:
        """All bodies of the floor after the same simulation step, and its time [s]."""
        return self._bodies(FLOOR)

    def body(self, name: str) -> BodyPose:
        return self.bodies()[1][name]

    def poses(self) -> dict[str, Pose]:
        """Poses of all bodies of all floors."""
        floors = ((floor, self._bodies(floor)[1]) for floor in self._database.floors())
        return {name: Pose(floor, *pose) for floor, bodies in floors for name, pose in bodies.items()}

    def holding(self) -> dict[str, str]:
        """The held object of each robot that holds one, by the server's store: it stores grips before it replies."""
        with tempfile.TemporaryDirectory() as copy:
            for file in self.running.state.glob("simulation.sqlite*"):
                with contextlib.suppress(FileNotFoundError):
                    shutil.copy(file, copy)
            with SimulationStore(Path(copy) / "simulation.sqlite") as store:
                world = store.world()
        return {name: robot.grip[0] for name, robot in world.robots.items() if robot.grip} if world else {}

    @property
    def collisions(self) -> int:
        """Number of collisions since the server was started."""
        return int(self.server._get_state().collisions)

    def is_stationary(self, names: tuple[str, ...], seconds: float = 0.5) -> bool:
        """Whether none of the bodies moves within some time."""
        before = self.poses()
        time.sleep(seconds)
        after = self.poses()
        return all(name in after and math.dist(before[name][1:3], after[name][1:3]) < 0.005 for name in names)

    def left_behind(self, names: Sequence[str], items: Sequence[str], limit_s: float) -> list[str]:
        """Errors in the state of robots and objects after missions; emergency stops are reset."""
        wrong: list[str] = []

        def is_free(name: str) -> bool:
            with contextlib.suppress(RoboCorbaError):
                agent = self.agent(name)
                if agent.state().condition is AgentCondition.STOPPED:
                    agent.reset_stop()
            return self.is_free(name)

        try:
            eventually(lambda: all(map(is_free, names)), limit_s)
        except AssertionError:
            wrong.append(f"not free: {[name for name in names if not self.is_free(name)]}")
        if held := self.holding():
            wrong.append(f"still held: {held}")
        if not self.is_stationary((*names, *items)):
            wrong.append("something moves")
        return wrong

    # ---- inside ----

    def _bodies(self, floor: str) -> tuple[float, dict[str, BodyPose]]:
        update = self._database.changes(floor, WHOLE)
        names = {body.number: body.name for body in update.came}
        motions = update.motions[["number", "x", "y", "heading"]].tolist()
        return update.time, {names[number]: BodyPose(*pose) for number, *pose in motions if number in names}


class Watch:
    """Samples the bodies of the floor inside a `with`: the distances of grip points from hands, and between robots.

    A grip point is where a hand was on the table when the table began to move."""

    def __init__(self, place: MissionSystem, table: str, every_s: float = 0.04) -> None:
        self._place, self._table, self._every_s = place, table, every_s
        self.seen: list[tuple[float, dict[str, BodyPose]]] = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def farthest_m(self, carriers: tuple[str, ...]) -> float:
        """Largest distance of a carrier's hands from their grip points while the table moved [m]."""
        moves = [self._speed(before, now) > 0.01 for before, now in zip(self.seen, self.seen[1:], strict=False)]
        if not any(moves):
            return math.nan
        first, last = moves.index(True), len(moves) - moves[::-1].index(True)
        carried = [bodies for _, bodies in self.seen[first : last + 1] if all(name in bodies for name in carriers)]
        worst = 0.0
        for name in carriers:
            hands = [_hand_on(bodies[self._table], bodies[name]) for bodies in carried]
            worst = max(worst, max(math.dist(hand, hands[0]) for hand in hands))
        return worst

    def _speed(self, before: tuple[float, dict[str, BodyPose]], now: tuple[float, dict[str, BodyPose]]) -> float:
        there, here = before[1][self._table], now[1][self._table]
        return math.dist(there[:2], here[:2]) / max(now[0] - before[0], 0.02)

    def _run(self) -> None:
        while not self._ending.wait(self._every_s):
            with contextlib.suppress(NotReachable, CORBA.Exception):
                self.seen.append(self._place.bodies())


def _hand_on(table: BodyPose, robot: BodyPose, ahead_m: float = 0.62) -> tuple[float, float]:
    """Position of a robot's hands in the table's frame."""
    x, y = robot.x + ahead_m * math.cos(robot.heading), robot.y + ahead_m * math.sin(robot.heading)
    c, s, dx, dy = math.cos(table.heading), math.sin(table.heading), x - table.x, y - table.y
    return c * dx + s * dy, c * dy - s * dx


def save_three_rooms(folder: Path) -> Path:
    return saved(three_rooms(), folder)


def saved(building: Path | Building, folder: Path) -> Path:
    """The file of a building, in a folder if it has none yet."""
    if isinstance(building, Path):
        return building
    file = folder / "building.yaml"
    native.save(building, file)
    return file

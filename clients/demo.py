"""The demo, the paper's experiment: three robots of two sub-networks carry a table through a room.

    python -m robocorba.clients.demo [FOLDER] [--quick] [--console]

It starts all servers on the building `paper-scene`, the sub-networks lab and hall with their channels and gateways, and
three robot processes: A and B in lab, C in hall. A receives the user's command and leads; all three carry the table to
its goal. FOLDER (default: demo-output) gets report.html with pictures, film and figures, report.json, and logs. Exit
code 0 only if the table is within 5 cm and 3 deg of its goal by the simulation server.

With --console the operator's console shows all of it, and the system stays after the mission until Ctrl-C."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import msgspec
from omniORB import CORBA

from robocorba.clients.robot_processes import ReadyProcess, robocorba, servers
from robocorba.commands.mission import MissionStatus, follow_mission, sheets
from robocorba.commands.path import sheet_of
from robocorba.commands.waiting import progress
from robocorba.commands.watch import Camera
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.places import place
from robocorba.errors.robots import MissionFailed
from robocorba.errors.services import StartFailed
from robocorba.map_editor.samples import sample_path
from robocorba.missions import page, timeline
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.missions.corba.remote_world import RemoteWorld
from robocorba.missions.report import REPORT_FILE
from robocorba.missions.world import MovableObject
from robocorba.orb.calls import error_of
from robocorba.orb.naming import corbaname
from robocorba.orb.orb import Orb
from robocorba.planning.corba import paths
from robocorba.planning.request import PathRequest, Place
from robocorba.robot.programs.icons import Destination, MoveTable
from robocorba.stubs import RoboCorba
from robocorba.system.extras import require_extra
from robocorba.system.names import MISSIONS
from robocorba.system.printing import Console, line
from robocorba.system.settings import Address
from robocorba.system.state_folder import StateFolder

BUILDING, FLOOR, TABLE, LEADER = "paper-scene", "L1", "table", "A"
#: Tolerance of the table's pose at its goal [m, rad].
TOLERANCE_M, TOLERANCE_RAD = 0.05, math.radians(3.0)
#: Timeout of the mission [s].
MISSION_TIMEOUT_S = 150.0
#: A start that takes longer than this is explained to the user [s].
EXPLAIN_AFTER_S = 8.0
FPS, WIDTH_PX = 10, 960
FILM, BEFORE, CARRYING, AFTER = "mission.mp4", "before.png", "carrying.png", "after.png"
PICTURES = {
    BEFORE: "Before: A and B are in one room with the table, C is in the other one",
    CARRYING: "Half way",
    AFTER: "After",
    timeline.PICTURE: timeline.CAPTION,
}


class StartPose(NamedTuple):
    """Start pose of a robot [m, rad], and its sub-network."""

    x: float
    y: float
    heading: float
    channel: str


class DemoScene(NamedTuple):
    """Robots by name, and the goal of the table."""

    robots: dict[str, StartPose]
    goal: Destination


A, B = StartPose(1.1, 3.3, 0.0, "lab"), StartPose(5.2, 1.2, 0.0, "lab")
PAPER = DemoScene({"A": A, "B": B, "C": StartPose(11.3, 3.1, 0.0, "hall")}, Destination(FLOOR, 6.7, 3.1, 0.0))
#: The same with shorter paths.
QUICK = DemoScene({"A": A, "B": B, "C": StartPose(9.5, 3.1, 0.0, "hall")}, Destination(FLOOR, 4.6, 3.2, 0.0))


class GoalError(NamedTuple):
    """Distance and turn of an object from its goal."""

    off_m: float
    off_rad: float

    @property
    def is_within_tolerance(self) -> bool:
        return self.off_m <= TOLERANCE_M and self.off_rad <= TOLERANCE_RAD

    def __str__(self) -> str:
        return f"{1000 * self.off_m:.0f} mm and {math.degrees(self.off_rad):.1f} deg from its goal"


def goal_error(table: MovableObject, goal: Destination) -> GoalError:
    """The distance is infinite on another floor."""
    off_m = math.dist((table.x, table.y), (goal.x, goal.y)) if table.floor == goal.floor else math.inf
    return GoalError(off_m, abs(math.remainder(table.heading - goal.heading, math.tau)))


def main(arguments: Sequence[str] | None = None) -> int:
    given = _parse(arguments)
    scene, folder = QUICK if given.quick else PAPER, given.folder

    def show(state: Path, logs: Path, console: Console) -> bool:
        for file in (page.PAGE, REPORT_FILE, FILM, *PICTURES):
            (folder / file).unlink(missing_ok=True)
        return play(scene, folder, state, logs, console, not given.quick, given.console)

    return present(folder, "console" if given.console else "films", show)


def present(folder: Path, extra: str, show: Callable[[Path, Path, Console], bool]) -> int:
    """Run a demo: `show` gets a folder for the system's state, one for logs, and where to print. Returns the exit code,
    0 only if `show` returns true. extra: what must be installed."""
    console, logs, began = Console(soft_wrap=True, highlight=False), folder / "logs", time.monotonic()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end)  # child processes are ended, too
    try:
        require_extra(extra, "pictures of the demo")
        logs.mkdir(parents=True, exist_ok=True)
        with _state_folder(logs) as state:
            is_good = show(state, logs, console)
    except (RoboCorbaError, CORBA.Exception, OSError) as error:
        reason = error_of(error)
    except KeyboardInterrupt as signalled:
        reason = f"ended by {str(signalled) or 'Ctrl-C'}"
    else:
        console.print(f"total {time.monotonic() - began:.0f} s; logs are in {logs}")
        return 0 if is_good else 1
    line(f"demo: {reason}; logs are in {logs}", err=True)
    return 1


def play(
    scene: DemoScene,
    folder: Path,
    state: Path,
    logs: Path,
    console: Console,
    is_filmed: bool,
    with_browser: bool = False,
) -> bool:
    """Run the demo; return whether the table is at its goal. with_browser: serve the operator's console, and wait for
    Ctrl-C at the end. Raises RoboCorbaError, CORBA.Exception."""
    with contextlib.ExitStack() as stack:
        subnets = ",".join(dict.fromkeys(robot.channel for robot in scene.robots.values()))
        with starting("Servers", console):
            options = ["--building", str(sample_path(BUILDING)), "--subnets", subnets]
            if with_browser:
                options += ["--console", "--console-port", "0"]
            naming = stack.enter_context(servers(state, *options))
        if with_browser:
            console.print(f"  [bold]console: {console_address(state)}[/bold]")
        console.print(f"  sub-networks {subnets}; a gateway links their event channels")
        console.print(f"  address for CORBA clients: {corbaname(naming, 'RoboCorba/SimulationServer')}")
        orb = stack.enter_context(Orb(naming))
        with starting("Robots", console):
            start_robots(stack, scene.robots, naming, state, logs)
        for name, robot in scene.robots.items():
            console.print(f"  {name} at {place(FLOOR, robot.x, robot.y)} in sub-network {robot.channel}")
        _show_path(orb, scene, console)
        camera = Camera(orb, [FLOOR], WIDTH_PX)
        (folder / BEFORE).write_bytes(camera.png())
        film = _film(naming, folder / FILM, logs) if is_filmed else contextlib.nullcontext()
        with film:
            end = _carry(orb, scene.goal, camera, folder, console)
        (folder / AFTER).write_bytes(camera.png())
        error = goal_error(RemoteWorld(orb).movable(TABLE), scene.goal)
        is_good = end.result == "done" and error.is_within_tolerance
        reason = f": {end.reason}" if end.reason else ""
        console.print(f"  {end.result} after {end.seconds:.1f} s{reason}", markup=False)
        colour = "green" if is_good else "red"
        console.print(f"[{colour}]Simulation server: the {TABLE} is {error}[/]")
        _report(folder, state, error, scene, console)
        if with_browser:
            wait_for_ctrl_c(console, console_address(state))
    return is_good


# ---- before the mission ----


def start_robots(
    stack: contextlib.ExitStack,
    robots: Mapping[str, StartPose],
    naming: Address,
    state: Path,
    logs: Path,
    *options: str,
) -> None:
    """Start the leader first, so that on a new machine only one robot compiles the kernels. Raises StartFailed."""
    running = {}
    for name, robot in robots.items():
        where = ("--floor", FLOOR, "--at", f"{robot.x},{robot.y},{robot.heading}", "--channel", robot.channel)
        command = (robocorba(), "robot", name, *where, "--naming", str(naming), "--state", str(state), *options)
        running[name] = stack.enter_context(ReadyProcess(logs / f"robot-{name}.log", *command))
        if name == LEADER:
            running[name].wait_ready()
    for name in running.keys() - {LEADER}:
        running[name].wait_ready()


def _show_path(orb: Orb, scene: DemoScene, console: Console) -> None:
    """Print the path from the robot of the other sub-network to the goal."""
    start = scene.robots["C"]
    request = PathRequest(Place(FLOOR, start.x, start.y), Place(FLOOR, scene.goal.x, scene.goal.y))
    planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    console.print("[bold]Path planning agent[/bold]: C's path into the other room")
    console.print(sheet_of(paths.path_of(planner.findPaths(paths.request(request))[0])))


@contextlib.contextmanager
def _film(naming: Address, file: Path, logs: Path) -> Iterator[None]:
    """Film the floor inside the `with`."""
    command = (
        robocorba(),
        "watch",
        "--video",
        str(file),
        "--floor",
        FLOOR,
        "--fps",
        str(FPS),
        "--width",
        str(WIDTH_PX),
    )
    with ReadyProcess(logs / "film.log", *command, "--naming", str(naming)) as camera:
        camera.wait_file(file)
        yield


# ---- the mission ----


def _carry(orb: Orb, goal: Destination, camera: Camera, folder: Path, console: Console) -> MissionStatus:
    """Command the leader and follow the mission to its end; take a picture when the table is half way.

    Raises MissionFailed if it does not end within MISSION_TIMEOUT_S."""
    control, world = RemoteMissionControl(orb), RemoteWorld(orb)
    total_m = goal_error(world.movable(TABLE), goal).off_m
    goal_text = place(goal.floor, goal.x, goal.y)
    console.print(
        f"[bold]Mission[/bold]: robocorba mission start move-table --table {TABLE} --to {goal_text} --leader {LEADER}"
    )
    name = control.start(LEADER, msgspec.json.encode(MoveTable(TABLE, goal)).decode())
    began, printed = time.monotonic(), ""
    with progress(1.0) as bar:
        for now in follow_mission(control, name, time.sleep):
            if now.result:
                return now
            if now.phase != printed:
                printed = now.phase
                line(f"  {now.seconds:5.1f} s  {printed:<14} {', '.join(now.robots)}")
            bar(now.share, printed)
            picture = folder / CARRYING
            if not picture.exists() and goal_error(world.movable(TABLE), goal).off_m < total_m / 2:
                picture.write_bytes(camera.png())
            if time.monotonic() - began > MISSION_TIMEOUT_S:
                raise MissionFailed(
                    f"the mission did not end within {MISSION_TIMEOUT_S:g} s; it was at {printed or 'its beginning'}"
                )
    raise MissionFailed("the mission has no result")  # not reached: follow_mission ends with one


# ---- the report ----


def _report(folder: Path, state: Path, error: GoalError, scene: DemoScene, console: Console) -> None:
    """Write report.html and report.json from the leader's report. Raises MissionFailed if there is none."""
    found = next(iter((state / MISSIONS).glob(f"*/{REPORT_FILE}")), None)
    if found is None:
        raise MissionFailed(f"{LEADER} wrote no report in {state / MISSIONS}")
    content: dict[str, Any] = json.loads(found.read_text())
    content["simulation_server"] = {
        "goal": msgspec.to_builtins(scene.goal),
        "off_mm": 1000 * error.off_m,
        "off_deg": math.degrees(error.off_rad),
        "is_there": error.is_within_tolerance,
    }
    (folder / REPORT_FILE).write_text(json.dumps(content, indent=1))
    timeline.draw(content, folder / timeline.PICTURE)
    places = ", ".join(f"{name} in {robot.channel}" for name, robot in scene.robots.items())
    facts = [("By the simulation server", f"the {TABLE} is {error}"), ("Robots", places)]
    pictures = [(file, shows) for file, shows in PICTURES.items() if (folder / file).exists()]
    film = FILM if (folder / FILM).exists() else ""
    written = page.write(content, folder, pictures, film, facts)
    for table in sheets(content):
        console.print(table)
    others = ", ".join(filter(None, [REPORT_FILE, film, *(file for file, _ in pictures)]))
    console.print(f"wrote {written} and, in the same folder, {others}")


# ---- start and end ----


@contextlib.contextmanager
def starting(what: str, console: Console) -> Iterator[None]:
    """Print what is started, how long it took, and the reason if it takes long."""
    began = time.monotonic()
    console.print(f"[bold]{what}[/bold]")
    why = "  still starting; the first start on a machine compiles planner, physics and kinematics: 30 to 90 s"
    with console.status(f"  starting {what.lower()} ...") as spinner:

        def explain() -> None:
            spinner.update(why) if console.is_terminal else console.print(why)

        long = threading.Timer(EXPLAIN_AFTER_S, explain)
        long.start()
        try:
            yield
        finally:
            long.cancel()
    console.print(f"  ready after {time.monotonic() - began:.1f} s")


@contextlib.contextmanager
def _state_folder(logs: Path) -> Iterator[Path]:
    """A temporary folder; its logs are copied to `logs` at the end."""
    with tempfile.TemporaryDirectory(prefix="robocorba-demo-") as folder:
        state = Path(folder)
        try:
            yield state
        finally:
            for log in [*state.glob("*.log"), *state.glob("logs/*")]:
                shutil.copy(log, logs)


def console_address(state: Path) -> str:
    """Where browsers find the operator's console. Raises StartFailed."""
    record = StateFolder(state).read_record()
    if record is None or not record.console_address:
        raise StartFailed("the console does not run")
    return record.console_address


def wait_for_ctrl_c(console: Console, address: str) -> None:
    """Wait for Ctrl-C, which ends the system, or for a signal, which ends the demo."""
    console.print(f"The system goes on, with the console at {address}; Ctrl-C ends it.")
    try:
        while True:
            time.sleep(3600.0)
    except KeyboardInterrupt as signalled:
        if str(signalled):
            raise


def _end(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt(signal.Signals(number).name)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="robocorba.clients.demo", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("demo-output"), metavar="FOLDER")
    parser.add_argument("--quick", action="store_true", help="shorter paths, and no film")
    parser.add_argument("--console", action="store_true", help="show it in the browser, until Ctrl-C")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

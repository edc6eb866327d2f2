"""The demo: start every server on the five-floor building, plan trips over CORBA, check and draw them; and let a robot
drive one of them in the simulation.

    python -m clients.demo [FOLDER]

Pictures go to FOLDER (demo-output). Exit code 0 only if every path was found and is free of collisions."""

from __future__ import annotations

import contextlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from omniORB import CORBA
from rich.console import Console

from clients.drive import drive, log_on
from robocorba.commands.path import as_table, marks
from robocorba.conversion import errors as idl_errors
from robocorba.conversion import paths
from robocorba.errors import RoboCorbaError, StartFailed
from robocorba.maps import native
from robocorba.names import ADMINISTRATOR
from robocorba.orb import Orb, corbaname
from robocorba.planning.checking import faults
from robocorba.planning.request import SMARTPAL_RADIUS_M, Criterion, PathRequest, Place, RouteMode
from robocorba.settings import Address
from robocorba.stubs import RoboCorba

TRIPS = {
    "across one floor": PathRequest(Place("L1", 3.0, 4.0), Place("L1", 38.0, 3.0)),
    "two floors up": PathRequest(Place("L1", 3.0, 4.0), Place("L3", 10.0, 2.0)),
    "from the ground floor to the top": PathRequest(Place("L1", 20.0, 4.0), Place("L5", 36.5, 12.0)),
    "the same, the fastest way": PathRequest(
        Place("L1", 20.0, 4.0), Place("L5", 36.5, 12.0), best=Criterion.SHORTEST_TIME
    ),
    "the same through free space": PathRequest(
        Place("L1", 20.0, 4.0), Place("L5", 36.5, 12.0), mode=RouteMode.GEOMETRIC
    ),
    "without elevator E1: a change of elevators": PathRequest(
        Place("L1", 20.0, 4.0), Place("L5", 36.5, 12.0), avoid_elevators=frozenset({"E1"})
    ),
}


def main(folder: str = "demo-output") -> int:
    console = Console()
    output = Path(folder)
    output.mkdir(parents=True, exist_ok=True)
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="robocorba-demo-") as state, servers(Path(state)) as naming:
        console.print(f"The servers run; any CORBA client finds them at {corbaname(naming, 'RoboCorba/PathPlanner')}\n")
        with Orb(naming) as orb:
            planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
            building = native.loads(orb.resolve("MapEditor", RoboCorba.MapEditor).exportMap())
            from robocorba.maps.drawing import draw_floor  # it takes a second to load; the table comes first

            for number, (title, request) in enumerate(TRIPS.items(), 1):
                path = paths.path_of(planner.findPaths(paths.request(request))[0])
                console.print(f"[bold]{number}. {title}[/bold]")
                console.print(as_table(path))
                found = faults(building, path, SMARTPAL_RADIUS_M)
                for fault in found:
                    console.print(f"[red]{fault}[/red]")
                wrong += bool(found)
                for floor in dict.fromkeys(point.floor for point in path.points):
                    picture = output / f"trip-{number}-{floor}.png"
                    draw_floor(building, floor, path=marks(path, floor), title=f"{title} · {floor}").save(picture)
                    console.print(f"drew {picture}")
                console.print()
            drive_one(orb, Path(state), output, console)
    if wrong:
        console.print(f"[red]{wrong} of {len(TRIPS)} paths have faults[/red]")
        return 1
    console.print(f"{len(TRIPS)} paths planned over CORBA, checked against the walls: no collision.")
    return 0


def drive_one(orb: Orb, state: Path, output: Path, console: Console) -> None:
    """Let a robot log on and drive, five times as fast as in real life; draw where it is in the end."""
    title, request = list(TRIPS.items())[1]
    reference = (state / ADMINISTRATOR).read_text()
    orb.reference(reference, RoboCorba.SimulationAdministrator).setPace(5.0)
    path = orb.resolve("PathPlanner", RoboCorba.PathPlanner).findPaths(paths.request(request))[0].points
    console.print(f"[bold]Robot A drives it: {title}[/bold]")
    robot = log_on(orb, "A", path)
    drive(robot, path, lambda text: console.print(f"A {text}"))
    at, seconds = robot.state().at, robot.state().time
    laser, waist = robot.sensor.laser(), RoboCorba.Mount(0.0, 0.0, 0.0)
    nearest = min(robot.sensor.scan(at, waist, laser).distances)
    picture = output / f"simulation-{at.floor}.png"
    picture.write_bytes(orb.resolve("SimulationServer", RoboCorba.SimulationServer).renderFloor(at.floor, 1200))
    console.print(
        f"A is there: {at.floor} ({at.x:.2f}, {at.y:.2f}); its laser sees the nearest thing {nearest:.2f} m away"
    )
    console.print(f"drew {picture} at {seconds:.0f} s of simulated time\n")
    robot.deregister()


@contextlib.contextmanager
def servers(state: Path, *options: str) -> Iterator[Address]:
    """`robocorba up` in a process of its own, as long as the `with` lasts. Raises StartFailed."""
    naming = Address("127.0.0.1", _free_port())
    command = shutil.which("robocorba", path=str(Path(sys.executable).parent)) or "robocorba"
    arguments = [command, "up", "--state", str(state), "--naming-port", str(naming.port), *options]
    up = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        assert up.stdout is not None
        for line in up.stdout:
            print(line, end="", flush=True)
            if line == "ready\n":
                break
        else:
            raise StartFailed("the servers did not come up; see the message above")
        yield naming
    finally:
        up.send_signal(signal.SIGTERM)
        up.wait(timeout=30)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except RoboCorbaError as error:
        sys.exit(f"demo: {error}")
    except CORBA.UserException as error:
        sys.exit(f"demo: {idl_errors.error_of(error)}")

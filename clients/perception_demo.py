"""A demo of perception: three robots of two sub-networks find a chair that no map has.

    python -m robocorba.clients.perception_demo [FOLDER] [--console]

Robots A and B in lab, C in hall drive by what their own sensors see. What they see goes through the event channels;
the map editor correlates it, and offers an object, which all paths avoid. Here it is accepted. FOLDER (default:
perception-output) gets pictures, perception.json and logs. Exit code 0 only if the proposal came within 10 s of the
second robot's first sighting, and its place is within 5 cm of where the chair is by the simulation server."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from robocorba.clients.demo import (
    BUILDING,
    FLOOR,
    WIDTH_PX,
    StartPose,
    console_address,
    present,
    start_robots,
    starting,
    wait_for_ctrl_c,
)
from robocorba.clients.robot_processes import servers
from robocorba.commands.watch import Camera
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.places import place
from robocorba.errors.robots import MissionFailed, RobotLost
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.map_editor.corba.remote_edit_session import RemoteMapEditor
from robocorba.map_editor.proposals import Proposal
from robocorba.map_editor.samples import sample_path
from robocorba.map_editor.sightings import seen_of
from robocorba.map_editor.spatial.pose import XY, Limits, Pose
from robocorba.map_editor.store import FIRST_VERSION
from robocorba.orb.orb import Orb
from robocorba.planning.corba.remote_planner import RemotePlanner
from robocorba.planning.request import PathRequest, Place
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.corba.remote_session import RemoteSession
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.registry import Description
from robocorba.system.backoff import Backoff
from robocorba.system.names import SIGHTING_EVENT
from robocorba.system.printing import Console, line
from robocorba.system.repeating import Repeating

CHAIR, RADIUS_M, AT = "chair", 0.24, (5.8, 4.3)
ROBOTS = {
    "A": StartPose(1.1, 3.3, 0.0, "lab"),
    "B": StartPose(5.2, 1.2, 0.0, "lab"),
    "C": StartPose(11.3, 3.1, math.pi, "hall"),
}
#: Where they look at the chair from [m].
LOOKOUTS = {"A": (4.3, 4.9), "B": (5.9, 2.9), "C": (7.1, 4.6)}
#: What must be reached: from the second robot's first sighting to the proposal [s], and of its place [m].
WITHIN_S, WITHIN_M = 10.0, 0.05
#: Time limit for the first proposal, and time for which robots look at the chair [s].
LIMIT_S, LOOK_S = 120.0, 90.0


class Found(NamedTuple):
    """What was found of the chair. seen_s: when each robot published it first, since the first of them [s]. after_s:
    from the second one to the proposal [s]. first_off_m, off_m: of its place then, and when all had looked [m]."""

    seen_s: dict[str, float]
    after_s: float
    first_off_m: float
    off_m: float
    certainty: float

    @property
    def is_good(self) -> bool:
        return self.after_s <= WITHIN_S and self.off_m <= WITHIN_M

    def __str__(self) -> str:
        first_mm, last_mm = 1000.0 * self.first_off_m, 1000.0 * self.off_m
        when = f"proposed {self.after_s:.1f} s after the second sighting"
        return f"{when}, {first_mm:.0f} mm from the chair; {last_mm:.0f} mm when all had looked"


def main(arguments: Sequence[str] | None = None) -> int:
    given = _parse(arguments)
    folder: Path = given.folder

    def show(state: Path, logs: Path, console: Console) -> bool:
        return play(folder, state, logs, console, given.console)

    return present(folder, "console" if given.console else "films", show)


def play(folder: Path, state: Path, logs: Path, console: Console, with_browser: bool = False) -> bool:
    """Run the demo; whether the chair was found in time and place. with_browser: serve the operator's console, where
    the user accepts the proposal, and wait for Ctrl-C at the end. Raises RoboCorbaError, CORBA.Exception."""
    with contextlib.ExitStack() as stack:
        with starting("Servers", console):
            options = ["--building", str(sample_path(BUILDING)), "--subnets", "lab,hall"]
            if with_browser:
                options += ["--console", "--console-port", "0"]
            naming = stack.enter_context(servers(state, *options))
        if with_browser:
            console.print(f"  [bold]console: {console_address(state)}[/bold]")
        orb = stack.enter_context(Orb(naming))
        chair = RemoteSession(orb, Description(CHAIR, Pose(FLOOR, *AT, 0.0), RADIUS_M, 5.0, Limits()))
        chair.log_on()  # a body that reports its place to nobody
        chair.state()
        editor, is_drawn = RemoteMapEditor(orb), threading.Event()
        stack.callback(Repeating(CHAIR, lambda: _keep(chair, editor, is_drawn), 0.1).start().close)
        with starting("Robots", console):
            start_robots(stack, ROBOTS, naming, state, logs, "--perceive", "sensors")
        console.print(f"  a chair at {place(FLOOR, *AT)} that no map has")
        console.print(f"  path from A's lookout to C's: {_path_m(orb):.2f} m, through the chair")
        found = _find(orb, chair, console)
        camera = Camera(orb, [FLOOR], WIDTH_PX)
        (folder / "proposed.png").write_bytes(camera.png())
        console.print(f"  path from A's lookout to C's: {_path_m(orb):.2f} m, around the proposal")
        if with_browser:
            console.print("Accept the proposal on the console's map page.")
            wait_for_ctrl_c(console, console_address(state))
        else:
            _accept(editor, console)
            time.sleep(1.0)  # until the simulation has its object
            (folder / "accepted.png").write_bytes(camera.png())
        (folder / "perception.json").write_bytes(msgspec.json.format(msgspec.json.encode(found._asdict())))
        console.print(f"[{'green' if found.is_good else 'red'}]{found}[/]")
    return found.is_good


def _keep(chair: RemoteSession, editor: RemoteMapEditor, is_drawn: threading.Event) -> None:
    """Keep the chair's body until the map has the chair: the simulation then has a body for that. On a machine that is
    so busy that the lease expires it logs on again, as a robot does."""
    with contextlib.suppress(RoboCorbaError):  # a server may be gone at the end
        if is_drawn.is_set():
            return
        try:
            chair.state()
        except RobotLost:
            chair.log_on()
        if editor.version() > FIRST_VERSION:
            is_drawn.set()
            chair.log_off()


def _path_m(orb: Orb) -> float:
    """The length of the path from A's lookout to C's [m]."""
    start, goal = (Place(FLOOR, *LOOKOUTS[name]) for name in "AC")
    return RemotePlanner(orb).paths(PathRequest(start, goal))[0].distance


def _find(orb: Orb, chair: RemoteSession, console: Console) -> Found:
    """Let the robots look from three sides, and wait for the proposal. Raises MissionFailed if there is none."""
    seen: dict[str, float] = {}

    def receive(event: Event) -> None:
        near = [each for each in seen_of(event.payload) if math.dist((each.x, each.y), AT) < 3.0 * RADIUS_M]
        if near and event.source not in seen:
            seen[event.source] = time.monotonic()
            line(
                f"  {event.source} sees something {1000 * _off_m((near[0].x, near[0].y), chair):.0f} mm from the chair"
            )

    console.print("[bold]Robots[/bold] look at it from three sides")
    with EventClient(orb, "lab") as events:
        events.subscribe(receive, SIGHTING_EVENT)
        for name, (x, y) in LOOKOUTS.items():
            heading = math.atan2(AT[1] - y, AT[0] - x)
            program = ProgramBuilder("look").mbase_path(FLOOR, x, y, heading).wait(LOOK_S).program()
            agent = RemoteAgent(orb, name)
            agent.load(dumps(program))
            agent.run()
        first = _wait_for_proposal(orb)
        proposed = time.monotonic()
        # The map editor may have received the second sighting before this process has.
        if not Backoff(0.1, 0.1).poll(lambda: len(seen) > 1, LIMIT_S):
            raise MissionFailed(f"a proposal came after sightings of {len(seen)} robots")
        line(f"  proposed: {first.name}, seen by {' and '.join(first.seen_by)}, {first.certainty:.2f}")
        agents = [RemoteAgent(orb, name) for name in ROBOTS]
        is_there = Backoff(0.2, 0.2).poll(lambda: all(len(agent.begun(0)) > 1 for agent in agents), LIMIT_S)
        if not is_there:
            raise MissionFailed(f"not all robots were at their lookouts within {LIMIT_S:g} s")
        time.sleep(3.0)  # for a look from there
        last = _wait_for_proposal(orb)
    times = sorted(seen.values())
    since_first = {name: when - times[0] for name, when in seen.items()}
    first_off_m, off_m = (_off_m(each.element.at, chair) for each in (first, last))
    return Found(since_first, proposed - times[1], first_off_m, off_m, last.certainty)


def _wait_for_proposal(orb: Orb) -> Proposal:
    editor = RemoteMapEditor(orb)
    if not Backoff(0.1, 0.1).poll(lambda: bool(editor.proposals()), LIMIT_S):
        raise MissionFailed(f"no proposal within {LIMIT_S:g} s")
    return min(editor.proposals(), key=lambda each: math.dist(each.element.at, AT))


def _off_m(at: XY, chair: RemoteSession) -> float:
    """Distance from the chair, by the simulation server's latest answer [m]."""
    pose = chair.latest.at
    return math.dist(at, (pose.x, pose.y))


def _accept(editor: RemoteMapEditor, console: Console) -> None:
    session = editor.open_session("perception demo")
    for proposal in editor.proposals():
        version = session.accept_proposal(proposal.name)
        console.print(f"  accepted: {proposal.name} is on the map, version {version}")
    session.close()


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    what = (__doc__ or "").split("\n\n")[0]
    parser = argparse.ArgumentParser(prog="robocorba.clients.perception_demo", description=what)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("perception-output"), metavar="FOLDER")
    parser.add_argument("--console", action="store_true", help="show it in the browser, until Ctrl-C")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

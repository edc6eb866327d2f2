"""The paper's Figure 11: a robot hands a sheet of paper to another one. The same two programs run on virtual and on
actual robots.

    python -m robocorba.clients.hand_over [FOLDER] [--actual] [--no-film] [--naming HOST:PORT] [--channel C]
    python -m robocorba.clients.hand_over FOLDER --write-programs

Without --naming it starts its own servers; otherwise those at HOST:PORT must serve the building `paper-scene`. It
writes a recording of the floor (MCAP), all joint positions (CSV) and a film of all links (MP4) to FOLDER (default:
demo-output). Exit code 0 only if the hand-over was correct."""

from __future__ import annotations

import argparse
import contextlib
import csv
import math
import signal
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from omniORB import CORBA

from robocorba.clients.hand_over_facts import GIVING, TAKING, Moment, facts, faults
from robocorba.clients.robot_processes import ActualRobot, ReadyProcess, robocorba, servers
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MotionFailed
from robocorba.map_editor.samples import sample_path
from robocorba.orb.calls import error_of
from robocorba.orb.orb import Orb
from robocorba.robot.agent import AgentState
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics import tasks
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs import icons
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import Program, dumps, icons_with_paths
from robocorba.robot.runner import ProgramResult
from robocorba.system.extras import require_extra
from robocorba.system.printing import fail, line
from robocorba.system.settings import Address

BUILDING, CHANNEL, FLOOR = "paper-scene", "lab", "L1"
GIVER, TAKER = "A", "B"
#: Start poses and meeting poses [m, m, rad].
START_POSES = {GIVER: (4.9, 4.5, 0.0), TAKER: (7.6, 2.6, math.pi)}
MEETING_POSES = {GIVER: (5.6, 3.6, 0.0), TAKER: (6.8, 3.6, math.pi)}
#: Height of the sheet, and its offset to the left of the giver [m].
SHEET_HEIGHT_M, SHEET_LEFT_M = 1.0, -0.15
#: Distances that a hand draws back and that a base backs off [m].
HAND_RETREAT_M, BASE_RETREAT_M = 0.1, 0.3
SHEET_WIDTH_M = 0.21
#: Timeout of waiting for an event of the other robot [s].
EVENT_TIMEOUT_S = 30.0
#: Time for which both robots hold the sheet [s].
BOTH_HOLD_S = 0.5
READY, GRIPPED, RELEASED = "hand_over.ready", "hand_over.gripped", "hand_over.released"
#: Interval between samples of the robots' states [s].
SAMPLE_INTERVAL_S = 0.05
#: Timeout of the programs [s].
PROGRAM_TIMEOUT_S = 120.0
#: Frame rate of the film [1/s].
FPS = 10


# ---- the two programs ----


def programs() -> dict[str, Program]:
    """The programs of giver and taker, for the poses of the sheet's ends."""
    distance_m = math.dist(MEETING_POSES[GIVER][:2], MEETING_POSES[TAKER][:2])
    giver, taker = tasks.hand_over(distance_m, SHEET_HEIGHT_M, SHEET_LEFT_M)
    return {GIVER: giving(giver), TAKER: taking(taker)}


def giving(end: HandPose) -> Program:
    """Hold out the sheet and let go of it after the taker has gripped it. end: pose of the hand at the sheet's end."""
    hand: icons.Hand = GIVING.value
    giver = ProgramBuilder("hand-over-giver")
    giver.mhand_posture("both", "carry").gripper(hand, "close")
    giver.mbase_path(FLOOR, *MEETING_POSES[GIVER])
    giver.mhand_pose(hand, *_rounded(end)).say(READY)
    giver.wait_until(icons.Event(GRIPPED, TAKER), EVENT_TIMEOUT_S)
    with giver.branch(icons.Result("done")):
        giver.wait(BOTH_HOLD_S).gripper(hand, "open").say(RELEASED)
    giver.mhand_pose(hand, *_rounded(end.moved(-HAND_RETREAT_M))).mbase_by(ahead=-BASE_RETREAT_M)
    return giver.program()


def taking(end: HandPose) -> Program:
    """Wait in front of the sheet, grip it, and draw it back after the giver has let go. end: as for `giving`."""
    hand: icons.Hand = TAKING.value
    taker = ProgramBuilder("hand-over-taker")
    taker.mhand_posture("both", "carry").gripper(hand, "open")
    taker.mbase_path(FLOOR, *MEETING_POSES[TAKER])
    taker.mhand_pose(hand, *_rounded(end.moved(-HAND_RETREAT_M)))
    taker.wait_until(icons.Event(READY, GIVER), EVENT_TIMEOUT_S)
    with taker.branch(icons.Result("done")):
        taker.mhand_pose(hand, *_rounded(end)).gripper(hand, "close").say(GRIPPED)
        taker.wait_until(icons.Event(RELEASED, GIVER), EVENT_TIMEOUT_S)
    with taker.branch(icons.Result("timed_out")):
        taker.gripper(hand, "open")
    taker.mhand_pose(hand, *_rounded(end.moved(-HAND_RETREAT_M))).mbase_by(ahead=-BASE_RETREAT_M)
    return taker.program()


def write_programs(folder: Path) -> None:
    """Write the samples hand-over-giver.json and hand-over-taker.json."""
    for program in programs().values():
        (folder / f"{program.name}.json").write_text(dumps(program))


def _rounded(pose: HandPose) -> list[float]:
    return [round(value, 4) for value in pose]


# ---- running them ----


def main(arguments: Sequence[str] | None = None) -> int:
    given = _parse(arguments)
    folder: Path = given.folder
    folder.mkdir(parents=True, exist_ok=True)
    if given.write_programs:
        write_programs(folder)
        return 0
    require_extra("films" if given.film else "recordings", "films and recordings")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("hand_over: ended"))  # ends child processes, too
    name = f"hand-over-{'actual' if given.actual else 'virtual'}"
    mcap = folder / f"{name}.mcap"
    mcap.unlink(missing_ok=True)
    with contextlib.ExitStack() as stack:
        state = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="robocorba-hand-over-")))
        if given.naming:
            naming = Address.parse(given.naming, "--naming")
        else:
            options = ("--building", str(sample_path(BUILDING)), "--subnets", given.channel)
            naming = stack.enter_context(servers(state / "system", *options))
        orb = stack.enter_context(Orb(naming))
        command = (robocorba(), "record", str(mcap), "--floor", FLOOR, "--naming", str(naming))
        recorder = stack.enter_context(ReadyProcess(state / "record.log", *command))
        agents = _robots(stack, orb, state, given.channel, given.actual)
        recorder.wait_file(mcap)
        moments = play(agents, programs())
    found = facts(moments)
    write_moments(folder / f"{name}.csv", moments)
    found_faults = faults(found)
    distance_mm, height_mm = 1000 * found.distance_error_m, 1000 * found.height_error_m
    line(
        f"The taker's gripper was shut after {found.gripped_s:.2f} s, "
        f"the giver's opened after {found.released_s:.2f} s. "
        f"Largest errors in between: hands {distance_mm:.1f} mm from the sheet's ends, "
        f"height difference {height_mm:.1f} mm, misalignment {math.degrees(found.angle_error_rad):.2f} deg."
    )
    wrote = [mcap.name, f"{name}.csv"]
    if given.film:
        film(folder / f"{name}.mp4", moments, found.released_s)
        wrote.append(f"{name}.mp4")
    line(f"wrote {', '.join(wrote)} in {folder}")
    for fault in found_faults:
        line(f"wrong: {fault}")
    return 1 if found_faults else 0


def play(agents: Mapping[str, RemoteAgent], wanted: Mapping[str, Program]) -> list[Moment]:
    """Run both programs, the taker's first: it must receive the giver's `ready`. Prints each icon that begins.

    Raises MotionFailed if a program fails or does not end within PROGRAM_TIMEOUT_S."""
    for name, agent in agents.items():
        agent.load(dumps(wanted[name]))
    began = time.monotonic()
    since = {}
    for name in (TAKER, GIVER):
        since[name] = time.monotonic() - began
        agents[name].run()
    printed = dict.fromkeys(agents, 0)
    moments: list[Moment] = []
    try:
        while True:
            states = {name: agent.state() for name, agent in agents.items()}
            moments.append(Moment(time.monotonic() - began, states[GIVER].actor, states[TAKER].actor))
            for name, agent in agents.items():
                for icon in agent.begun(printed[name]):
                    line(f"{since[name] + icon.seconds:6.2f} s  {name}  {_describe(wanted[name], icon.icon)}")
                    printed[name] = icon.number + 1
            if _have_ended(states):
                return moments
            if moments[-1].seconds > PROGRAM_TIMEOUT_S:
                raise MotionFailed(f"the programs did not end within {PROGRAM_TIMEOUT_S:g} s")
            time.sleep(max(0.0, began + len(moments) * SAMPLE_INTERVAL_S - time.monotonic()))
    finally:
        for agent in agents.values():
            agent.abort()  # no effect on a program that has ended


def _robots(
    stack: contextlib.ExitStack, orb: Orb, state: Path, channel: str, are_actual: bool
) -> dict[str, RemoteAgent]:
    """Start the robots simultaneously; they run until the end of the `stack`."""
    actual = {name: stack.enter_context(ActualRobot(state / name)) for name in START_POSES if are_actual}
    for robot in actual.values():
        robot.wait_ready(orb)
    running = []
    for name, at in START_POSES.items():
        place = ("--floor", FLOOR, "--at", ",".join(map(str, at)), "--channel", channel)
        command = (robocorba(), "robot", name, *place, "--naming", str(orb.naming), "--state", str(state))
        adaptor = ("--adaptor", "smartpal", "--", "--naming", str(actual[name].naming)) if are_actual else ()
        running.append(stack.enter_context(ReadyProcess(state / f"robot-{name}.log", *command, *adaptor)))
    for process in running:
        process.wait_ready()
    return {name: RemoteAgent(orb, name) for name in START_POSES}


def _have_ended(states: Mapping[str, AgentState]) -> bool:
    """Whether all programs are done. Raises MotionFailed if one has failed."""
    for name, state in states.items():
        report = state.program
        if report.result not in (ProgramResult.NO_RESULT, ProgramResult.DONE):
            raise MotionFailed(f"{name}: {report.icon} {report.kind}: {report.reason}")
    return all(state.program.result is ProgramResult.DONE for state in states.values())


def _describe(program: Program, path: str) -> str:
    """An icon in words, such as: gripper right close."""
    icon = dict(icons_with_paths(program))[path]
    about = getattr(icon, "condition", icon)
    parts = (getattr(about, name, None) for name in ("hand", "action", "posture", "type", "result"))
    return " ".join([icons.kind(icon), *filter(None, parts)])


# ---- the results ----


def write_moments(file: Path, moments: Sequence[Moment]) -> None:
    """Write a row for each robot and moment [s, m, rad]."""
    with file.open("w", newline="") as target:
        rows = csv.writer(target)
        rows.writerow(("seconds", "robot", "x", "y", "heading", *JOINTS))
        for moment in moments:
            for name, state in ((GIVER, moment.giver), (TAKER, moment.taker)):
                values = (state.x, state.y, state.heading, *state.joints)
                rows.writerow((f"{moment.seconds:.3f}", name, *(f"{value:.6f}" for value in values)))


def film(file: Path, moments: Sequence[Moment], released_s: float) -> None:
    """Write a film in real time. The sheet moves with the giver's hand until the giver lets go."""
    from robocorba.clients.robot_film import RobotShapes, Views, sheet
    from robocorba.console.video import VideoFile

    shapes, views = RobotShapes(), Views(4.3, 1.9, 8.3, 5.1)
    every = round(1 / FPS / SAMPLE_INTERVAL_S)
    with VideoFile(file, *views.size, FPS) as video:
        for moment in moments[::every]:
            state, side = (moment.giver, GIVING) if moment.seconds < released_s else (moment.taker, TAKING)
            paper = sheet(shapes.body.hand(side, state.joints), state, tasks.SHEET_M, SHEET_WIDTH_M, tasks.GRIP_DEPTH_M)
            drawn = [*shapes.at(moment.giver), *shapes.at(moment.taker), paper]
            holds = f"{GIVER}, on the left," if state is moment.giver else f"{TAKER}, on the right,"
            video.add(views.draw(drawn, [(0.0, f"{moment.seconds:.1f} s"), (0.15, f"{holds} holds the sheet")]))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="robocorba.clients.hand_over", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("demo-output"), metavar="FOLDER")
    parser.add_argument("--actual", action="store_true", help="use two simulated actual robots (servers/smartpal)")
    parser.add_argument("--naming", metavar="HOST:PORT", help="naming service of running servers")
    parser.add_argument(
        "--channel", default=CHANNEL, metavar="C", help="event channel of both robots (default: %(default)s)"
    )
    parser.add_argument("--no-film", dest="film", action="store_false", help="write no film, which takes a while")
    parser.add_argument("--write-programs", action="store_true", help="only write the two programs into FOLDER")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RoboCorbaError, CORBA.Exception) as error:
        fail(f"hand_over: {error_of(error)}")

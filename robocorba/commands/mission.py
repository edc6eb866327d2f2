"""robocorba mission: list missions, start one, show its status, abort it, and print its report."""

from __future__ import annotations

import contextlib
import glob
import json
import math
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from robocorba.commands.options import Json, Naming, connected, only_for
from robocorba.commands.reporting import reporting
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.commands.waiting import RESOLVE_TIMEOUT_S, Outage, StopSignal, progress
from robocorba.errors.paths import InvalidRequest
from robocorba.errors.services import NotReachable, ServiceError
from robocorba.errors.simulation import NoLeader
from robocorba.system.extras import require_extra
from robocorba.system.names import MISSIONS
from robocorba.system.printing import echo, line
from robocorba.system.settings import state_folder

if TYPE_CHECKING:
    from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
    from robocorba.orb.orb import Orb
    from robocorba.robot.programs.icons import Destination
    from robocorba.simulation.corba.remote_database import RemoteDatabase
    from robocorba.simulation.mission_record import MissionContent, MissionState
    from robocorba.simulation.store import Mission

#: Interval between queries of the leader [s].
POLL_INTERVAL_S = 0.2

app = typer.Typer(no_args_is_help=True)
start_app = typer.Typer(help="Start a mission.", no_args_is_help=True)
app.add_typer(start_app, name="start")
LeaderName = Annotated[
    str, typer.Option("--leader", metavar="ROBOT", help="Robot that leads. Default: the nearest free one.")
]
MissionName = Annotated[str, typer.Argument(metavar="[MISSION]", help="Name of the mission, as `list` shows it.")]
LeaderOption = Annotated[
    str, typer.Option("--leader", metavar="ROBOT", help="Robot that leads the mission, instead of a name.")
]


@start_app.command("move-table")
def move_table(
    table: Annotated[str, typer.Option(metavar="NAME", help="Table, or other object, to carry.")],
    to: Annotated[
        str, typer.Option(metavar="FLOOR:X,Y[,HEADING]", help="Goal of its centre [m], and heading there [rad].")
    ],
    leader: LeaderName = "",
    carriers: Annotated[
        int | None, typer.Option(metavar="N", min=2, max=6, help="Number of carriers. Default: by its mass.")
    ] = None,
    recovery_timeout: Annotated[
        float | None,
        typer.Option(metavar="S", min=1.0, max=3600.0, help="Limit for recovery from faults [s]. Default: 60."),
    ] = None,
    naming: Naming = None,
) -> None:
    """Carry a table to a goal with helpers that the leader finds. Ctrl-C ends it safely.

    Exit code 0 if the table is at its goal, else 1."""
    import msgspec

    from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
    from robocorba.robot.programs.icons import MoveTable

    with connected("mission", naming) as orb:
        icon = msgspec.json.encode(MoveTable(table, parse_destination(to), recovery_timeout, carriers)).decode()
        control = RemoteMissionControl(orb)
        stop = StopSignal()
        end = _print_progress(control, control.start(leader, icon), stop)
    line(end.result, f"{end.seconds:.1f} s", *filter(None, [end.reason]))
    if end.result != "done":
        raise typer.Exit(1)


@app.command("list")
def list_missions(naming: Naming = None, as_json: Json = False) -> None:
    """List missions that run and the latest that have ended, wherever they were started."""
    from robocorba.missions.corba.remote_mission_control import RemoteMissionControl

    with connected("mission", naming) as orb:
        states = sorted(RemoteMissionControl(orb).missions_since(0), key=lambda state: state.content.begun)
        records = _database(orb).missions() if as_json else {}
    if as_json:
        print_json([record_json(state, records[state.name]) for state in states if state.name in records])
        return
    rows = []
    for state in states:
        content = state.content
        seconds = (content.ended or time.time()) - content.begun
        is_today = time.time() - content.begun < 43200
        began = time.strftime("%H:%M:%S" if is_today else "%m-%d %H:%M", time.localtime(content.begun))
        task = f"{content.kind.replace('_', ' ')} {content.about}"
        phase = content.phases[-1].name if content.phases and content.is_running else ""
        took = f"{max(0.0, seconds):.0f} s"
        rows.append((state.name, task, content.leader, began, took, phase, content.result.value))
    titles = ("mission", "task", "leader", "began", "took", "phase", "result")
    show(Sheet(titles, rows, spare=("began", "took", "leader", "task")))


@app.command()
def status(
    context: typer.Context,
    name: MissionName = "",
    leader: LeaderOption = "",
    naming: Naming = None,
    as_json: Json = False,
) -> None:
    """Show the phases of a mission. With --leader, show the plan and the present phase."""
    from robocorba.missions.corba.remote_mission_control import RemoteMissionControl

    only_for("a mission by its name", name or not leader, context, "as_json")
    with connected("mission", naming) as orb:
        if not _is_by_name(name, leader):
            _print_plan(orb, leader)
            return
        control = RemoteMissionControl(orb)
        state, leaders = control.mission(name), control.leaders(name)
        record = _database(orb).mission(name) if as_json else None
    if record:
        print_json(record_json(state, record))
        return
    content = state.content
    phases = []
    for phase in content.phases:
        duration = f"{phase.ended - phase.begun:.1f}" if phase.ended else ""
        phases.append((phase.name, f"{phase.begun - content.begun:.1f}", duration, phase.waited_for))
    title = f"{name}: {content.kind.replace('_', ' ')} {content.about}, {content.result.value}"
    robots = ", ".join(f"{member.robot} ({member.role})" for member in content.members)
    count = f"{len(content.phases)} of {content.phases_in_all} phases have begun; " if content.phases_in_all else ""
    notes = [f"{count}led by {content.leader}, term {content.term}; robots: {robots or 'not yet known'}"]
    for each in leaders[1:]:
        after_s = each.since - content.begun
        notes.append(f"{each.robot} took over in term {each.term} after {after_s:.1f} s: {each.reason}")
    notes += filter(None, [content.reason])
    show(Sheet(("phase", "from [s]", "duration [s]", "waited for"), phases, title=title, notes=notes))


@app.command()
def abort(name: MissionName = "", leader: LeaderOption = "", naming: Naming = None) -> None:
    """Abort a mission. Its robots put down what they hold and are free again.

    Prefer the name: with --leader you abort whatever the robot leads when the command arrives."""
    from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
    from robocorba.robot.corba.remote_agent import RemoteAgent

    with connected("mission", naming) as orb:
        if _is_by_name(name, leader):
            RemoteMissionControl(orb).abort(name)
        else:
            RemoteAgent(orb, leader).abort()


@app.command()
def report(
    mission: Annotated[str, typer.Argument(help="Name of the mission, or its beginning. Default: the latest.")] = "",
    state: Annotated[
        Path | None, typer.Option(metavar="DIR", help="State folder of the leader. Default: ROBOCORBA_STATE.")
    ] = None,
    as_json: Json = False,
    naming: Naming = None,
) -> None:
    """Print the report of a mission that has ended, and write it as a web page beside its JSON.

    If the state folder has no report, the full name is looked up in the running system."""
    from robocorba.missions import page, timeline
    from robocorba.missions.report import REPORT_FILE

    with reporting("mission"):
        folder = state_folder(state) / MISSIONS
        pattern = f"{glob.escape(mission)}*/{REPORT_FILE}"
        found = sorted(folder.glob(pattern), key=lambda file: file.stat().st_mtime)
        if found:
            file = found[-1]
            content = json.loads(file.read_text())
        elif mission:
            content = _remote_report(mission, naming)
            file = folder / _file_name(mission) / REPORT_FILE
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(content, indent=1))
        else:
            raise ServiceError(f"no report of a mission in {folder}; name one of `robocorba mission list`")
        pictures = []
        try:
            require_extra("films", "timelines")
            timeline.draw(content, file.parent / timeline.PICTURE)
            pictures = [(timeline.PICTURE, timeline.CAPTION)]
        except ServiceError as error:
            line(f"note: {error}", err=True)
        written = page.write(content, file.parent, pictures)
        if as_json:
            print_json(content)
            return
        show(*sheets(content))
        echo(f"wrote {written}")


def _is_by_name(name: str, leader: str) -> bool:
    """Whether a mission is chosen by its name. Raises InvalidRequest unless by either name or leader."""
    if bool(name) == bool(leader):
        raise InvalidRequest("mission", "give either the name of a mission, or --leader ROBOT")
    return bool(name)


def _remote_report(mission: str, naming: str | None) -> dict[str, Any]:
    from robocorba.missions.corba.remote_mission_control import RemoteMissionControl

    with connected("mission", naming) as orb:
        control = RemoteMissionControl(orb)
        if control.mission(mission).content.is_running:
            raise ServiceError(f"mission {mission!r} is still running; `robocorba mission status` shows its phases")
        return control.report(mission)


def _file_name(mission: str) -> str:
    """A name for a folder; a mission's name may have any character."""
    name = re.sub(r"[^\w.-]", "_", mission)[:100]
    return name if name.strip(".") else "mission"


def _database(orb: Orb) -> RemoteDatabase:
    from robocorba.simulation.corba.remote_database import RemoteDatabase

    return RemoteDatabase(orb, RESOLVE_TIMEOUT_S)


def record_json(state: MissionState, record: Mission) -> dict[str, Any]:
    """What `--json` prints of a mission: name and version by mission control, and all members of its record."""
    import msgspec

    from robocorba.simulation.mission_record import MissionContent

    content: dict[str, Any] = msgspec.to_builtins(MissionContent.decode(record.document))
    return {"name": state.name, "version": state.version, **content}


def _print_plan(orb: Orb, leader: str) -> None:
    """Print plan and phase of the mission that a robot leads, or led last."""
    from robocorba.missions.subplan import StoredPlan
    from robocorba.robot.corba.remote_data_pool import RemotePool

    plans = RemotePool(orb, leader, 3.0).plans()
    if not plans:
        echo(f"{leader} has led no mission")
        return
    stored = StoredPlan.decode(plans[-1].content)
    plan = stored.plan
    titles = ("phase", *(f"{subplan.robot} ({subplan.role})" for subplan in plan.subplans))
    rows = [
        (phase, *(type(subplan.steps[number]).__name__ for subplan in plan.subplans))
        for number, phase in enumerate(plan.phases)
    ]
    show(Sheet(titles, rows, title=f"{plan.mission}: {plan.kind} {plan.thing}, {stored.phase}"))


def sheets(report: dict[str, Any]) -> list[Sheet]:
    """Tables of the phases and of the message latencies. report: as returned by MissionReport.as_json."""
    from robocorba.missions import page

    title, reasons = f"{report['mission']}: {report['result']}", list(filter(None, [report["reason"]]))
    return [
        Sheet(page.PHASES, list(page.phases(report)), title=title, notes=reasons),
        Sheet(page.LATENCIES, list(page.latencies(report)), title=page.LATENCIES_TITLE),
    ]


def parse_destination(text: str) -> Destination:
    """FLOOR:X,Y[,HEADING]. Raises InvalidRequest."""
    from robocorba.robot.programs.icons import Destination

    match = re.fullmatch(r"(.+):([^,:]+),([^,:]+)(?:,([^,:]+))?", text)
    try:
        if match:
            x, y, heading = float(match[2]), float(match[3]), float(match[4] or 0.0)
            if math.isfinite(x) and math.isfinite(y) and math.isfinite(heading):
                return Destination(match[1], x, y, heading)
    except ValueError:
        pass
    raise InvalidRequest("to", f"{text[:80]!r} is not of the form FLOOR:X,Y or FLOOR:X,Y,HEADING, such as L1:12,3")


class MissionStatus(NamedTuple):
    """The progress of a mission. share: of the phases that have ended. result: empty while the mission runs; reason: of
    a failure."""

    phase: str
    leader: str
    robots: tuple[str, ...]
    share: float
    seconds: float
    result: str
    reason: str


def follow_mission(
    control: RemoteMissionControl, name: str, wait: Callable[[float], object]
) -> Iterator[MissionStatus]:
    """The progress of a mission until its end, under all its leaders; `wait` is called with the seconds in between.

    Raises UnknownMission, and NotReachable if mission control is not reachable for OUTAGE_LIMIT_S."""
    outage = Outage()
    before: MissionContent | None = None
    while True:
        try:
            content = control.mission(name).content
            outage.note_answer()
        except NotReachable as error:
            outage.note_failure(error)
        else:
            if content != before:
                before, noted_s = content, time.monotonic()
            # The clock of its leader may be another.
            since_then_s = time.monotonic() - noted_s if content.is_running else 0.0
            ended = sum(phase.ended > 0.0 for phase in content.phases)
            result = "" if content.is_running else content.result.value
            yield MissionStatus(
                content.phases[-1].name if content.phases else "",
                content.leader,
                tuple(member.robot for member in content.members),
                min(1.0, ended / content.phases_in_all) if content.phases_in_all else 0.0,
                content.latest - content.begun + since_then_s,
                result,
                content.reason,
            )
            if result:
                return
        wait(POLL_INTERVAL_S)


def _print_progress(control: RemoteMissionControl, name: str, stop: StopSignal) -> MissionStatus:
    """Print each phase that begins, and each change of the leader, until a mission has ended; return its end."""
    printed, leader, is_ending = "", "", False

    def wait(seconds: float) -> None:
        if stop.wait(seconds):  # returns immediately after a Ctrl-C
            time.sleep(seconds)

    with progress(1.0) as bar:
        for now in follow_mission(control, name, wait):
            if now.result:
                return now
            if leader != now.leader:
                line(f"{now.leader} leads", f"{now.seconds:.1f} s")
            if now.phase != printed:
                line(now.phase, ", ".join(now.robots), f"{now.seconds:.1f} s")
            printed, leader = now.phase, now.leader
            bar(now.share, printed)
            if stop.is_made and not is_ending:
                with contextlib.suppress(NoLeader, NotReachable):  # it has just ended, or changes its leader
                    control.abort(name)
                    is_ending = True
    raise NotReachable(f"mission {name} has no result")  # not reached: follow_mission ends with one

"""robocorba mission: start a mission, show its status, abort it, and print its report."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from robocorba.commands.options import Naming, connected
from robocorba.commands.reporting import reporting
from robocorba.commands.waiting import Outage, StopSignal, progress
from robocorba.errors.paths import InvalidRequest
from robocorba.errors.services import NotReachable, ServiceError
from robocorba.names import MISSIONS
from robocorba.settings import Settings

if TYPE_CHECKING:
    from robocorba.corba.remote.control_agent import RemoteAgent
    from robocorba.corba.remote.data_pool import RemotePool
    from robocorba.missions.subplan import StoredPlan
    from robocorba.programs.icons import Destination

#: Interval between queries of the leader [s].
POLL_INTERVAL_S = 0.2

app = typer.Typer(help="Missions of several robots.", no_args_is_help=True)
start_app = typer.Typer(help="Start a mission.", no_args_is_help=True)
app.add_typer(start_app, name="start")
LeaderName = Annotated[str, typer.Option("--leader", metavar="ROBOT", help="The robot that leads.")]


@start_app.command("move-table")
def move_table(
    table: Annotated[str, typer.Option(metavar="NAME", help="The object to carry.")],
    to: Annotated[
        str, typer.Option(metavar="FLOOR:X,Y[,HEADING]", help="Pose of its middle at the goal, in m and rad.")
    ],
    leader: LeaderName,
    naming: Naming = None,
) -> None:
    """Carry a table to a goal. The leader finds the helpers; Ctrl-C ends the mission safely. Exit code 0 if done."""
    from robocorba.corba.remote.control_agent import RemoteAgent
    from robocorba.corba.remote.data_pool import RemotePool
    from robocorba.programs.graphic_programming import ProgramBuilder
    from robocorba.programs.program import dumps

    stop = StopSignal()
    with connected("mission", naming) as orb:
        agent = RemoteAgent(orb, leader)
        agent.load(dumps(ProgramBuilder(f"move {table}").move_table(table, parse_destination(to)).program()))
        agent.run()
        result, reason, seconds = _print_progress(agent, RemotePool.of_robot(orb, leader), stop)
    typer.echo(f"{result}\t{seconds:.1f} s\t{reason}".rstrip())
    if result != "done":
        raise typer.Exit(1)


@app.command()
def status(leader: LeaderName, naming: Naming = None) -> None:
    """Show the plan and the phase of the mission that a robot leads, or led last."""
    from robocorba.corba.remote.data_pool import RemotePool

    with connected("mission", naming) as orb:
        stored = _latest(RemotePool.of_robot(orb, leader, 3.0))
    if stored is None:
        typer.echo(f"{leader} has led no mission")
        return
    plan = stored.plan
    table = Table(title=f"{plan.mission}: {plan.kind} {plan.thing}, {stored.phase}")
    table.add_column("phase")
    for subplan in plan.subplans:
        table.add_column(f"{subplan.robot} ({subplan.role})")
    for number, phase in enumerate(plan.phases):
        steps = [type(subplan.steps[number]).__name__ for subplan in plan.subplans]
        table.add_row(phase, *steps, style="bold" if phase == stored.phase else "")
    Console().print(table)


@app.command()
def abort(leader: LeaderName, naming: Naming = None) -> None:
    """Abort the mission that a robot leads: all robots put down what they hold, and are free."""
    from robocorba.corba.remote.control_agent import RemoteAgent

    with connected("mission", naming) as orb:
        RemoteAgent(orb, leader).abort()


@app.command()
def report(
    mission: Annotated[str, typer.Argument(help="Its name, or the beginning of it (default: the latest).")] = "",
    state: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The state folder of the leader [ROBOCORBA_STATE].")
    ] = None,
) -> None:
    """Print the report of a mission that has ended, and write it as a web page beside its JSON."""
    from robocorba.missions import page, timeline
    from robocorba.missions.report import REPORT_FILE

    with reporting("mission"):
        folder = Settings.read(state=state).state / MISSIONS
        found = sorted(folder.glob(f"{mission}*/{REPORT_FILE}"), key=lambda file: file.stat().st_mtime)
        if not found:
            raise ServiceError(f"no report of a mission {mission!r} in {folder}")
        file = found[-1]
        content = json.loads(file.read_text())
        timeline.draw(content, file.parent / timeline.PICTURE)
        written = page.write(content, file.parent, [(timeline.PICTURE, timeline.CAPTION)])
        for table in tables(content):
            Console().print(table)
        if content["reason"]:
            typer.echo(content["reason"])
        typer.echo(f"wrote {written}")


def tables(report: dict[str, Any]) -> list[Table]:
    """Tables of the phases and of the message latencies. report: as returned by MissionReport.as_json."""
    from robocorba.missions import page

    phases = Table(*map(escape, page.PHASES), title=f"{report['mission']}: {report['result']}", title_justify="left")
    for phase in page.phases(report):
        phases.add_row(*phase)
    messages = Table(*map(escape, page.LATENCIES), title=page.LATENCIES_TITLE, title_justify="left")
    for latency in page.latencies(report):
        messages.add_row(*latency)
    return [phases, messages]


def parse_destination(text: str) -> Destination:
    """FLOOR:X,Y[,HEADING]. Raises InvalidRequest."""
    from robocorba.programs.icons import Destination

    match = re.fullmatch(r"(.+):([^,:]+),([^,:]+)(?:,([^,:]+))?", text)
    try:
        if match:
            return Destination(match[1], float(match[2]), float(match[3]), float(match[4] or 0.0))
    except ValueError:
        pass
    raise InvalidRequest("to", f"{text[:80]!r} is not of the form FLOOR:X,Y or FLOOR:X,Y,HEADING, such as L1:12,3")


class MissionStatus(NamedTuple):
    """The progress of a mission. phase: empty before there is a plan. share: of the phases that are done. result: empty
    while the mission runs; reason: of a failure."""

    phase: str
    robots: tuple[str, ...]
    share: float
    seconds: float
    result: str
    reason: str


def follow_mission(agent: RemoteAgent, pool: RemotePool, wait: Callable[[float], object]) -> Iterator[MissionStatus]:
    """The progress of the mission that a robot leads, until its end; `wait` is called with the seconds in between.

    Raises NotReachable if the robot is not reachable for OUTAGE_LIMIT_S."""
    outage = Outage()
    while True:
        try:
            report, stored = agent.state().program, _latest(pool)
            outage.note_answer()
        except NotReachable as error:
            outage.note_failure(error)
        else:
            phase = stored.phase if stored else ""
            phases = stored.plan.phases if stored else ()
            robots = tuple(subplan.robot for subplan in stored.plan.subplans) if stored else ()
            share = phases.index(phase) / len(phases) if phase in phases else 0.0
            result = "" if report.result.name == "NO_RESULT" else report.result.name.lower()
            yield MissionStatus(phase, robots, share, report.seconds, result, report.reason)
            if result:
                return
        wait(POLL_INTERVAL_S)


def _print_progress(agent: RemoteAgent, pool: RemotePool, stop: StopSignal) -> tuple[str, str, float]:
    """Print each phase that begins, until the mission has ended; return result, reason and seconds."""
    printed, is_ending = "", False

    def wait(seconds: float) -> None:
        if stop.wait(seconds):  # returns immediately after a Ctrl-C
            time.sleep(seconds)

    with progress(1.0) as bar:
        for now in follow_mission(agent, pool, wait):
            if now.result:
                return now.result, now.reason, now.seconds
            if now.phase != printed:
                printed = now.phase
                typer.echo(f"{printed}\t{', '.join(now.robots)}\t{now.seconds:.1f} s")
            bar(now.share, printed)
            if stop.is_requested and not is_ending:
                is_ending = True
                agent.abort()
    raise NotReachable(f"robot {agent.name} reports no result")  # not reached: follow_mission ends with one


def _latest(pool: RemotePool) -> StoredPlan | None:
    from robocorba.missions.subplan import StoredPlan

    plans = pool.plans()
    return StoredPlan.decode(plans[-1].content) if plans else None

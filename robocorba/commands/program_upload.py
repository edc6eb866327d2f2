"""robocorba program upload, reports: programs that run on a robot's own computer, and what became of them."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path as File
from typing import Annotated

import typer

from robocorba.commands.options import Json, Naming, connected
from robocorba.commands.program import read
from robocorba.commands.program_run import app
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.system.printing import line

__all__ = ["app"]

_WHERE = "Name of the robot, or HOST:PORT of its computer."


@app.command()
def upload(
    file: Annotated[File, typer.Argument(metavar="FILE", help="Program file, or - for the standard input.")],
    robot: Annotated[str, typer.Option(metavar="NAME|HOST:PORT", help=_WHERE)],
    checked_by: Annotated[
        str | None, typer.Option(metavar="NAME", help="Robot that checks the program first, such as a virtual one.")
    ] = None,
    run: Annotated[bool, typer.Option("--run", help="Also run the program now.")] = False,
    naming: Naming = None,
) -> None:
    """Upload a program to a robot's own computer, on which `robocorba robot --agent-only` runs.

    Refused if map, robot or program have changed since the check."""
    from robocorba.robot.corba.remote_agent import RemoteAgent
    from robocorba.robot.programs.program import dumps

    with connected("program upload", naming) as orb:
        json, target = dumps(read("upload", file)), RemoteAgent(orb, robot)
        checker = RemoteAgent(orb, checked_by) if checked_by else target
        checked = checker.fingerprint(json)
        checker.check(json).require_valid()
        line(target.name, f"upload {target.upload(json, checked)}", checked)
        if run:
            target.run()
            line(target.name, "runs")


@app.command()
def reports(
    robot: Annotated[str, typer.Argument(metavar="NAME|HOST:PORT", help=_WHERE)],
    since: Annotated[str, typer.Option(metavar="NEXT", help="Only those after the `next` of an earlier JSON.")] = "",
    as_json: Json = False,
    naming: Naming = None,
) -> None:
    """Print how programs ended on a robot's own computer, even while it was out of reach."""
    from robocorba.robot.corba.remote_agent import RemoteAgent

    with connected("program reports", naming) as orb:
        found, following = RemoteAgent(orb, robot).reports(since)
    if as_json:
        print_json({"reports": [each.plain() for each in found], "next": following})
        return
    rows = [
        (
            *(each.number, datetime.fromtimestamp(each.ended).isoformat(" ", "seconds"), each.program.name),
            *(each.program.result.name.lower(), each.program.icons_done, f"{each.program.seconds:.1f} s"),
            *(f"{each.program.icon} {each.program.kind}", each.program.reason),
        )
        for each in found
    ]
    titles = ("number", "ended", "program", "result", "icons", "took", "at", "reason")
    show(Sheet(titles, rows, spare=("number", "icons", "took", "at")))

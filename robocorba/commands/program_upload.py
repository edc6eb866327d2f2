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

_WHERE = "The robot's name, or HOST:PORT of its computer."


@app.command()
def upload(
    file: Annotated[File, typer.Argument(metavar="FILE", help="A program, or - for the standard input.")],
    robot: Annotated[str, typer.Option(metavar="NAME|HOST:PORT", help=_WHERE)],
    checked_by: Annotated[
        str | None, typer.Option(metavar="NAME", help="The robot that checks it first, such as a virtual one.")
    ] = None,
    run: Annotated[bool, typer.Option("--run", help="Run it at once.")] = False,
    naming: Naming = None,
) -> None:
    """Upload a program to a robot's own computer, where `robocorba robot --agent-only` keeps it and runs it without
    this one. It is refused if map, robot or program are not those that it was checked against."""
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
    since: Annotated[str, typer.Option(metavar="NEXT", help="Those after an answer, by its `next` in JSON.")] = "",
    as_json: Json = False,
    naming: Naming = None,
) -> None:
    """Print how programs have ended on a robot's own computer, also those that ended while nobody could reach it."""
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

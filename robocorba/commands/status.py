"""robocorba status: what runs where, asked by real calls."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import msgspec
import psutil
import typer
from rich.console import Console
from rich.table import Table

from robocorba.corba.orb import CONTEXT, Orb
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.settings import Address, Settings
from robocorba.supervision.folder import ProcessRecord, StateFolder, SystemRecord
from robocorba.supervision.servers import probe_of

#: For each object to answer.
TIMEOUT_S = 2.0


class ObjectStatus(msgspec.Struct):
    """An object and the milliseconds of its answer, or the problem instead of one. The naming service has no name."""

    name: str
    answered_ms: float | None = None
    problem: str = ""


class ProcessStatus(msgspec.Struct):
    """A process: memory (resident) in MiB, uptime in s, restarts by the supervisor."""

    name: str
    state: str
    pid: int
    endpoint: str
    memory_mib: float
    uptime_s: float
    restarts: int
    objects: list[ObjectStatus]

    @property
    def is_well(self) -> bool:
        return self.state == "running" and all(thing.answered_ms is not None for thing in self.objects)


def status(
    state: Annotated[Path | None, typer.Option(metavar="DIR", help="The state folder [ROBOCORBA_STATE].")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show what runs where, and whether it answers. Exit code 0 if all is well, else 1."""
    try:
        settings = Settings.read(state=state)
        record = StateFolder(settings.state).read_record()
        alive = record if record is not None and record.is_alive else None
        processes = examine(alive) if alive else []
    except RoboCorbaError as wrong:
        typer.echo(f"robocorba status: {wrong}", err=True)
        raise typer.Exit(1) from None
    if json:
        answer = {"state": str(settings.state), "naming": alive.naming if alive else None, "processes": processes}
        print(msgspec.json.format(msgspec.json.encode(answer), indent=2).decode())
    elif alive is None:
        print(f"nothing runs in {settings.state}")
    else:
        _print(processes)
    if not processes or not all(process.is_well for process in processes):
        raise typer.Exit(1)


def examine(record: SystemRecord) -> list[ProcessStatus]:
    """Ask every object of a system, all at the same time. Takes a little over TIMEOUT_S at most."""
    with Orb(Address.parse(record.naming)) as orb:
        asked = [(process, name) for process in record.processes for name in process.names or ("",)]
        with ThreadPoolExecutor(len(asked) or 1) as threads:
            answers = list(threads.map(lambda item: _ask(orb, item[1]), asked))
    return [
        _measure(process, [answer for (owner, _), answer in zip(asked, answers, strict=True) if owner is process])
        for process in record.processes
    ]


def _ask(orb: Orb, name: str) -> ObjectStatus:
    key = name.removeprefix(f"{CONTEXT}/")
    probe = probe_of(key)
    try:
        if name and probe is None:
            return ObjectStatus(name, problem="not known to this version of robocorba")
        if probe:
            answered_ms = probe.ask(orb, key, TIMEOUT_S)
        else:
            began = time.perf_counter()
            orb.check_naming(TIMEOUT_S)
            answered_ms = (time.perf_counter() - began) * 1000
    except NotReachable as problem:
        return ObjectStatus(name, problem=str(problem))
    return ObjectStatus(name, answered_ms=round(answered_ms, 3))


def _measure(process: ProcessRecord, objects: list[ObjectStatus]) -> ProcessStatus:
    memory = 0
    if process.pid:
        try:
            memory = psutil.Process(process.pid).memory_info().rss
        except psutil.Error:
            process.state = "ended"
    return ProcessStatus(
        name=process.name,
        state=process.state,
        pid=process.pid,
        endpoint=process.endpoint,
        memory_mib=round(memory / 2**20, 1),
        uptime_s=round(time.time() - process.started, 1) if process.pid else 0.0,
        restarts=process.restarts,
        objects=objects,
    )


def _print(processes: list[ProcessStatus]) -> None:
    header = ("process", "state", "process id", "listens on", "memory", "up", "restarts", "object", "answer")
    rows: list[tuple[Any, ...]] = []
    for process in processes:
        facts: tuple[Any, ...] = (process.name, process.state, process.pid or "-", process.endpoint)
        facts += (f"{process.memory_mib:.0f} MiB", f"{process.uptime_s:.0f} s", process.restarts)
        for thing in process.objects:
            answer = thing.problem if thing.answered_ms is None else f"{thing.answered_ms:.2f} ms"
            rows.append((*facts, thing.name or "naming service", answer))
    console = Console()
    if console.is_terminal:
        table = Table(*header)
        for row in rows:
            table.add_row(*map(str, row))
        console.print(table)
    else:
        for row in rows:
            print(*row, sep="\t")

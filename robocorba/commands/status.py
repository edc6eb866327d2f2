"""robocorba status: the processes of a system, checked by real calls."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import psutil
import typer

from robocorba.commands.options import Json, State
from robocorba.commands.reporting import reporting
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import CONTEXT, Orb
from robocorba.robot.corba.remote_agent import displays
from robocorba.simulation.emergency_stops import ALL, UNTIL_RESET, read_records
from robocorba.system.corba.servers import probe_of
from robocorba.system.names import STOPS
from robocorba.system.printing import echo
from robocorba.system.settings import Address, state_folder
from robocorba.system.state_folder import ProcessRecord, StateFolder, SystemRecord, running_instances, started_s
from robocorba.system.supervision.system import NAMING_SERVICES

#: Timeout for each object [s].
TIMEOUT_S = 2.0


class ObjectStatus(msgspec.Struct):
    """An object with the duration of its answer or its problem. The name of the naming service is empty."""

    name: str
    answered_ms: float | None = None
    problem: str = ""


class ProcessStatus(msgspec.Struct):
    """A process with its resident memory and its restarts by the supervisor."""

    name: str
    state: str
    pid: int
    endpoint: str
    memory_mib: float
    uptime_s: float
    restarts: int
    objects: list[ObjectStatus]

    @property
    def is_healthy(self) -> bool:
        return self.state == "running" and all(status.answered_ms is not None for status in self.objects)


def status(state: State = None, json: Json = False) -> None:
    """Show all processes and check that they answer. Exit code 0 if all do, else 1."""
    with reporting("status"):
        folder = state_folder(state)
        record = StateFolder(folder).read_record()
        alive = record if record is not None and record.is_alive else None
        processes = check_objects(alive) if alive else []
        shown = robot_displays(alive) if alive else {}
        stops = read_records(folder / STOPS) if alive else {}
        held = stops[ALL].held if ALL in stops else ""
    if json:
        system = {"naming": alive and alive.naming, "hang_limit_s": alive and alive.hang_limit_s}
        more = {"stop_of_all": held or None, "processes": processes, "robots": shown}
        print_json({"state": str(folder), **system, **more})
    elif alive is None:
        others = ", ".join(running_instances())
        echo(f"nothing runs in {folder}{others and f'; instances that run: {others}'}")
    else:
        robots = Sheet(("robot", "shows", "text"), [(name, *display) for name, display in shown.items()])
        limit_s = alive.hang_limit_s
        notes = [f"all robots are stopped, {UNTIL_RESET} ({held})"] if held else []
        notes.append(f"a server without an answer for {limit_s:g} s is restarted" if limit_s else "servers may hang")
        show(sheet_of(processes, notes), *([robots] if shown else []))
    if not processes or not all(process.is_healthy for process in processes):
        raise typer.Exit(1)


def robot_displays(record: SystemRecord) -> dict[str, tuple[str, str]]:
    """What the robots of a system show on their touch panels: kind and text by name."""
    with Orb(Address.parse(record.naming)) as orb, contextlib.suppress(NotReachable):
        found = displays(orb).items()
        return {name: (of.kind.name.lower(), of.text) if of else ("unknown", "no answer") for name, of in found}
    return {}


def check_objects(record: SystemRecord) -> list[ProcessStatus]:
    """Call all objects of a system concurrently; takes little more than TIMEOUT_S at most."""
    with Orb(Address.parse(record.naming)) as orb:
        pairs = [
            (process, name)
            for process in record.processes
            for name in (("",) if process.name in NAMING_SERVICES else process.names)
        ]
        with ThreadPoolExecutor(len(pairs) or 1) as threads:
            answers = list(threads.map(lambda pair: _check(orb, pair[1]), pairs))
    return [
        _status(process, [answer for (owner, _), answer in zip(pairs, answers, strict=True) if owner is process])
        for process in record.processes
    ]


def _check(orb: Orb, name: str) -> ObjectStatus:
    key = name.removeprefix(f"{CONTEXT}/")
    probe = probe_of(key)
    try:
        if name and probe is None:
            return ObjectStatus(name, problem="unknown to this version of robocorba")
        if probe:
            answered_ms = probe.call_object(orb, key, TIMEOUT_S)
        else:
            began = time.perf_counter()
            orb.check_naming(TIMEOUT_S)
            answered_ms = (time.perf_counter() - began) * 1000
    except NotReachable as problem:
        return ObjectStatus(name, problem=str(problem))
    return ObjectStatus(name, answered_ms=round(answered_ms, 3))


def _status(process: ProcessRecord, objects: list[ObjectStatus]) -> ProcessStatus:
    memory, uptime_s = 0, 0.0
    if process.pid:
        try:
            memory = psutil.Process(process.pid).memory_info().rss
            uptime_s = time.clock_gettime(time.CLOCK_BOOTTIME) - started_s(process.pid)
        except (psutil.Error, OSError):
            process.state = "ended"
    return ProcessStatus(
        name=process.name,
        state=process.state,
        pid=process.pid,
        endpoint=process.endpoint,
        memory_mib=round(memory / 2**20, 1),
        uptime_s=round(uptime_s, 1),
        restarts=process.restarts,
        objects=objects,
    )


def sheet_of(processes: list[ProcessStatus], notes: Sequence[str] = ()) -> Sheet:
    """The processes, and each of their objects, as text."""
    titles = ("process", "state", "pid", "listens on", "memory", "up", "restarts", "object", "answer")
    rows: list[tuple[Any, ...]] = []
    for process in processes:
        cells: tuple[Any, ...] = (process.name, process.state, process.pid or "-", process.endpoint or "-")
        cells += (f"{process.memory_mib:.0f} MiB", f"{process.uptime_s:.0f} s", process.restarts)
        if not process.objects:
            rows.append((*cells, "-", "-"))
        for status in process.objects:
            answer = status.problem if status.answered_ms is None else f"{status.answered_ms:.2f} ms"
            rows.append((*cells, status.name.removeprefix(f"{CONTEXT}/") or "naming service", answer))
    return Sheet(titles, rows, spare=("memory", "listens on", "restarts", "up", "pid"), notes=notes)

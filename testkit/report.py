"""Reports the results of a bench: a table on the terminal, and bench/results/NAME.json, of which pages are made."""

from __future__ import annotations

import datetime
import json
import math
import operator
import os
import platform
import re
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "bench" / "results"
#: Console for the progress of a bench.
PROGRESS = Console(stderr=True)
#: Load average of the minute before the bench; results of a busy machine are unreliable.
LOAD_BEFORE = os.getloadavg()[0]
#: What may change a result.
PROGRAM = ("robocorba", "idl", "servers", "testkit", "bench", ":!bench/results")
#: Samples with more values are stored as percentiles, from the least to the greatest in steps of one.
MAX_VALUES = 500
T = TypeVar("T")


class NotMeasured(Exception):
    """What a bench needs is not there, such as the right to make network namespaces, or its measurement is invalid."""


class Mark(NamedTuple):
    """A requirement: `value` must be "at most" or "at least" (`relation`) `limit`."""

    what: str
    value: float
    relation: str
    limit: float

    @property
    def is_reached(self) -> bool:
        return bool((operator.le if self.relation == "at most" else operator.ge)(self.value, self.limit))

    @property
    def verdict(self) -> str:
        if math.isnan(self.value):
            return "not measured"
        return "reached" if self.is_reached else f"missed by {cell(abs(self.value - self.limit))}"


def at_most(what: str, value: float, limit: float) -> Mark:
    return Mark(what, value, "at most", limit)


def at_least(what: str, value: float, limit: float) -> Mark:
    return Mark(what, value, "at least", limit)


def cell(value: Any) -> str:
    """A value as text in a table."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:,}" if isinstance(value, int) else str(value)


class Run:
    """The run of a bench in this process, from now on.

    changed: options that differ from the standard ones. measures: paths of what it measures."""

    def __init__(self, options: Mapping[str, Any], changed: Mapping[str, Any], measures: Sequence[str]) -> None:
        self._changed, self.skipped = changed, list[str]()
        self._began, self._others_s = time.monotonic(), others_cpu_s()
        (cpu, *_) = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) or [platform.machine()]
        machine = {"CPU": cpu, "cores": os.cpu_count(), "memory, GB": psutil.virtual_memory().total / 1e9}
        self._about = {
            **{
                "commit": git("rev-parse", "HEAD"),
                "is dirty": bool(git("diff", "HEAD", "--name-only", "--", *PROGRAM)),
            },
            "date": f"{datetime.datetime.now(datetime.timezone.utc):%Y-%m-%d %H:%M}",
            "machine": machine | {"kernel": platform.release(), "Python": platform.python_version()},
            **{"load before": LOAD_BEFORE, "options": options, "changed options": changed, "measures": measures},
        }

    def name_of(self, name: str) -> str:
        """The name of a result: a run with other options does not replace that of the standard ones."""
        more = (f"-{option}-{value}" for option, value in self._changed.items())
        return re.sub(r"[^\w.-]+", "-", "".join((name, *more)))

    def facts(self) -> dict[str, Any]:
        """Where, when and how it was measured."""
        took_s = time.monotonic() - self._began
        others = max(0.0, others_cpu_s() - self._others_s) / max(took_s, 1e-3)
        return {**self._about, "took, s": took_s, "other programs, cores": others, "skipped": self.skipped}


def others_cpu_s() -> float:
    """CPU time of all processes but this one and its descendants, with an unknown offset [s]. Idle times and those of
    processes are exact."""
    every_core, own_s = psutil.cpu_times(percpu=True), 0.0
    for process in (psutil.Process(), *psutil.Process().children(recursive=True)):
        try:
            own_s += sum(process.cpu_times()[:4])
        except psutil.NoSuchProcess:
            continue
    idle_s = sum(core.idle + getattr(core, "iowait", 0.0) for core in every_core)
    return len(every_core) * time.monotonic() - idle_s - own_s


def git(*arguments: str) -> str:
    """What git prints, empty if it fails or is not installed."""
    return subprocess.run(("env", "git", *arguments), cwd=ROOT, capture_output=True, text=True).stdout.strip()


#: The run of this process, which the frame of the benches begins.
run: Run | None = None


def summarize(
    name: str,
    title: str,
    rows: Sequence[Mapping[str, Any]],
    marks: Sequence[Mark],
    samples: Mapping[str, Sequence[float]] | None = None,
    unit: str = "",
    shown: Sequence[str] = (),
    invalid: str = "",
    **more: Any,
) -> bool:
    """Print rows and marks, and write NAME.json; whether every mark was reached. Raises NotMeasured if it is invalid.

    A column that a row lacks, or None, prints as an empty cell. samples: for the file, with their unit. shown: the
    columns to print, by default all. invalid: why the measurement decides about no mark. more: for the file."""
    console = Console(width=160)
    table = Table(title=title)
    columns = shown or list(dict.fromkeys(column for row in rows for column in row))
    for column in columns:
        table.add_column(column)
    for row in rows:
        table.add_row(*(cell(row.get(column)) for column in columns))
    console.print(table)
    judged = [{**mark._asdict(), "verdict": "invalid" if invalid else mark.verdict} for mark in marks]
    for mark, found in zip(marks, judged, strict=True):
        colour = {"reached": "green", "invalid": "yellow"}.get(found["verdict"], "red")
        limit = f"must be {mark.relation} {cell(mark.limit)}"
        console.print(f"{mark.what}: {cell(mark.value)}, {limit}: [{colour}]{found['verdict']}[/{colour}]")
    measured = run or Run({}, {}, ())
    facts = measured.facts()
    content = {"title": title, **facts, "invalid": invalid, **more, "rows": rows, "marks": judged}
    content |= {"unit of samples": unit, "samples": {}}
    for label, some in (samples or {}).items():
        percentiles = {
            "count": len(some),
            "percentiles": np.quantile(some or [math.nan], np.linspace(0, 1, 101)).tolist(),
        }
        content["samples"][label] = some if len(some) <= MAX_VALUES else percentiles
    RESULTS.mkdir(parents=True, exist_ok=True)
    file = RESULTS / f"{measured.name_of(name)}.json"
    file.write_text(json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")
    loads = f"load before: {LOAD_BEFORE:.2f}, other programs: {facts['other programs, cores']:.2f} cores"
    console.print(f"{loads}; wrote {file}\n", soft_wrap=True)
    if invalid:
        raise NotMeasured(f"invalid: {invalid}")
    return all(mark.is_reached for mark in marks)


def _plain(value: Any) -> Any:
    """Floats with six digits; what is no number says so."""
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else "not measured" if math.isnan(value) else str(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which the fraction `share` of the values lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def timed_ms(call: Callable[..., T], *arguments: object) -> tuple[T, float]:
    """The result of a call and its duration [ms]."""
    began = time.perf_counter()
    answer = call(*arguments)
    return answer, (time.perf_counter() - began) * 1e3


def summary(values: Sequence[float], median: str, p99: str = "", worst: str = "") -> dict[str, float | None]:
    """The median, p99 and largest of the values, as columns of these names; None without values."""
    found: dict[str, float | None] = {median: statistics.median(values) if values else None}
    if p99:
        found[p99] = quantile(values, 0.99) if values else None
    if worst:
        found[worst] = max(values, default=None)
    return found

"""Reports the results of a bench: a table, and JSON, CSV and PNG files.

In all functions `file` is the path of these files without a suffix."""

from __future__ import annotations

import csv
import json
import operator
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

#: Console for the progress of a bench.
PROGRESS = Console(stderr=True)
#: Load average of the minute before the bench; results of a busy machine are unreliable.
LOAD_BEFORE = os.getloadavg()[0]
T = TypeVar("T")
Rows = Sequence[Mapping[str, Any]]


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
    def sentence(self) -> str:
        """The requirement and its verdict, in Rich markup."""
        verdict = "[green]reached[/green]" if self.is_reached else "[red]missed[/red]"
        return f"{self.what}: {cell(self.value)}, must be {self.relation} {cell(self.limit)}: {verdict}"

    def as_json(self) -> dict[str, Any]:
        return {**self._asdict(), "reached": self.is_reached}


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


def summarize(file: Path, title: str, rows: Rows, marks: Sequence[Mark], draw: Callable[[Axes], None]) -> bool:
    """Print rows and marks, write FILE.json, FILE.csv and FILE.png; whether every mark was reached.

    All rows have the same columns; None prints as an empty cell."""
    console = Console(width=160)
    table = Table(title=title)
    for column in rows[0]:
        table.add_column(column)
    for row in rows:
        table.add_row(*map(cell, row.values()))
    console.print(table)
    for mark in marks:
        console.print(mark.sentence)
    write_json(file, title, {"rows": list(rows), "marks": [mark.as_json() for mark in marks]})
    write_csv(file, rows)
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw(axes)
    axes.set(title=title)
    axes.grid(alpha=0.3)
    figure.savefig(f"{file}.png", dpi=120)
    console.print(f"load before: {LOAD_BEFORE:.2f}; wrote {file}.json, .csv and .png\n", soft_wrap=True)
    return all(mark.is_reached for mark in marks)


def summarize_samples(file: Path, title: str, rows: Rows, samples: Mapping[str, Sequence[float]], unit: str) -> None:
    """Like `summarize`, without marks; the picture shows the distribution of each of `samples`."""

    def draw(axes: Axes) -> None:
        for label, values in samples.items():
            axes.plot(sorted(values), [i / len(values) for i in range(len(values))], label=label)
        axes.set(xscale="log", xlabel=unit, ylabel="share of calls that took less")
        axes.legend()

    summarize(file, title, rows, (), draw)


def write_json(file: Path, title: str, found: Mapping[str, Any]) -> None:
    """Write the results and the machine's properties to FILE.json."""
    file.parent.mkdir(parents=True, exist_ok=True)
    machine = {
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "load before": LOAD_BEFORE,
    }
    Path(f"{file}.json").write_text(json.dumps({"title": title, **machine, **found}, indent=2) + "\n")


def write_csv(file: Path, rows: Rows) -> None:
    """Write FILE.csv."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with Path(f"{file}.csv").open("w", newline="") as target:
        writer = csv.DictWriter(target, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which the fraction `share` of the values lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def timed_ms(call: Callable[..., T], *arguments: object) -> tuple[T, float]:
    """The result of a call and its duration [ms]."""
    began = time.perf_counter()
    answer = call(*arguments)
    return answer, (time.perf_counter() - began) * 1e3

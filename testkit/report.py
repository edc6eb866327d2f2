"""Reports the results of a bench: a table, and JSON, CSV and PNG files in bench/results."""

from __future__ import annotations

import csv
import json
import operator
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

#: Folder of the results, in the current one.
RESULTS = Path("bench") / "results"
#: Console for the progress of a bench.
PROGRESS = Console(stderr=True)
#: Load average of the minute before the bench; results of a busy machine are unreliable.
LOAD_BEFORE = os.getloadavg()[0]
T = TypeVar("T")
Rows = Sequence[Mapping[str, Any]]
Draw = Callable[[Axes], None]


class Mark(NamedTuple):
    """A requirement: `value` must be "at most" or "at least" (`relation`) `limit`."""

    what: str
    value: float
    relation: str
    limit: float

    @property
    def is_reached(self) -> bool:
        return bool((operator.le if self.relation == "at most" else operator.ge)(self.value, self.limit))

    def sentence(self, invalid: str = "") -> str:
        """The requirement and its verdict, in Rich markup; none if the measurement is `invalid`."""
        verdict = "[green]reached[/green]" if self.is_reached else "[red]missed[/red]"
        verdict = "[yellow]invalid[/yellow]" if invalid else verdict
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


def summarize(
    name: str,
    title: str,
    rows: Rows,
    marks: Sequence[Mark],
    draw: Draw | Figure,
    shown: Sequence[str] = (),
    invalid: str = "",
    **more: Any,
) -> bool:
    """Print rows and marks, write NAME.json, NAME.csv and NAME.png; whether every mark was reached.

    A column that a row lacks, or None, prints as an empty cell. draw: the picture, or draws it. shown: the columns to
    print, by default all. invalid: why the measurement decides about no mark. more: for the JSON file."""
    console = Console(width=160)
    table = Table(title=title)
    every = list(dict.fromkeys(column for row in rows for column in row))
    columns = shown or every
    for column in columns:
        table.add_column(column)
    for row in rows:
        table.add_row(*(cell(row.get(column)) for column in columns))
    console.print(table)
    for mark in marks:
        console.print(mark.sentence(invalid))
    if invalid:
        console.print(f"invalid: {invalid}", style="yellow")
    RESULTS.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {"title": title, "machine": platform.machine(), "cores": os.cpu_count()}
    found |= {"python": platform.python_version(), "load before": LOAD_BEFORE, "invalid": invalid, **more}
    found |= {"rows": list(rows), "marks": [mark.as_json() for mark in marks]}
    (RESULTS / f"{name}.json").write_text(json.dumps(found, indent=2) + "\n")
    with (RESULTS / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, every)
        writer.writeheader()
        writer.writerows(rows)
    figure = draw if isinstance(draw, Figure) else Figure(figsize=(8, 4.5), layout="constrained")
    if not isinstance(draw, Figure):
        axes = figure.add_subplot()
        draw(axes)
        axes.set(title=title)
        axes.grid(alpha=0.3)
    FigureCanvasAgg(figure)
    figure.savefig(RESULTS / f"{name}.png", dpi=120)
    console.print(f"load before: {LOAD_BEFORE:.2f}; wrote {RESULTS / name}.json, .csv and .png\n", soft_wrap=True)
    return all(mark.is_reached for mark in marks)


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


def distribution(
    samples: Mapping[str, Sequence[float]], unit: str, ylabel: str = "share of calls that took less"
) -> Draw:
    """Draws the share of the values below each value, a curve for each label."""

    def draw(axes: Axes) -> None:
        for label, values in samples.items():
            axes.plot(sorted(values), np.arange(len(values)) / max(1, len(values)), label=label)
        axes.set(xscale="log", xlabel=unit, ylabel=ylabel)
        axes.legend(fontsize="small")

    return draw


def bars(values: Mapping[str, float], unit: str, xscale: str = "linear") -> Draw:
    """Draws a bar for each label, the first one at the top."""

    def draw(axes: Axes) -> None:
        axes.barh(list(values), list(values.values()))
        axes.invert_yaxis()
        axes.set(xscale=xscale, xlabel=unit)

    return draw


def curves(x: Sequence[float], columns: Mapping[str, Sequence[float]], xlabel: str, **settings: Any) -> Draw:
    """Draws columns over x, a line with points for each label. settings: of the axes."""

    def draw(axes: Axes) -> None:
        for label, values in columns.items():
            axes.plot(x, values, "o-", label=label)
        axes.set(xlabel=xlabel, **settings)
        axes.legend()

    return draw

"""How these benches tell what they found: a table, what had to be reached, and files in bench/results."""

from __future__ import annotations

import csv
import json
import operator
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from bench.report import LOAD_BEFORE, RESULTS

Rows = Sequence[Mapping[str, Any]]


class Mark(NamedTuple):
    """Something that has to be reached: `value` is to be at most or at least `limit`."""

    what: str
    value: float
    relation: str
    limit: float

    @property
    def is_reached(self) -> bool:
        return bool((operator.le if self.relation == "at most" else operator.ge)(self.value, self.limit))


def at_most(what: str, value: float, limit: float) -> Mark:
    return Mark(what, value, "at most", limit)


def at_least(what: str, value: float, limit: float) -> Mark:
    return Mark(what, value, "at least", limit)


def tell(name: str, title: str, rows: Rows, marks: Sequence[Mark], draw: Callable[[Axes], None]) -> bool:
    """Print the rows and the marks, write NAME.json, NAME.csv and NAME.png; whether every mark was reached.

    The rows have the same columns; None where a row has nothing to say."""
    console = Console(width=160)
    table = Table(title=title)
    for column in rows[0]:
        table.add_column(column)
    for row in rows:
        table.add_row(*map(_cell, row.values()))
    console.print(table)
    for mark in marks:
        verdict = "[green]reached[/green]" if mark.is_reached else "[red]missed[/red]"
        console.print(f"{mark.what}: {_cell(mark.value)}, must be {mark.relation} {_cell(mark.limit)}: {verdict}")
    RESULTS.mkdir(parents=True, exist_ok=True)
    found = {
        "title": title,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "load before": LOAD_BEFORE,
        "rows": list(rows),
        "marks": [{**mark._asdict(), "reached": mark.is_reached} for mark in marks],
    }
    (RESULTS / f"{name}.json").write_text(json.dumps(found, indent=2) + "\n")
    with (RESULTS / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw(axes)
    axes.set(title=title)
    axes.grid(alpha=0.3)
    figure.savefig(RESULTS / f"{name}.png", dpi=120)
    console.print(f"load before: {LOAD_BEFORE:.2f}; wrote {RESULTS / name}.json, .csv and .png\n", soft_wrap=True)
    return all(mark.is_reached for mark in marks)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:,}" if isinstance(value, int) else str(value)

"""How a bench tells what it found: a table, a JSON file and a picture, side by side in bench/results."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

RESULTS = Path(__file__).resolve().parent / "results"
#: Where a bench shows what it is waiting for.
PROGRESS = Console(stderr=True)
#: Processes that wanted a core in the minute before the bench: figures of a busy machine are worth little.
LOAD_BEFORE = os.getloadavg()[0]
T = TypeVar("T")


def write(
    name: str, title: str, rows: Sequence[Mapping[str, Any]], samples: Mapping[str, Sequence[float]], unit: str
) -> None:
    """Print `rows` as a table, write them to NAME.json, and the distribution of each of `samples` to NAME.png.

    The rows have the same columns; None where a row has nothing to say."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    table = Table(title=title)
    for column in rows[0]:
        table.add_column(column)
    for row in rows:
        table.add_row(*map(_cell, row.values()))
    Console(width=140).print(table)
    machine = {
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "load before": LOAD_BEFORE,
    }
    (RESULTS / f"{name}.json").write_text(json.dumps({"title": title, **machine, "rows": rows}, indent=2) + "\n")
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for label, values in samples.items():
        ordered = sorted(values)
        axes.plot(ordered, [i / len(ordered) for i in range(len(ordered))], label=label)
    axes.set(xscale="log", xlabel=unit, ylabel="share of calls that took less", title=title)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(RESULTS / f"{name}.png", dpi=120)
    Console().print(f"load before: {LOAD_BEFORE:.2f}; wrote {RESULTS / name}.json and .png\n", soft_wrap=True)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def quantile(values: Sequence[float], share: float) -> float:
    """The value below which that share of the values lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def timed_ms(call: Callable[..., T], *arguments: object) -> tuple[T, float]:
    """What a call returns, and the milliseconds it took."""
    began = time.perf_counter()
    answer = call(*arguments)
    return answer, (time.perf_counter() - began) * 1e3

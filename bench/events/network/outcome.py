"""Reports the outcome: tables, verdicts, JSON, CSV, and the paper's Figure 13 with our curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from bench import RESULTS
from bench.events.network import analysis
from bench.events.network.analysis import Cell
from bench.events.network.experiment import FEDERATED, STANDARD, Outcome
from robocorba.testing.report import LOAD_BEFORE, write_csv, write_json

NAME = "event_network"
TITLE = "Figure 13: latency of a central and of federated event channels"
COLOURS = {STANDARD: "tab:red", FEDERATED: "tab:blue"}


def summarize(outcomes: Sequence[Outcome], about: Mapping[str, Any]) -> bool:
    """Print and write all results; whether every mark was reached. about: description of the measurement."""
    found = analysis.cells(outcomes)
    rows, marks = [analysis.row(cell) for cell in found], analysis.marks(found)
    sentences, summary = analysis.differences(found), markdown(found)
    console = Console(width=150)
    console.print(_table(rows))
    for mark in marks:
        console.print(mark.sentence)
    held = analysis.worst_load(found)
    console.print(f"load of the leader's core: off by at most {100 * held:.0f} points where there was load to add")
    console.print("\nBeside the paper:")
    for sentence in sentences:
        console.print(f"- {sentence}")
    console.print(f"\n{summary}\n", markup=False, soft_wrap=True)
    for key, value in about.items():
        console.print(f"{key}: {value}", markup=False, soft_wrap=True)
    runs = [analysis.run_row(run) for run in outcomes]
    verdicts = [mark.as_json() for mark in marks]
    beside = {"beside the paper": sentences, "markdown": summary}
    write_json(RESULTS / NAME, TITLE, {**about, "rows": rows, "marks": verdicts, **beside, "runs": runs})
    write_csv(RESULTS / NAME, rows)
    write_csv(RESULTS / f"{NAME}_runs", runs)
    draw(found).savefig(RESULTS / f"{NAME}.png", dpi=120)
    written = f"{RESULTS / NAME}.json, .csv, _runs.csv and .png"
    console.print(f"load before: {LOAD_BEFORE:.2f}; wrote {written}", soft_wrap=True)
    return all(mark.is_reached for mark in marks)


def markdown(found: Sequence[Cell]) -> str:
    """A table for the README, with a row for each delay over all loads."""
    lines = [
        "| link, one way | standard: mean, p50, p99 | federated: mean, p50, p99 | ratio of means (95 %) | local "
        "| remote | link, standard to federated |",
        "|---|---|---|---|---|---|---|",
    ]
    for delay in analysis.delays(found):
        cell = analysis.merged([cell for cell in found if cell.delay_us == delay])
        took = [
            f"{one.mean.value:.2f}, {one.p50:.2f}, {one.p99:.2f} ms"
            for one in (analysis.latency(cell.standard), analysis.latency(cell.federated))
        ]
        local, remote = (analysis.compare(cell, which).value for which in ("local_us", "remote_us"))
        link = [np.mean([run.bytes for run in runs]) / 1e3 for runs in (cell.standard, cell.federated)]
        lines.append(
            f"| {delay / 1e3:g} ms | {took[0]} | {took[1]} | {analysis.compare(cell)} | {local:.2f} | {remote:.2f} "
            f"| {link[0]:.0f} to {link[1]:.0f} KB a run |"
        )
    standard, federated = analysis.PAPER_STANDARD_MS, analysis.PAPER_FEDERATED_MS
    lines.append(f"| paper, at 60 % load | {standard} ms | {federated} ms | {analysis.PAPER_RATIO} | | | |")
    return "\n".join(lines)


def draw(found: Sequence[Cell]) -> Figure:
    """Plots of latency (top) and ratio (bottom) over the load of the leader's core; a column for each delay."""
    delays = analysis.delays(found)
    figure = Figure(figsize=(3.2 * len(delays) + 1, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(delays), sharex=True, sharey="row", squeeze=False)
    for upper, lower, delay in zip(*panels, delays, strict=True):
        of_delay = [cell for cell in found if cell.delay_us == delay]
        _draw_latencies(upper, of_delay)
        upper.set(title=f"link {delay / 1e3:g} ms one way", yscale="log")
        _draw_ratios(lower, of_delay)
        lower.set(xlabel="CPU of the leader, as measured, %", xlim=(0, 102))
        for axes in (upper, lower):
            axes.grid(alpha=0.3, which="both")
    panels[0][0].set(ylabel="mean latency, ms")
    panels[1][0].set(ylabel="federated / standard")
    panels[0][0].legend(fontsize="small")
    panels[1][0].legend(fontsize="small")
    figure.suptitle(TITLE)
    return figure


def _draw_latencies(axes: Axes, of_delay: Sequence[Cell]) -> None:
    paper = {STANDARD: analysis.PAPER_STANDARD_MS, FEDERATED: analysis.PAPER_FEDERATED_MS}
    for set_up, colour in COLOURS.items():
        runs = [getattr(cell, set_up) for cell in of_delay]
        busy = [100 * np.mean([run.busy for run in some]) for some in runs]
        means = [analysis.latency(some).mean for some in runs]
        errors = [[one.value - one.low for one in means], [one.high - one.value for one in means]]
        axes.errorbar(busy, [one.value for one in means], errors, marker="o", markersize=4, color=colour, label=set_up)
        axes.plot(
            [100 * analysis.PAPER_LOAD], [paper[set_up]], "*", color=colour, markersize=11, label=f"paper, {set_up}"
        )


def _draw_ratios(axes: Axes, of_delay: Sequence[Cell]) -> None:
    for label, which, colour in (("all", "all_us", "black"), ("remote", "remote_us", "0.6")):
        ratios = [analysis.compare(cell, which) for cell in of_delay]
        busy = [100 * np.mean([run.busy for run in (*cell.standard, *cell.federated)]) for cell in of_delay]
        errors = [[one.value - one.low for one in ratios], [one.high - one.value for one in ratios]]
        axes.errorbar(busy, [one.value for one in ratios], errors, marker="o", markersize=4, color=colour, label=label)
    axes.axhline(analysis.PAPER_RATIO, linestyle="--", color="tab:green", label=f"paper, {analysis.PAPER_RATIO}")
    axes.set_ylim(bottom=0)


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """The main columns; the files have all columns."""
    table = Table(title=f"{TITLE}, ms")
    shown = ["delay, ms", "load, %", f"{FEDERATED} busy, %"]
    shown += [f"{set_up} {what}" for set_up in (STANDARD, FEDERATED) for what in ("mean", "p50", "p99")]
    shown += ["ratio", "ratio low", "ratio high", "ratio p50", "ratio local", "ratio remote"]
    for column in shown:
        table.add_column(column)
    for row in rows:
        table.add_row(*(f"{row[column]:.3g}" for column in shown))
    return table

"""Reports the outcome: tables, verdicts, JSON, CSV, and the paper's Figure 13 with our curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.events.network import analysis
from bench.events.network.analysis import Cell, Interval
from bench.events.network.experiment import FEDERATED, STANDARD, Outcome
from robocorba.testing.report import summarize, write_csv

NAME = "event_network"
TITLE = "Figure 13: latency of a central and of federated event channels"
COLOURS = {STANDARD: "tab:red", FEDERATED: "tab:blue"}
#: The columns of the printed table; the files have all.
SHOWN = (
    *("delay, ms", "load, %", f"{FEDERATED} busy, %"),
    *(f"{set_up} {what}" for set_up in (STANDARD, FEDERATED) for what in ("mean", "p50", "p99")),
    *("ratio", "ratio low", "ratio high", "ratio p50", "ratio local", "ratio remote"),
)


def report(outcomes: Sequence[Outcome], about: Mapping[str, Any]) -> bool:
    """Print and write all results; whether every mark was reached. about: description of the measurement."""
    found = analysis.cells(outcomes)
    sentences, table = analysis.differences(found), markdown(found)
    held = max((abs(cell.busy - cell.load) for cell in found if cell.load), default=0.0)
    print(f"load of the leader's core: off by at most {100 * held:.0f} points where there was load to add")
    print("\nBeside the paper:", *sentences, sep="\n- ")
    print(f"\n{table}\n", *(f"{key}: {value}" for key, value in about.items()), sep="\n")
    runs = [analysis.run_row(run) for run in outcomes]
    write_csv(f"{NAME}_runs", runs)
    rows = [analysis.row(cell) for cell in found]
    more = {**about, "beside the paper": sentences, "markdown": table, "runs": runs}
    return summarize(NAME, TITLE, rows, analysis.marks(found), draw(found), SHOWN, **more)


def markdown(found: Sequence[Cell]) -> str:
    """A table for the README, with a row for each delay over all loads."""
    lines = [
        "| link, one way | standard: mean, p50, p99 | federated: mean, p50, p99 | ratio of means (95 %) | local "
        "| remote | link, standard to federated |",
        "|---|---|---|---|---|---|---|",
    ]
    for cell in analysis.by_delay(found):
        took = [
            "{mean:.2f}, {p50:.2f}, {p99:.2f} ms".format(**analysis.latencies_ms(runs))
            for runs in (cell.standard, cell.federated)
        ]
        local, remote = (analysis.compare(cell, which).value for which in ("local_us", "remote_us"))
        link = [np.mean([run.bytes for run in runs]) / 1e3 for runs in (cell.standard, cell.federated)]
        lines.append(
            f"| {cell.delay_us / 1e3:g} ms | {took[0]} | {took[1]} | {analysis.compare(cell)} | {local:.2f} "
            f"| {remote:.2f} | {link[0]:.0f} to {link[1]:.0f} KB a run |"
        )
    standard, federated = analysis.PAPER_STANDARD_MS, analysis.PAPER_FEDERATED_MS
    lines.append(f"| paper, at 60 % load | {standard} ms | {federated} ms | {analysis.PAPER_RATIO} | | | |")
    return "\n".join(lines)


def draw(found: Sequence[Cell]) -> Figure:
    """Plots of latency (top) and ratio (bottom) over the load of the leader's core; a column for each delay."""
    delays = sorted({cell.delay_us for cell in found})
    figure = Figure(figsize=(3.2 * len(delays) + 1, 6.4), layout="constrained")
    panels = figure.subplots(2, len(delays), sharex=True, sharey="row", squeeze=False)
    paper = {STANDARD: analysis.PAPER_STANDARD_MS, FEDERATED: analysis.PAPER_FEDERATED_MS}
    for upper, lower, delay in zip(*panels, delays, strict=True):
        cells = [cell for cell in found if cell.delay_us == delay]
        for set_up, colour in COLOURS.items():
            runs = [getattr(cell, set_up) for cell in cells]
            busy = [float(np.mean([run.busy for run in some])) for some in runs]
            _curve(upper, busy, [analysis.mean(analysis.means_ms(some)) for some in runs], colour, set_up)
            label = f"paper, {set_up}"
            upper.plot([100 * analysis.PAPER_LOAD], [paper[set_up]], "*", color=colour, markersize=11, label=label)
        for label, which, colour in (("all", "all_us", "black"), ("remote", "remote_us", "0.6")):
            ratios = [analysis.compare(cell, which) for cell in cells]
            _curve(lower, [cell.busy for cell in cells], ratios, colour, label)
        lower.axhline(analysis.PAPER_RATIO, linestyle="--", color="tab:green", label=f"paper, {analysis.PAPER_RATIO}")
        upper.set(title=f"link {delay / 1e3:g} ms one way", yscale="log")
        lower.set(xlabel="CPU of the leader, as measured, %", xlim=(0, 102), ylim=(0, None))
        for axes in (upper, lower):
            axes.grid(alpha=0.3, which="both")
    for axes, label in ((panels[0][0], "mean latency, ms"), (panels[1][0], "federated / standard")):
        axes.set(ylabel=label)
        axes.legend(fontsize="small")
    figure.suptitle(TITLE)
    return figure


def _curve(axes: Axes, busy: Sequence[float], values: Sequence[Interval], colour: str, label: str) -> None:
    """Values with their intervals over the load."""
    errors = [[one.value - one.low for one in values], [one.high - one.value for one in values]]
    x, y = [100 * share for share in busy], [one.value for one in values]
    axes.errorbar(x, y, errors, marker="o", markersize=4, color=colour, label=label)

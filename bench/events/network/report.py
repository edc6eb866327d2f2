"""Analysis and report of the runs: latencies of each cell (delay, load) in both set-ups, their ratio, and the paper's
Figure 13 with our curves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.events.network.experiment import FEDERATED, STANDARD, Outcome
from testkit.report import Mark, at_most, summarize

#: The figures of the paper's text about Figure 13: mean latencies [ms] at one load, and that they fall with load.
PAPER_LOAD, PAPER_STANDARD_MS, PAPER_FEDERATED_MS = 0.6, 18.5, 16.9
PAPER_RATIO = 0.91
#: Marks: ratio of the means at every load and delay; with links of 1 ms; of remote events only.
RATIO_LIMIT, RATIO_LIMIT_1_MS, REMOTE_LIMIT = PAPER_RATIO, 0.5, 1.15
RESAMPLES = 2000


class Interval(NamedTuple):
    """An estimate with its 95 % confidence interval."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, samples: np.ndarray) -> Interval:
        return cls(value, *map(float, np.quantile(samples, (0.025, 0.975))))

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


class Cell(NamedTuple):
    """All runs with one delay and one load."""

    delay_us: int
    load: float
    standard: list[Outcome]
    federated: list[Outcome]

    @property
    def runs(self) -> list[Outcome]:
        return [*self.standard, *self.federated]

    @property
    def busy(self) -> float:
        return float(np.mean([run.busy for run in self.runs]))


def cells(outcomes: Iterable[Outcome]) -> list[Cell]:
    """Runs by delay and load, both ascending."""
    found: dict[tuple[int, float], Cell] = {}
    for one in outcomes:
        cell = found.setdefault((one.delay_us, one.load), Cell(one.delay_us, one.load, [], []))
        {STANDARD: cell.standard, FEDERATED: cell.federated}[one.set_up].append(one)
    return [found[key] for key in sorted(found)]


def by_delay(found: Sequence[Cell]) -> list[Cell]:
    """The cells of each delay merged, with all loads."""
    merged: dict[int, Cell] = {}
    for cell in found:
        into = merged.setdefault(cell.delay_us, Cell(cell.delay_us, float("nan"), [], []))
        into.standard.extend(cell.standard)
        into.federated.extend(cell.federated)
    return list(merged.values())


def latencies_ms(runs: Sequence[Outcome]) -> dict[str, float]:
    """The latencies of all mission events of these runs. mean, local, remote: the mean of the means of the runs."""
    p50, p99 = np.quantile(np.concatenate([run.all_us for run in runs]) / 1e3, (0.5, 0.99))
    mean, local, remote = (float(means_ms(runs, which).mean()) for which in ("all_us", "local_us", "remote_us"))
    return {"mean": mean, "p50": float(p50), "p99": float(p99), "local": local, "remote": remote}


def means_ms(runs: Sequence[Outcome], which: str = "all_us") -> np.ndarray:
    """The mean latency of each run [ms]."""
    return np.array([getattr(run, which).mean() for run in runs]) / 1e3


def mean(values: np.ndarray) -> Interval:
    """The mean over runs, with an interval from resampling."""
    return Interval.of(float(values.mean()), _resampled(values, np.random.default_rng(1)))


def ratio(numerators: np.ndarray, denominators: np.ndarray) -> Interval:
    """The ratio of two means of runs; both are resampled."""
    chance = np.random.default_rng(2)
    samples = _resampled(numerators, chance) / _resampled(denominators, chance)
    return Interval.of(float(numerators.mean() / denominators.mean()), samples)


def compare(cell: Cell, which: str = "all_us") -> Interval:
    """Ratio of federated to standard, from the means of the runs."""
    return ratio(means_ms(cell.federated, which), means_ms(cell.standard, which))


def row(cell: Cell) -> dict[str, Any]:
    """A cell as a row of the table and the files: latencies [ms] and traffic over the link in a run."""
    found: dict[str, Any] = {
        "delay, ms": cell.delay_us / 1e3,
        "load, %": None if math.isnan(cell.load) else round(100 * cell.load),
    }
    for set_up, runs in ((STANDARD, cell.standard), (FEDERATED, cell.federated)):
        found[f"{set_up} busy, %"] = round(100 * float(np.mean([run.busy for run in runs])), 1)
        found |= {f"{set_up} {name}": ms for name, ms in latencies_ms(runs).items()}
        found[f"{set_up} KB over the link"] = float(np.mean([run.bytes for run in runs])) / 1e3
    found["ratio p50"] = found[f"{FEDERATED} p50"] / found[f"{STANDARD} p50"]
    for name, which in (("ratio", "all_us"), ("ratio local", "local_us"), ("ratio remote", "remote_us")):
        found |= dict(zip((name, f"{name} low", f"{name} high"), compare(cell, which), strict=True))
    return {**found, "runs": len(cell.standard), "events": sum(len(run.all_us) for run in cell.standard)}


def marks(found: Sequence[Cell]) -> list[Mark]:
    """The worst cells compared with the limits."""
    runs = [run for cell in found for run in cell.runs]
    across = [abs(run.forwarded - run.wanted_across) for run in runs if run.set_up == FEDERATED]
    result = [
        at_most("events lost", sum(run.lost for run in runs), 0),
        at_most("events over the federation's link too many or too few", sum(across), 0),
        at_most("ratio of the means, worst load and delay", max(compare(cell).value for cell in found), RATIO_LIMIT),
    ]
    if one_ms := [compare(cell).value for cell in found if cell.delay_us == 1000]:
        result.append(at_most("ratio of the means, worst load with 1 ms", max(one_ms), RATIO_LIMIT_1_MS))
    for cell in by_delay(found):
        value = compare(cell, "remote_us").value
        result.append(at_most(f"ratio of remote events, {cell.delay_us / 1e3:g} ms", value, REMOTE_LIMIT))
    return result


def _resampled(values: np.ndarray, chance: np.random.Generator) -> np.ndarray:
    """Means of samples drawn with replacement."""
    return values[chance.integers(0, len(values), (RESAMPLES, len(values)))].mean(axis=1)


# ---- tables and pictures ----


NAME = "event_network"
TITLE = "Figure 13: latency of a central and of federated event channels"
COLOURS = {STANDARD: "tab:red", FEDERATED: "tab:blue"}
#: The columns of the printed table; the files have all.
SHOWN = (
    *("delay, ms", "load, %", f"{FEDERATED} busy, %"),
    *(f"{set_up} {what}" for set_up in (STANDARD, FEDERATED) for what in ("mean", "p50", "p99")),
    *("ratio", "ratio low", "ratio high", "ratio p50", "ratio local", "ratio remote"),
)


def write_report(outcomes: Sequence[Outcome], about: Mapping[str, Any]) -> bool:
    """Print and write all results; whether every mark was reached. about: description of the measurement."""
    found = cells(outcomes)
    held = max((abs(cell.busy - cell.load) for cell in found if cell.load), default=0.0)
    print(f"load of the leader's core: off by at most {100 * held:.0f} points where there was load to add")
    print("", *(f"{key}: {value}" for key, value in about.items()), sep="\n")
    rows = [row(cell) for cell in found]
    delays = [row(cell) for cell in by_delay(found)]
    summarize(f"{NAME}_delays", f"{TITLE}, over all loads", delays, [], draw(by_delay(found)), SHOWN)
    return summarize(NAME, TITLE, rows, marks(found), draw(found), SHOWN, **about)


def draw(found: Sequence[Cell]) -> Figure:
    """Plots of latency (top) and ratio (bottom) over the load of the leader's core; a column for each delay."""
    delays = sorted({cell.delay_us for cell in found})
    figure = Figure(figsize=(3.2 * len(delays) + 1, 6.4), layout="constrained")
    panels = figure.subplots(2, len(delays), sharex=True, sharey="row", squeeze=False)
    paper = {STANDARD: PAPER_STANDARD_MS, FEDERATED: PAPER_FEDERATED_MS}
    for upper, lower, delay in zip(*panels, delays, strict=True):
        cells = [cell for cell in found if cell.delay_us == delay]
        for set_up, colour in COLOURS.items():
            runs = [getattr(cell, set_up) for cell in cells]
            busy = [float(np.mean([run.busy for run in some])) for some in runs]
            _curve(upper, busy, [mean(means_ms(some)) for some in runs], colour, set_up)
            label = f"paper, {set_up}"
            upper.plot([100 * PAPER_LOAD], [paper[set_up]], "*", color=colour, markersize=11, label=label)
        for label, which, colour in (("all", "all_us", "black"), ("remote", "remote_us", "0.6")):
            ratios = [compare(cell, which) for cell in cells]
            _curve(lower, [cell.busy for cell in cells], ratios, colour, label)
        lower.axhline(PAPER_RATIO, linestyle="--", color="tab:green", label=f"paper, {PAPER_RATIO}")
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

"""Analysis of the runs: latencies of each cell (delay, load) in both set-ups, their ratio and trend."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.events.network.experiment import FEDERATED, STANDARD, Outcome
from robocorba.testing.report import Mark, at_most

#: The figures of the paper's text about Figure 13: mean latencies [ms] at one load, and that they fall with load.
PAPER_LOAD, PAPER_STANDARD_MS, PAPER_FEDERATED_MS = 0.6, 18.5, 16.9
PAPER_RATIO = 0.91
PAPER_TREND = "falls"
#: Marks: ratio of the means at every load and delay; with links of 1 ms; of remote events only.
RATIO_LIMIT, RATIO_LIMIT_1_MS, REMOTE_LIMIT = PAPER_RATIO, 0.5, 1.15
RESAMPLES = 2000


class Interval(NamedTuple):
    """An estimate with its 95 % confidence interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


class Latency(NamedTuple):
    """Latencies of the events of some runs [ms]. mean: the mean of the means of the runs."""

    mean: Interval
    p50: float
    p99: float
    local: float
    remote: float


class Cell(NamedTuple):
    """All runs with one delay and one load."""

    delay_us: int
    load: float
    standard: list[Outcome]
    federated: list[Outcome]


def cells(outcomes: Iterable[Outcome]) -> list[Cell]:
    """Runs by delay and load, both ascending."""
    found: dict[tuple[int, float], Cell] = {}
    for one in outcomes:
        cell = found.setdefault((one.delay_us, one.load), Cell(one.delay_us, one.load, [], []))
        {STANDARD: cell.standard, FEDERATED: cell.federated}[one.set_up].append(one)
    return [found[key] for key in sorted(found)]


def merged(found: Sequence[Cell]) -> Cell:
    """The cells of one delay merged, with all loads."""
    return Cell(
        found[0].delay_us,
        float("nan"),
        [one for cell in found for one in cell.standard],
        [one for cell in found for one in cell.federated],
    )


def latency(runs: Sequence[Outcome]) -> Latency:
    """The latencies of all mission events of these runs."""
    everything = np.concatenate([run.all_us for run in runs]) / 1e3
    return Latency(
        mean(means_ms(runs)),
        float(np.quantile(everything, 0.5)),
        float(np.quantile(everything, 0.99)),
        float(np.mean([run.local_us.mean() for run in runs])) / 1e3,
        float(np.mean([run.remote_us.mean() for run in runs])) / 1e3,
    )


def means_ms(runs: Sequence[Outcome], which: str = "all_us") -> np.ndarray:
    """The mean latency of each run [ms]."""
    return np.array([getattr(run, which).mean() for run in runs]) / 1e3


def mean(values: np.ndarray) -> Interval:
    """The mean over runs, with an interval from resampling."""
    return _interval(float(values.mean()), _resampled(values, np.random.default_rng(1)))


def ratio(numerators: np.ndarray, denominators: np.ndarray) -> Interval:
    """The ratio of two means of runs; both are resampled."""
    chance = np.random.default_rng(2)
    samples = _resampled(numerators, chance) / _resampled(denominators, chance)
    return _interval(float(numerators.mean() / denominators.mean()), samples)


def compare(cell: Cell, which: str = "all_us") -> Interval:
    """Ratio of federated to standard, from the means of the runs."""
    return ratio(means_ms(cell.federated, which), means_ms(cell.standard, which))


class Trend(NamedTuple):
    """Change of the mean latency from an idle to a busy core, in ms and as a word."""

    change: Interval
    word: str


def trend(runs: Sequence[Outcome]) -> Trend:
    """A line through the runs' means over the load that was measured; it has a direction where the interval of its
    slope leaves out zero."""
    loads, means = np.array([run.busy for run in runs]), means_ms(runs)
    chance = np.random.default_rng(3)
    picks = chance.integers(0, len(runs), (RESAMPLES, len(runs)))
    change = _interval(float(_slope(loads, means)), np.array([_slope(loads[pick], means[pick]) for pick in picks]))
    return Trend(change, "rises" if change.low > 0 else "falls" if change.high < 0 else "has no clear trend")


def row(cell: Cell) -> dict[str, Any]:
    """A cell as a row of the table and the files: latencies [ms] and traffic over the link in a run."""
    standard, federated = latency(cell.standard), latency(cell.federated)
    found: dict[str, Any] = {"delay, ms": cell.delay_us / 1e3, "load, %": round(100 * cell.load)}
    for set_up, runs, took in ((STANDARD, cell.standard, standard), (FEDERATED, cell.federated, federated)):
        found |= {
            f"{set_up} busy, %": round(100 * float(np.mean([run.busy for run in runs])), 1),
            f"{set_up} mean": took.mean.value,
            f"{set_up} p50": took.p50,
            f"{set_up} p99": took.p99,
            f"{set_up} local": took.local,
            f"{set_up} remote": took.remote,
            f"{set_up} KB over the link": float(np.mean([run.bytes for run in runs])) / 1e3,
        }
    found["ratio p50"] = federated.p50 / standard.p50
    for name, which in (("ratio", "all_us"), ("ratio local", "local_us"), ("ratio remote", "remote_us")):
        found |= dict(zip((name, f"{name} low", f"{name} high"), compare(cell, which), strict=True))
    return {**found, "runs": len(cell.standard), "events": sum(len(run.all_us) for run in cell.standard)}


def run_row(run: Outcome) -> dict[str, Any]:
    """A run as a row of the files."""
    everything = run.all_us / 1e3
    return {
        "set-up": run.set_up,
        "delay, ms": run.delay_us / 1e3,
        "load, %": round(100 * run.load),
        "busy, %": round(100 * run.busy, 1),
        "mean": float(everything.mean()),
        "p50": float(np.quantile(everything, 0.5)),
        "p99": float(np.quantile(everything, 0.99)),
        "local": float(run.local_us.mean()) / 1e3,
        "remote": float(run.remote_us.mean()) / 1e3,
        "lost": run.lost,
        "sent": run.sent,
        "wanted across": run.wanted_across,
        "packets over the link": run.packets,
        "bytes over the link": run.bytes,
        "events forwarded": run.forwarded,
        "bytes forwarded": run.forwarded_bytes,
        "events not forwarded": run.unseen,
    }


def marks(found: Sequence[Cell]) -> list[Mark]:
    """The worst cells compared with the limits."""
    runs = [run for cell in found for run in (*cell.standard, *cell.federated)]
    across = [abs(run.forwarded - run.wanted_across) for run in runs if run.set_up == FEDERATED]
    result = [
        at_most("events lost", sum(run.lost for run in runs), 0),
        at_most("events over the federation's link too many or too few", sum(across), 0),
        at_most("ratio of the means, worst load and delay", max(compare(cell).value for cell in found), RATIO_LIMIT),
    ]
    one_ms = [compare(cell).value for cell in found if cell.delay_us == 1000]
    if one_ms:
        result.append(at_most("ratio of the means, worst load with 1 ms", max(one_ms), RATIO_LIMIT_1_MS))
    by_delay = [merged([cell for cell in found if cell.delay_us == delay]) for delay in delays(found)]
    for cell in by_delay:
        value = compare(cell, "remote_us").value
        result.append(at_most(f"ratio of remote events, {cell.delay_us / 1e3:g} ms", value, REMOTE_LIMIT))
    return result


def worst_load(found: Sequence[Cell]) -> float:
    """Largest deviation of the measured load of a cell from the wanted load, as a share; without the idle cells."""
    cells_with = [cell for cell in found if cell.load]
    return max(
        (abs(float(np.mean([r.busy for r in (*cell.standard, *cell.federated)])) - cell.load) for cell in cells_with),
        default=0.0,
    )


def delays(found: Sequence[Cell]) -> list[int]:
    """The one-way delays, ascending [us]."""
    return sorted({cell.delay_us for cell in found})


def differences(found: Sequence[Cell]) -> list[str]:
    """Sentences on the differences between our curves and the paper's."""
    sentences = []
    for delay in delays(found):
        cell = merged([cell for cell in found if cell.delay_us == delay])
        for set_up, runs in ((STANDARD, cell.standard), (FEDERATED, cell.federated)):
            way = trend(runs)
            agrees = "as in the paper" if way.word == PAPER_TREND else "unlike in the paper, where it falls"
            sentences.append(
                f"{delay / 1e3:g} ms, {set_up}: the latency {way.word} with the leader's load, {agrees} "
                f"({way.change.value:+.3f} ms from idle to busy, {way.change.low:+.3f} to {way.change.high:+.3f})."
            )
        at_60 = [near for near in found if near.delay_us == delay and abs(near.load - PAPER_LOAD) < 0.01]
        if at_60:
            ours = latency(at_60[0].standard).mean.value, latency(at_60[0].federated).mean.value
            sentences.append(
                f"{delay / 1e3:g} ms at 60 %: standard {ours[0]:.2f} ms to the paper's {PAPER_STANDARD_MS:g}, "
                f"federated {ours[1]:.2f} to {PAPER_FEDERATED_MS:g}; ratio {compare(at_60[0])} to {PAPER_RATIO:g}."
            )
    return sentences


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    spread = x - x.mean()
    square = float(spread @ spread)
    return float(spread @ y) / square if square else 0.0


def _resampled(values: np.ndarray, chance: np.random.Generator) -> np.ndarray:
    """Means of samples drawn with replacement."""
    return values[chance.integers(0, len(values), (RESAMPLES, len(values)))].mean(axis=1)


def _interval(value: float, samples: np.ndarray) -> Interval:
    low, high = np.quantile(samples, (0.025, 0.975))
    return Interval(value, float(low), float(high))

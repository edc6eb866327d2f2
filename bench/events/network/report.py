"""Analysis and report of the runs: a row for each case and place of the central channel, and the marks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.events.network.experiment import FEDERATED, PAPER, PAPER_LOAD, Case, Outcome
from bench.events.network.robot import PUSHED
from testkit.report import Mark, at_most, summarize

#: The paper's text about Figure 13: the ratio at all loads.
PAPER_RATIO = 0.91
#: Marks of the ratio of the means over all loads, by link. Elsewhere no gain is possible, and the mark bounds the cost:
#: without a delay, with the central channel beside the leader in I, and in II of the paper's network, where half of the
#: events take fewer segments with the federation, and the others more.
RATIO_LIMITS = {PAPER.name: PAPER_RATIO, "0 ms": 1.2, "0.2 ms": 0.9, "1 ms": 0.5, "5 ms": 0.3}
COST_LIMIT = 1.3
#: Share of the standard's bytes between sub-networks that the federation may have on the paper's network.
BYTES_LIMIT = 0.4
#: Load of the leader's core [share] by which a case may miss the wanted one, and load of other programs [cores], beyond
#: which the measurement is invalid.
LOAD_TOLERANCE, OTHERS_TOLERANCE = 0.1, 0.25
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
        return f"{self.value:.2f} ({self.low:.2f}-{self.high:.2f})"


class Cell(NamedTuple):
    """All runs of a case with a central channel in one place, and with the federation. which: events that count."""

    case: Case
    place: str
    standard: list[Outcome]
    federated: list[Outcome]

    @property
    def busy(self) -> float:
        """The measured load of the leader's core [share]."""
        return float(np.mean([run.busy for run in (*self.standard, *self.federated)]))

    @property
    def load(self) -> float:
        """The wanted load; the measured one of a leader whose own turns are the load: it can't reach all."""
        return self.case.load if self.case.leader == PUSHED else self.busy

    @property
    def which(self) -> str:
        """The latencies that count: of all events; for the falling curve, of those that the leader receives."""
        return "all" if self.case.leader == PUSHED else "leader"


def cells(outcomes: Iterable[Outcome]) -> list[Cell]:
    """The cells by case, ascending, and place."""
    runs: dict[Case, dict[str, list[Outcome]]] = {}
    for one in outcomes:
        runs.setdefault(one.case, {}).setdefault(one.set_up, []).append(one)
    return [
        Cell(case, place, runs[case][place], runs[case][FEDERATED])
        for case in sorted(runs)
        for place in sorted(set(runs[case]) - {FEDERATED})
    ]


def means_ms(runs: Sequence[Outcome], which: str = "all") -> np.ndarray:
    """The mean latency of each run [ms]."""
    return np.array([run.latencies_us(which).mean() for run in runs]) / 1e3


def mean(values: np.ndarray) -> Interval:
    """The mean over runs, with an interval from resampling."""
    return Interval.of(float(values.mean()), _resampled(values, np.random.default_rng(1)))


def ratio(numerators: np.ndarray, denominators: np.ndarray) -> Interval:
    """The ratio of two means of runs; both are resampled."""
    chance = np.random.default_rng(2)
    samples = _resampled(numerators, chance) / _resampled(denominators, chance)
    return Interval.of(float(numerators.mean() / denominators.mean()), samples)


def compare(cell: Cell, which: str = "") -> Interval:
    """Ratio of federated to standard, from the means of the runs."""
    which = which or cell.which
    return ratio(means_ms(cell.federated, which), means_ms(cell.standard, which))


def row(cell: Cell) -> dict[str, Any]:
    """A cell as a row of the table and the files: latencies [ms] and traffic between sub-networks in a run."""
    link, scans, load = cell.case.link.name, cell.case.scans, round(100 * cell.case.load)
    found: dict[str, Any] = {"leader": cell.case.leader, "link": link, "scans": scans, "central": cell.place}
    found |= {"load": load, "busy": round(100 * cell.busy)}
    for short, runs in (("std", cell.standard), ("fed", cell.federated)):
        found[f"{short} ms"] = float(means_ms(runs, cell.which).mean())
        p99 = np.quantile(np.concatenate([run.latencies_us(cell.which) for run in runs]), 0.99)
        found[f"{short} p99"] = float(p99) / 1e3
        found[f"{short} KB"] = float(np.mean([run.bytes for run in runs])) / 1e3
        found[f"{short} dropped"] = sum(run.dropped for run in runs)
    found |= {"fed/std (95 %)": str(compare(cell)), **dict(zip(("ratio", "low", "high"), compare(cell), strict=True))}
    found |= {which: round(compare(cell, which).value, 2) for which in ("local", "remote")}
    return {**found, "runs": len(cell.standard)}


def marks(found: Sequence[Cell]) -> list[Mark]:
    """Lost and wrongly forwarded events; the ratios over all loads of one leader, link, scans and place."""
    runs = [run for cell in found for run in (*cell.standard, *cell.federated)]
    across = [abs(run.forwarded - run.wanted_across) for run in runs if run.set_up == FEDERATED]
    result = [
        at_most("events lost", sum(run.lost for run in runs), 0),
        at_most("events over the federation's link too many or too few", sum(across), 0),
    ]
    if any(cell.case.leader != PUSHED for cell in found):  # hypotheses have no marks
        return result
    for curve in curves(found):
        link, scans, place = curve[0].case.link.name, curve[0].case.scans, curve[0].place
        limit = COST_LIMIT if place == "I" or (place, link) == ("II", PAPER.name) else RATIO_LIMITS[link]
        federated, standard = (
            np.concatenate([means_ms(getattr(cell, which)) for cell in curve]) for which in ("federated", "standard")
        )
        what = f"{'ratio' if limit < 1.0 else 'cost'}, {link}, scans of {scans}, central in {place}"
        result.append(at_most(what, ratio(federated, standard).value, limit))
    for cell in found:
        if cell.case == Case(PUSHED, PAPER, "A, B", PAPER_LOAD) and cell.place == "servers":
            federated, standard = (np.array([run.bytes for run in some]) for some in (cell.federated, cell.standard))
            what = "bytes between sub-networks, federated to standard"
            result.append(at_most(what, ratio(federated, standard).value, BYTES_LIMIT))
            result.append(at_most("ratio on the paper's network at 60 %, upper bound", compare(cell).high, 1.0))
    return result


def curves(found: Sequence[Cell]) -> list[list[Cell]]:
    """The cells of each leader, link, scans and place, by load."""
    result: dict[tuple[Any, ...], list[Cell]] = {}
    for cell in found:
        result.setdefault((*cell.case[:3], cell.place), []).append(cell)
    return list(result.values())


def invalid(found: Sequence[Cell], others_cores: float) -> str:
    """Why the measurement is invalid; "" if it is valid. others_cores: CPU time that other programs took."""
    off = max((abs(cell.busy - cell.load) for cell in found if cell.case.load), default=0.0)
    reasons = []
    if off > LOAD_TOLERANCE:
        reasons.append(f"the load of the leader's core is off by up to {100 * off:.0f} points")
    if others_cores > OTHERS_TOLERANCE:
        reasons.append(f"other programs took {others_cores:.2f} cores")
    return "; ".join(reasons)


def _resampled(values: np.ndarray, chance: np.random.Generator) -> np.ndarray:
    """Means of samples drawn with replacement."""
    return values[chance.integers(0, len(values), (RESAMPLES, len(values)))].mean(axis=1)


# ---- tables ----


TITLE = "Figure 13: latency of a central and of federated event channels, ms"
#: The columns of the printed table; the files have all.
SHOWN = (
    *("leader", "link", "scans", "central", "load", "busy"),
    *(f"{short} {what}" for short in ("std", "fed") for what in ("ms", "p99", "KB")),
    *("fed/std (95 %)", "local", "remote"),
)


def write_report(outcomes: Sequence[Outcome], others_cores: float, about: Mapping[str, Any]) -> bool:
    """Print and write all results; whether every mark was reached. Raises NotMeasured if the measurement is invalid.

    others_cores: CPU time that other programs took. about: description of the measurement."""
    found = cells(outcomes)
    reason = invalid(found, others_cores)
    about = {**about, "load of other programs, cores": round(others_cores, 2)}
    print("", *(f"{key}: {value}" for key, value in about.items()), sep="\n")
    samples = {
        ", ".join((*map(str, cell.case._replace(link=cell.case.link.name)), place)): means_ms(runs, cell.which).tolist()
        for cell in found
        for place, runs in ((cell.place, cell.standard), (FEDERATED, cell.federated))
    }
    return summarize(
        "event_network", TITLE, [row(cell) for cell in found], marks(found), samples, "ms", SHOWN, reason, **about
    )

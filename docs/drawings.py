"""The pictures of figures in docs, each drawn from one result, and stamped with what it was drawn from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

#: The text of a PNG file that says what it was drawn from.
STAMP = "Source"
Result = Mapping[str, Any]


class Picture(NamedTuple):
    """result: the name of the one that `draw` draws."""

    result: str
    draw: Callable[[Figure, Result], None]

    def stamp(self, results: Mapping[str, Result]) -> str:
        """Of its data and of this module; "" if there is no result."""
        if self.result not in results:
            return ""
        data = json.dumps(results[self.result], sort_keys=True).encode() + Path(__file__).read_bytes()
        return hashlib.sha256(data).hexdigest()

    def write(self, results: Mapping[str, Result], file: Path) -> None:
        figure = Figure(layout="constrained")
        self.draw(figure, results[self.result])
        FigureCanvasAgg(figure)
        figure.savefig(file, dpi=120, metadata={"Software": None, STAMP: self.stamp(results)})


def stamp_of(file: Path) -> str:
    """What a picture was drawn from; of one without a stamp the hash of the file."""
    with Image.open(file) as picture:
        return str(picture.info.get(STAMP) or hashlib.sha256(file.read_bytes()).hexdigest())


#: The paper's text about Figure 13: the load of the leader's core [%], mean latencies [ms], and their ratio.
PAPER_LOAD, PAPER_MS, PAPER_RATIO = 60, {"standard": 18.5, "fed.": 16.9}, 0.91
COLOURS = {"I": "tab:orange", "II": "tab:red", "servers": "tab:brown", "standard": "tab:red", "fed.": "tab:blue"}


def figure_13(figure: Figure, result: Result) -> None:
    """Plots of latency (top) and ratio (bottom) over the load of the leader's core; a column for each leader and
    link."""
    curves: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in result["rows"]:
        curves.setdefault(tuple(row[key] for key in ("leader", "link", "scans", "central")), []).append(row)
    shown = {key: some for key, some in curves.items() if len(some) > 1}
    columns = list(dict.fromkeys(key[:2] for key in shown))
    figure.set_size_inches(max(7.0, 3.4 * len(columns) + 1.5), 6.4)
    panels = figure.subplots(2, len(columns), sharex=True, sharey="row", squeeze=False)
    for upper, lower, column in zip(*panels, columns, strict=True):
        here = {key[-1]: some for key, some in shown.items() if key[:2] == column}
        _line(upper, next(iter(here.values())), "fed ms", "tab:blue", "federated")
        for place, rows in here.items():
            _line(upper, rows, "std ms", COLOURS[place], f"central in {place}")
            _line(lower, rows, "ratio", COLOURS[place], f"to central in {place}")
            bars = [[row["ratio"] - row["low"] for row in rows], [row["high"] - row["ratio"] for row in rows]]
            lower.errorbar(_loads(rows), [row["ratio"] for row in rows], bars, color=COLOURS[place], linestyle="")
        for label, ms in PAPER_MS.items():
            upper.plot([PAPER_LOAD], [ms], "*", color=COLOURS[label], markersize=11, label=f"paper, {label}")
        lower.axhline(PAPER_RATIO, linestyle="--", color="tab:green", label=f"paper, {PAPER_RATIO}")
        upper.set(title=", ".join(column), yscale="log")
        lower.set(xlabel="load of the leader's core, %", xlim=(-2, 102))
        for axes in (upper, lower):
            axes.grid(alpha=0.3, which="both")
    for axes, label in ((panels[0][0], "mean latency, ms"), (panels[1][0], "federated / standard")):
        axes.set(ylabel=label)
        axes.legend(fontsize="x-small")
    panels[1][0].set_ylim(0.0, None)
    figure.suptitle(result["title"])


def _loads(rows: Sequence[Result]) -> list[float]:
    """The wanted loads; the measured ones of a leader whose own turns are the load: it can't reach all."""
    return [row["load"] if row["leader"] == "pushed" else row["busy"] for row in rows]


def _line(axes: Axes, rows: Sequence[Result], what: str, colour: str, label: str) -> None:
    axes.plot(_loads(rows), [row[what] for row in rows], "o-", markersize=4, color=colour, label=label)


def fan_out(figure: Figure, result: Result) -> None:
    """Deliveries and times over the number of consumers."""
    figure.set_size_inches(8, 4.5)
    axes = figure.add_subplot()
    for peer in dict.fromkeys(row["consumers are"] for row in result["rows"]):
        rows = [row for row in result["rows"] if row["consumers are"] == peer]
        for what in ("deliveries/s", "to subscribe, s"):
            axes.plot([row["consumers"] for row in rows], [row[what] for row in rows], "o-", label=f"{peer}, {what}")
    axes.set(xlabel="consumers", xscale="log", yscale="log", ylabel="deliveries/s; s to subscribe all")
    axes.set(title=result["title"])
    axes.grid(alpha=0.3)
    axes.legend()


PICTURES = {
    "docs/figure-13.png": Picture("event_network-network-paper", figure_13),
    "docs/pictures/figure-13-leaders.png": Picture("event_network-network-paper-leader-all", figure_13),
    "docs/pictures/event-channel-fanout.png": Picture("event_channel_fanout", fan_out),
}

"""A mission's timeline as a picture: what each robot did when, and who waited for whom."""

from __future__ import annotations

from pathlib import Path
from typing import Any

PICTURE, SHOWS = "timeline.png", "Who waited for whom"
WIDTH_IN, ROW_IN = 11.0, 0.55
WORKS, WAITS = "#3b7dd8", "#e8c46a"
#: Names of phases begin no closer to each other than this share of the whole: the first ones are over in no time.
LEAST_APART = 0.025


def draw(report: dict[str, Any], file: Path) -> None:
    """report: as `record.as_json` makes it. Writes a PNG file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    robots = sorted(report["robots"], key=lambda name: (report["robots"][name] != "leader", name))
    figure, axes = pyplot.subplots(figsize=(WIDTH_IN, 1.6 + ROW_IN * max(1, len(robots))))
    above, written_at = len(robots) - 0.4, -float("inf")
    for phase in report["phases"]:
        done = phase["done_s"]
        end = max(done.values(), default=report["seconds"])
        for row, name in enumerate(robots):
            began = phase["started_s"].get(name, phase["began_s"])
            finished = done.get(name, end)
            axes.barh(row, finished - began, left=began, height=0.6, color=WORKS)
            axes.barh(row, max(0.0, end - finished), left=finished, height=0.6, color=WAITS)
        axes.axvline(phase["began_s"], color="0.6", linewidth=0.6)
        written_at = max(phase["began_s"], written_at + LEAST_APART * report["seconds"])
        axes.plot((phase["began_s"], written_at), (above, above + 0.15), color="0.6", linewidth=0.6, clip_on=False)
        axes.text(written_at, above + 0.15, f" {phase['name']}", fontsize=7, rotation=40, va="bottom")
    axes.set_yticks(range(len(robots)), [f"{name} ({report['robots'][name]})" for name in robots])
    axes.set_xlim(left=0.0)
    axes.set_ylim(-0.6, above)
    axes.set_xlabel("s since the mission began; blue: at work, yellow: waiting for the others")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.savefig(file, dpi=110, bbox_inches="tight")
    pyplot.close(figure)

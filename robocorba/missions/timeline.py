"""The timeline of a mission as a picture: when each robot worked in each phase, and when it waited for the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

#: File name of the picture, and its caption on the report page.
PICTURE, CAPTION = "timeline.png", "Timeline: when each robot worked and waited"
#: Width of the picture, and height of a robot's row [inches].
WIDTH_IN, ROW_IN = 11.0, 0.55
WORK_COLOUR, WAIT_COLOUR = "#3b7dd8", "#e8c46a"
#: Minimum distance between the labels of two phases, as a share of the duration: the first phases are very short.
LABEL_SPACING = 0.025


def draw(report: dict[str, Any], file: Path) -> None:
    """Write a PNG file. report: of `MissionReport.as_json`."""
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
            axes.barh(row, finished - began, left=began, height=0.6, color=WORK_COLOUR)
            axes.barh(row, max(0.0, end - finished), left=finished, height=0.6, color=WAIT_COLOUR)
        axes.axvline(phase["began_s"], color="0.6", linewidth=0.6)
        written_at = max(phase["began_s"], written_at + LABEL_SPACING * report["seconds"])
        axes.plot((phase["began_s"], written_at), (above, above + 0.15), color="0.6", linewidth=0.6, clip_on=False)
        axes.text(written_at, above + 0.15, f" {phase['name']}", fontsize=7, rotation=40, va="bottom")
    axes.set_yticks(range(len(robots)), [f"{name} ({report['robots'][name]})" for name in robots])
    axes.set_xlim(left=0.0)
    axes.set_ylim(-0.6, above)
    axes.set_xlabel("s since the mission began; blue: working, yellow: waiting for the others")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.savefig(file, dpi=110, bbox_inches="tight")
    pyplot.close(figure)

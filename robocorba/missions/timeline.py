"""The timeline of a mission as a picture: when each robot worked in each phase, and when it waited for the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

#: File name of the picture, and its caption on the report page.
PICTURE, CAPTION = "timeline.png", "Timeline: when each robot worked and waited"


def draw(report: dict[str, Any], file: Path) -> None:
    """Write a PNG file. report: of `MissionReport.as_json`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    robots = sorted(report["robots"], key=lambda name: (report["robots"][name] != "leader", name))
    figure, axes = pyplot.subplots(figsize=(11.0, 1.6 + 0.55 * max(1, len(robots))))
    above, written_at = len(robots) - 0.4, -float("inf")
    for phase in report["phases"]:
        done = phase["done_s"]
        end = max(done.values(), default=report["seconds"])
        for row, name in enumerate(robots):
            began = phase["started_s"].get(name, phase["began_s"])
            finished = done.get(name, end)
            axes.barh(row, finished - began, left=began, height=0.6, color="#3b7dd8")
            axes.barh(row, max(0.0, end - finished), left=finished, height=0.6, color="#e8c46a")
        axes.axvline(phase["began_s"], color="0.6", linewidth=0.6)
        # Labels keep 2.5 % of the duration apart: the first phases are very short.
        written_at = max(phase["began_s"], written_at + 0.025 * report["seconds"])
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

"""A mission's report as a web page: result, pictures, figures, every event."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

PAGE = "report.html"
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; }
td, th { padding: .2rem .8rem; border-bottom: 1px solid #ddd; text-align: left; }
img, video { max-width: 100%; border: 1px solid #ddd; } .done { color: #1a7f37; } .failed, .aborted { color: #b42318; }
details { margin: 1rem 0; } small { color: #666; }
"""


def write(report: dict[str, Any], folder: Path, pictures: Sequence[tuple[str, str]] = (), film: str = "") -> Path:
    """report: as `record.as_json` makes it. pictures: files in the folder, and what they show. Returns the page."""
    title = f"{report['kind']}: {report['thing']}"
    parts = [
        f"<h1>{_text(title)}</h1>",
        f"<p class='{report['result']}'><b>{_text(report['result'])}</b> {_text(report['reason'])}</p>",
        f"<p>Led by {_text(report['leader'])}, {report['seconds']:.1f} s, mission {_text(report['mission'])}</p>",
    ]
    parts += [f"<h2>{_text(what)}</h2><img src='{_text(file)}' alt='{_text(what)}'>" for file, what in pictures]
    if film:
        parts.append(f"<h2>Film</h2><video src='{_text(film)}' controls></video>")
    parts += ["<h2>Phases</h2>", _table(("phase", "from", "took", "waited for", "skew at its start"), _phases(report))]
    parts += ["<h2>Figures</h2>", _table(("what", "median", "p99", "most"), _figures(report))]
    events = [(f"{event['at_s']:.3f} s", event["type"], event["source"], event["origin"]) for event in report["events"]]
    parts.append(f"<details><summary>{len(events)} events that the leader heard</summary>")
    parts += [_table(("at", "type", "from", "by channel"), events), "</details>"]
    page = folder / PAGE
    head = f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{_text(title)}</title><style>{_STYLE}</style>"
    page.write_text(f"{head}<body>{''.join(parts)}</body></html>")
    return page


def _phases(report: dict[str, Any]) -> Iterable[Sequence[str]]:
    for phase in report["phases"]:
        took = max(phase["done_s"].values(), default=phase["began_s"]) - phase["began_s"]
        skew = "" if phase["skew_ms"] is None else f"{phase['skew_ms']:.1f} ms"
        yield phase["name"], f"{phase['began_s']:.1f} s", f"{took:.1f} s", phase["waited_for"], skew


def _figures(report: dict[str, Any]) -> Iterable[Sequence[str]]:
    if skew := report["tick_skew_ms"]:
        yield "skew between carriers at each tick", *_spread(skew, "ms")
    for origin, latency in report["latency_ms"].items():
        yield f"latency of events that came in at {origin}", *_spread(latency, "ms")
    if report["farthest_grip_m"] is not None:
        yield "grip from the hand while carrying", "", "", f"{1000 * report['farthest_grip_m']:.1f} mm"


def _spread(found: dict[str, float], unit: str) -> tuple[str, str, str]:
    return f"{found['median']:.1f} {unit}", f"{found['p99']:.1f} {unit}", f"{found['max']:.1f} {unit}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = "".join(f"<th>{_text(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def _text(value: object) -> str:
    return html.escape(str(value), quote=True)

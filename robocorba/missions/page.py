"""A mission's report as a web page: result, pictures, film, figures, every event."""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

PAGE = "report.html"
#: Column heads.
PHASES = ("phase", "from [s]", "duration [s]", "waited for", "skew at its start [ms]")
LATENCIES = ("from sub-network", "messages", "median [ms]", "p99 [ms]", "max [ms]")
LATENCIES_TITLE = "Latency of messages to the leader"
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; }
td, th { padding: .2rem .8rem; border-bottom: 1px solid #ddd; text-align: left; }
img, video { max-width: 100%; border: 1px solid #ddd; } .done { color: #1a7f37; } .failed { color: #b42318; }
figure { margin: 1rem 0; } details { margin: 1rem 0; } summary { cursor: pointer; }
"""


def write(
    report: dict[str, Any],
    folder: Path,
    pictures: Sequence[tuple[str, str]] = (),
    film: str = "",
    facts: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write the page into `folder` and return its file. report: of `MissionReport.as_json`.

    pictures: files in the folder, with captions. film: a file in the folder. facts: more rows of name and value."""
    title = f"{report['kind']}: {report['thing']}"
    parts = [
        f"<h1>{_text(title)}</h1>",
        f"<p class='{_text(report['result'])}'><b>{_text(report['result'])}</b> {_text(report['reason'])}</p>",
        f"<p>Led by {_text(report['leader'])}, {report['seconds']:.1f} s, mission {_text(report['mission'])}</p>",
    ]
    if facts:
        parts.append(_table((), facts))
    if film:
        parts.append(f"<h2>Film</h2><video src='{_text(film)}' controls muted loop playsinline></video>")
    for file, what in pictures:
        caption = _text(what)
        parts.append(f"<figure><h2>{caption}</h2><img src='{_text(file)}' alt='{caption}'></figure>")
    parts += ["<h2>Phases</h2>", _table(PHASES, phases(report))]
    parts += [f"<h2>{LATENCIES_TITLE}</h2>", _table(LATENCIES, latencies(report))]
    parts += ["<h2>While carrying</h2>", _table(("", "median", "p99", "max"), _carrying(report))]
    count = len(report["events"])
    parts.append(f"<details><summary>{count} messages that the leader received, in order of receipt</summary>")
    parts += [_table(("at [s]", "type", "from", "sub-network", "latency [ms]"), _events(report)), "</details>"]
    page = folder / PAGE
    head = f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{_text(title)}</title><style>{_STYLE}</style>"
    page.write_text(f"{head}<body>{''.join(parts)}</body></html>", encoding="utf-8")
    return page


def phases(report: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """The rows of the table PHASES."""
    for phase in report["phases"]:
        took = max(phase["done_s"].values(), default=phase["began_s"]) - phase["began_s"]
        skew = "" if phase["skew_ms"] is None else f"{phase['skew_ms']:.1f}"
        yield phase["name"], f"{phase['began_s']:.1f}", f"{took:.1f}", phase["waited_for"], skew


def latencies(report: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """The rows of the table LATENCIES: one for each sub-network of origin, the leader's own first."""
    own = {event["origin"] for event in report["events"] if event["source"] == report["leader"]}
    for origin, found in sorted(report["latency_ms"].items(), key=lambda item: (item[0] not in own, item[0])):
        route = "the leader's own" if origin in own else "through its gateway"
        figures = (f"{found[key]:.2f}" for key in ("median", "p99", "max"))
        yield f"{origin}, {route}", str(found["count"]), *figures


def _carrying(report: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    if skew := report["tick_skew_ms"]:
        figures = (f"{skew[key]:.1f} ms" for key in ("median", "p99", "max"))
        yield "skew between carriers at each tick", *figures
    if report["farthest_grip_m"] is not None:
        yield "grip from the hand", "", "", f"{1000 * report['farthest_grip_m']:.1f} mm"


def _events(report: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for event in report["events"]:
        latency = f"{event['latency_ms']:.2f}"
        yield f"{event['at_s']:.3f}", event["type"], event["source"], event["origin"], latency


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = "".join(f"<th>{_text(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{f'<tr>{cells}</tr>' if head else ''}{body}</table>"


def _text(value: object) -> str:
    return html.escape(str(value), quote=True)

"""A fleet on the terminal: progress, then a table that stays up to date; otherwise a line for each change."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.console import Group
from rich.live import Live
from rich.text import Text

from robocorba.commands.tables import Sheet
from robocorba.system.printing import Console, echo, line
from robocorba.system.supervision.fleet import Row, View

HEADER = ("robot", "floor", "does", "program or mission", "restarts", "note")
#: States of robots that are not under way, in the order in which they are shown: first what needs attention.
ATTENTION = ("ended", "exceptional", "queued", "starting")


class FleetView(View):
    """Use it in a `with`. In a terminal it is a table that replaces itself and at the end keeps the robots that failed,
    otherwise each row that differs from the one before, and `ready` once all robots have started."""

    def __init__(self, console: Console) -> None:
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="ellipsis")
        self._is_terminal = console.is_terminal
        self._shown: dict[str, Row] = {}

    def __enter__(self) -> FleetView:
        if self._is_terminal:
            self._live.start()
        else:
            line(*HEADER)
        return self

    def __exit__(self, *raised: object) -> None:
        self._live.stop()

    def show(self, rows: Sequence[Row]) -> None:
        for row in rows:
            if not self._is_terminal and self._shown.get(row.name) != row:
                line(*row)
            self._shown[row.name] = row
        if self._is_terminal:
            self._live.update(Group(starting_of(rows), table_of(rows)), refresh=True)

    def started(self) -> None:
        if not self._is_terminal:
            echo("ready")

    def end(self, robots: int, running: int) -> None:
        text = Text(f"ending: {robots - running} of {robots} have ended" if running else "all robots have ended")
        failed = [row for row in self._shown.values() if row.doing == "ended"]
        if self._is_terminal:
            self._live.update(Group(text, *([table_of(failed)] if failed else [])), refresh=True)


def starting_of(rows: Sequence[Row]) -> Text:
    """The progress of the start, or the number of robots in each state."""
    ready = sum(row.doing not in ("queued", "starting") for row in rows)
    if ready < len(rows):
        return Text(f"{ready} of {len(rows)} robots have started")
    counts = Counter(row.doing for row in rows)
    return Text(f"{len(rows)} robots: " + ", ".join(f"{count} {doing}" for doing, count in sorted(counts.items())))


def table_of(rows: Sequence[Row]) -> Sheet:
    """First the robots that need attention, then those that work, then those that wait; each in the given order."""

    def rank(row: Row) -> int:
        return ATTENTION.index(row.doing) if row.doing in ATTENTION else len(ATTENTION) + (row.doing == "waiting")

    ordered: list[Row] = sorted(rows, key=rank)
    return Sheet(HEADER, ordered, spare=("restarts", "floor"))

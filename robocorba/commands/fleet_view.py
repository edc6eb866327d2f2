"""A fleet on the terminal: progress, then a table that stays up to date; otherwise a line for each change."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from robocorba.system.logs import one_line
from robocorba.system.printing import Console, echo, line
from robocorba.system.supervision.fleet import Row, View

HEADER = ("robot", "floor", "does", "program or mission", "restarts", "note")
#: States of robots that are not under way, in the order in which they are shown: first what needs attention.
ATTENTION = ("ended", "exceptional", "queued", "starting")
#: States before a robot is ready.
NOT_READY = ("queued", "starting")


def view_for(console: Console) -> LinesView | TableView:
    """What fits the console; use it in a `with`."""
    return TableView(console) if console.is_terminal else LinesView()


class LinesView(View):
    """Prints each row that differs from the one before, tab-separated; then `ready` once all robots have started."""

    def __init__(self) -> None:
        self._shown: dict[str, tuple[str, ...]] = {}

    def __enter__(self) -> LinesView:
        return self

    def __exit__(self, *raised: object) -> None:
        pass

    def show(self, rows: Sequence[Row]) -> None:
        for row in rows:
            cells = cells_of(row)
            if self._shown.get(row.name) != cells:
                self._shown[row.name] = cells
                line(*cells)

    def started(self) -> None:
        echo("ready")

    def end(self, robots: int, running: int) -> None:
        pass


class TableView(View):
    """A table that replaces itself; at the end it keeps the robots that failed."""

    def __init__(self, console: Console) -> None:
        self._console, self._rows = console, list[Row]()
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="ellipsis")

    def __enter__(self) -> TableView:
        self._live.start()
        return self

    def __exit__(self, *raised: object) -> None:
        self._live.stop()

    def show(self, rows: Sequence[Row]) -> None:
        self._rows = list(rows)
        self._live.update(Group(starting_of(rows), table_of(rows)), refresh=True)

    def started(self) -> None:
        pass

    def end(self, robots: int, running: int) -> None:
        text = f"ending: {robots - running} of {robots} have ended" if running else "all robots have ended"
        failed = [row for row in self._rows if row.doing == "ended"]
        self._live.update(Group(Text(text), table_of(failed)) if failed else Text(text), refresh=True)


def starting_of(rows: Sequence[Row]) -> RenderableType:
    """The progress of the start, or the number of robots in each state."""
    ready = sum(row.doing not in NOT_READY for row in rows)
    if ready < len(rows):
        grid = Table.grid(padding=(0, 1))
        grid.add_row(Text(f"{ready} of {len(rows)} robots have started"), ProgressBar(len(rows), ready, width=40))
        return grid
    counts = Counter(row.doing for row in rows)
    return Text(f"{len(rows)} robots: " + ", ".join(f"{count} {doing}" for doing, count in sorted(counts.items())))


def table_of(rows: Sequence[Row]) -> Table:
    """First the robots that need attention, then those that work, then those that wait; each in the given order."""

    def rank(row: Row) -> int:
        return ATTENTION.index(row.doing) if row.doing in ATTENTION else len(ATTENTION) + (row.doing == "waiting")

    table = Table(*HEADER)
    for row in sorted(rows, key=rank):
        style = "bold red" if row.doing in ("ended", "exceptional") else ""
        table.add_row(*(Text(cell, overflow="ellipsis") for cell in cells_of(row)), style=style)
    return table


def cells_of(row: Row) -> tuple[str, ...]:
    """A row as text, without line breaks and control characters."""
    return tuple(one_line(str(cell)) for cell in row)

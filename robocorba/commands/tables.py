"""How commands print facts: as tables that fit the terminal, in a pipe as a header and rows with tabs, or as JSON."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
from rich.cells import cell_len
from rich.console import ConsoleOptions
from rich.table import Table
from rich.text import Text

from robocorba.system.logs import one_line
from robocorba.system.printing import Console, echo, line

_NUMBER = re.compile(r"(-?\d+(\.\d+)?( [^\d\s]+)?)?")


@dataclass(frozen=True)
class Sheet:
    """Rows of cells below their titles; rich shows it as a table of the width that there is. spare: titles of columns
    that a narrow terminal leaves out, first the first."""

    titles: Sequence[str]
    rows: Sequence[Sequence[Any]]
    spare: Sequence[str] = ()
    title: str = ""
    notes: Sequence[str] = ()

    def __rich_console__(self, console: Any, options: ConsoleOptions) -> Iterator[Table | Text]:
        omitted: list[str] = []
        spare = [title for title in self.spare if title in self.titles]
        while (found := self._fitting(omitted, options.max_width)) is None and spare:
            omitted.append(spare.pop(0))
        table = Table(title=Text(one_line(self.title)) if self.title else None, title_justify="left")
        if omitted:
            table.caption = Text(f"wider terminals and --json also show: {', '.join(omitted)}")
        columns = [(place, None) for place, title in enumerate(self.titles) if title not in omitted]
        for place, width in found or columns:
            is_number = all(map(_NUMBER.fullmatch, self._cells(place)))
            justify = "right" if is_number and any(self._cells(place)) else "left"
            table.add_column(Text(self.titles[place]), justify=justify, width=width, overflow="fold")  # type: ignore[arg-type]
        for row in zip(*(self._cells(place) for place, _ in found or columns), strict=True):
            table.add_row(*map(Text, row))
        yield table
        yield from map(Text, map(one_line, self.notes))

    def _cells(self, place: int) -> list[str]:
        return [one_line(str(row[place])) for row in self.rows]

    def _fitting(self, omitted: Sequence[str], width: int) -> list[tuple[int, int]] | None:
        """Places and widths of the other columns, in which words of up to 24 characters are whole; None if they are too
        wide together."""
        most, least = {}, {}
        for place, title in enumerate(self.titles):
            if title not in omitted:
                cells = self._cells(place)
                most[place] = max(map(cell_len, (title, *cells)))
                words = (word for cell in cells for word in ([cell] if cell_len(cell) <= 12 else cell.split()))
                least[place] = max(*map(cell_len, title.split()), *(min(cell_len(word), 24) for word in words), 0)
        room = width - 3 * len(least) - 1 - sum(least.values())
        for place in sorted(least, key=lambda place: most[place] - least[place]) if room > 0 else ():
            extra = min(most[place] - least[place], room)
            least[place], room = least[place] + extra, room - extra
        return None if room < 0 else list(least.items())


def show(*sheets: Sheet) -> None:
    """Print tables; without a terminal each is a line of column titles and a line for each row, separated by tabs, with
    title and notes as comments; an empty line separates tables."""
    console = Console()
    for number, sheet in enumerate(sheets):
        if console.is_terminal:
            console.print(sheet)
            continue
        if number:
            echo()
        if sheet.title:
            line(f"# {sheet.title}")
        for cells in (sheet.titles, *sheet.rows):
            line(*cells)
        for note in sheet.notes:
            line(f"# {note}")


def print_json(facts: Any) -> None:
    """Print values of JSON types, msgspec's structs or dataclasses."""
    echo(msgspec.json.format(msgspec.json.encode(facts), indent=2).decode())


def snake_cased(value: Any) -> Any:
    """A plain value of the IDL with keys as in all our JSON, map_version for mapVersion."""
    if isinstance(value, dict):
        return {
            re.sub("(?<=[a-z])[A-Z]", lambda found: f"_{found[0].lower()}", key): snake_cased(each)
            for key, each in value.items()
        }
    return [snake_cased(each) for each in value] if isinstance(value, list | tuple) else value

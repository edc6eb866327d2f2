"""What programs print: the one place where text from elsewhere is made harmless for a terminal.

Names, reasons and payloads come from every client that reaches a port. Control characters in them could move the
cursor, rewrite what was printed, or set the terminal's title; directional overrides could reorder a line. They are
shown escaped."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, NoReturn

import rich.console
from rich.segment import Segment
from rich.text import Text

from robocorba.system.logs import one_line


def safe(text: str) -> str:
    """`text` with all control characters escaped except line feeds and tabs."""
    return "\n".join("\t".join(map(one_line, row.split("\t"))) for row in text.split("\n"))


def echo(text: str = "", err: bool = False) -> None:
    """Print text, which may have several lines. Foreign text in it could begin a new line: print that by `line`."""
    stream = sys.stderr if err else sys.stdout
    try:
        stream.write(f"{safe(text)}\n")
    except UnicodeEncodeError:  # the terminal's encoding lacks a character
        encoding = stream.encoding or "ascii"
        stream.write(f"{safe(text).encode(encoding, 'backslashreplace').decode(encoding)}\n")
    stream.flush()


def line(*fields: object, err: bool = False) -> None:
    """Print one line: fields separated by tabs. A field can't begin another field or line."""
    echo("\t".join(one_line(str(each)) for each in fields), err)


def fail(reason: str) -> NoReturn:
    """Print why the program fails as one line on stderr, and end it with exit code 1."""
    line(reason, err=True)
    sys.exit(1)


class Console(rich.console.Console):
    """A Console of rich that escapes the text of tables, trees and lines; styles and positions are its own."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(safe(text), **options)  # before it is measured

    def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(safe(segment.text), segment.style)

"""Writes the table of docs/formats.md from what the modules of robocorba/map_editor/formats declare:
python docs/make_formats.py"""

from __future__ import annotations

from pathlib import Path

from robocorba.map_editor.formats import known_formats

PAGE = Path(__file__).resolve().parent / "formats.md"
HEAD = "| format | read | written | files |\n|---|---|---|---|\n"


def with_table(page: str) -> str:
    """The page with a row for each format in its table."""
    before, after = page.split(HEAD)
    rows = [
        f"| `{each.name}` | {'yes' if each.read else 'no'} | {'yes' if each.write else 'no'} | {each.files} |\n"
        for each in known_formats()
    ]
    return before + HEAD + "".join(rows) + after[after.index("\n\n") + 1 :]


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text()))

"""What programs print can't steer a terminal."""

from __future__ import annotations

import io
import json

import pytest
from rich.table import Table

from robocorba.printing import Console, echo, line

EVIL = "\x1b[2Jname\x9b1m\x07\u202e\u2066\r"


def test_a_field_begins_no_line_and_no_field(capsys: pytest.CaptureFixture[str]) -> None:
    line("A\nB\tstands", EVIL, 3)
    assert capsys.readouterr().out == "A\\nB\\tstands\t\\x1b[2Jname\\u009b1m\\x07\\u202e\\u2066\\r\t3\n"


def test_a_text_keeps_its_lines(capsys: pytest.CaptureFixture[str]) -> None:
    echo(f"a\tb\n{EVIL}", err=True)
    assert capsys.readouterr().err == "a\tb\n\\x1b[2Jname\\u009b1m\\x07\\u202e\\u2066\\r\n"


def test_names_in_other_scripts_stay_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    names = ["Küche", "厨房", "מטבח", "🤖"]
    line(*names)
    assert capsys.readouterr().out == "\t".join(names) + "\n"


def test_json_stays_json(capsys: pytest.CaptureFixture[str]) -> None:
    value = {"name": EVIL + "\x7f\x85\u2028"}
    echo(json.dumps(value, ensure_ascii=False))
    printed = capsys.readouterr().out
    assert json.loads(printed) == value
    assert printed[:-1].isprintable()


def test_tables_keep_their_own_styles_only() -> None:
    table = Table("robot")
    table.add_row(EVIL, style="bold")
    out = io.StringIO()
    Console(file=out, force_terminal=True, width=60, color_system="standard", legacy_windows=False).print(table)
    printed = out.getvalue()
    assert "\\x1b[2Jname\\u009b1m" in printed and "\x1b[1m" in printed
    assert not {"\x1b[2J", "\x9b", "\x07", "\u202e"} & {printed[i : i + n] for i in range(len(printed)) for n in (1, 4)}


def test_a_terminal_without_a_character_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", stream)
    line("Küche")
    assert stream.buffer.getvalue() == b"K\\xfcche\n"  # type: ignore[attr-defined]

"""The table of `robocorba up`."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from robocorba.commands.up import as_table
from robocorba.supervision.folder import ProcessRecord, SystemRecord


@pytest.mark.parametrize("width", [60, 80, 200])
def test_addresses_are_whole_in_any_terminal(width: int) -> None:
    editor = ProcessRecord(
        "map_editor", "running", 123456, "", ("RoboCorba/MapEditor", "RoboCorba/PathPlanner"), 0.0, 0
    )
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(as_table(SystemRecord("192.168.100.200:28090", 1, 0.0, (editor,))))
    rows = [line.split("│")[3].strip() for line in console.export_text().splitlines() if line.startswith("│")]
    assert "".join(rows) == "".join(
        f"corbaname::192.168.100.200:28090#RoboCorba/{name}" for name in ("MapEditor", "PathPlanner")
    )

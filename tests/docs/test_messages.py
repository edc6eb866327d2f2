"""docs/troubleshooting.md quotes messages that RoboCorba prints."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "troubleshooting.md"
#: Messages of others: omniORB's, and the form of all messages about map files.
FOREIGN = re.compile(r"CORBA\.|COMM_FAILURE|TRANSIENT_|FILE:LINE")


def messages() -> list[str]:
    """Those in the first column, in code."""
    rows = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    return [quoted for row in rows for quoted in re.findall(r"`([^`]+)`", row.split(" | ")[0])]


def source() -> str:
    """All texts that the package and the Makefile contain; a text that continues on the next line is in one piece."""
    files = [*(ROOT / "robocorba").rglob("*.py"), ROOT / "Makefile"]
    return "\n".join(re.sub(r'"\s*\n\s*f?"', "", file.read_text()) for file in files)


SOURCE = source()


@pytest.mark.parametrize("message", messages())
def test_the_message_is_one_of_ours(message: str) -> None:
    parts = [part.strip(" ,:") for part in FOREIGN.split(message)[0].removesuffix("(").split("...")]
    for part in filter(None, parts):
        assert part in SOURCE, f"nothing prints {part!r}"


def test_there_are_messages() -> None:
    assert len(messages()) > 30

"""The site's pages: references are whole, and links lead to files."""

from __future__ import annotations

import re
from pathlib import Path

from docs.make_site import LINK, write_pages
from robocorba.commands import SUBCOMMANDS
from tests.docs.test_documents import ROOT


def test_references_are_whole_and_links_lead_to_files(tmp_path: Path) -> None:
    write_pages(tmp_path)
    commands = (tmp_path / "commands.md").read_text()
    assert all(f"## robocorba {name}\n" in commands for name in (*SUBCOMMANDS, "events tail", "map check"))
    for file in (ROOT / "idl").glob("*.idl"):
        page = (tmp_path / "idl" / f"{file.stem}.md").read_text()
        for name in re.findall(
            r"^(?:  )?(?:interface|struct|exception|enum|union) (\w+)[^;]*$", file.read_text(), re.M
        ):
            assert f"## {name}\n" in page, file.name
    for page in tmp_path.rglob("*.md"):
        for *_, target, _ in LINK.findall(page.read_text()):
            assert "://" in target or (page.parent / target).exists(), (page.name, target)

"""Makes the documentation as a site: python -m docs.make_site [FOLDER], by default docs/site. Needs the extra `docs`.

The pages of this folder, CHANGELOG.md and CONTRIBUTING.md, a reference of the commands from their helps, one of the IDL
from its files, and that of the Python API. Fails at a link that leads nowhere."""

from __future__ import annotations

import functools
import logging
import os
import re
import shutil
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.main import get_command

from docs import make_api
from robocorba.commands import NAME, command

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
LINK = re.compile(r"(!?)\[([^]]*)\]\(([^)#\s]+)(#[^)]*)?\)")
#: A declaration of an IDL file or in its module.
DECLARATION = (
    r"^(?:  )?(?:abstract |local )?(?:interface|struct|exception|enum|union|valuetype|typedef|const)\s"
    r"[^;{]*?(\w+)(?:<[^>]*>)?\s*(?:[:={;\[]|switch\b)"
)


def command_reference() -> str:
    """The page of all commands, from their helps."""
    return "# Commands\n\n" + "\n".join(_described(NAME, get_command(command())))


def _described(words: str, one: Any) -> Iterator[str]:
    if help := (one.help or "").strip():
        yield f"{'' if words == NAME else f'## {words}'}\n\n{help}\n"
    parts = getattr(one, "commands", {})
    for name, part in parts.items():
        yield from _described(f"{words} {name}", part)
    shown = [each for each in one.params if not each.hidden and each.name != "help"] if not parts else []
    if shown:
        yield "| argument or option | meaning |\n|---|---|"
        for each in shown:
            names = ", ".join(f"`{option}`" for option in each.opts) if each.opts[0].startswith("-") else ""
            metavar = "" if getattr(each, "is_flag", False) else f" `{each.metavar or each.name.upper()}`"
            yield f"| {names}{metavar} | {(each.help or '').strip()} |".replace("\n", " ")
        yield ""


def idl_reference(file: Path) -> str:
    """The page of an IDL file: each declaration with the comments before it."""
    title, _, text = file.read_text().partition("\n\n")
    found = list(re.finditer(DECLARATION, text, re.MULTILINE))
    starts = [_with_comment(text, each.start()) for each in found]
    page = [f"# {file.name}", re.sub(r"^// ?", "", title, flags=re.MULTILINE)]
    for each, start, end in zip(found, starts, [*starts[1:], text.rindex("}")], strict=True):
        page += [f"## {each[1]}", f"```cpp\n{textwrap.dedent(text[start:end].rstrip())}\n```"]
    return "\n\n".join(page) + "\n"


def _with_comment(text: str, start: int) -> int:
    """Where the comment lines begin that end before `start`, the beginning of a line."""
    while (line := text[:start].rstrip("\n").rpartition("\n")[2]).lstrip().startswith("//"):
        start = text.rindex(line, 0, start)
    return start


def write_pages(folder: Path) -> None:
    """All pages as Markdown, with links to each other, and the files of the repository to which they refer."""
    for page in [*DOCS.glob("*.md"), *DOCS.glob("tutorials/*.md"), ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"]:
        to = folder / (page.relative_to(DOCS) if DOCS in page.parents else page.name)
        to.parent.mkdir(parents=True, exist_ok=True)
        rewritten = functools.partial(_rewritten, page=page, to=to, folder=folder)
        to.write_text(LINK.sub(rewritten, page.read_text()))
    (folder / "commands.md").write_text(command_reference())
    files = sorted((ROOT / "idl").glob("*.idl"))
    (folder / "idl").mkdir()
    for file in files:
        (folder / "idl" / f"{file.stem}.md").write_text(idl_reference(file))
    rows = [
        f"- [{file.name}]({file.stem}.md): {file.read_text().splitlines()[0].removeprefix('// ')}\n" for file in files
    ]
    (folder / "idl" / "index.md").write_text("# IDL reference\n\n" + "".join(rows))


def _rewritten(link: re.Match[str], page: Path, to: Path, folder: Path) -> str:
    """A link for the site: to another page, to a copy of a file, or only its text for a folder."""
    image, text, target, anchor = link[1], link[2], link[3], link[4] or ""
    file = (page.parent / target).resolve()
    if "://" in target:
        return link[0]
    if file == ROOT / "idl" or file.suffix == ".idl":
        at = folder / "idl" / f"{'index' if file.is_dir() else file.stem}.md"
    elif file.suffix == ".md":
        at = folder / file.relative_to(DOCS if DOCS in file.parents else ROOT)
    elif file.is_dir():
        return text
    else:
        at = folder / "files" / file.relative_to(ROOT)
        at.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, at)
    return f"{image}[{text}]({os.path.relpath(at, to.parent)}{anchor})"


def main(folder: str = str(DOCS / "site")) -> None:
    from mkdocs.commands.build import build  # only with the extra `docs`
    from mkdocs.config import load_config

    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    with tempfile.TemporaryDirectory() as pages:
        write_pages(Path(pages))
        make_api.make(Path(pages) / "api")
        build(load_config(str(DOCS / "mkdocs.yml"), docs_dir=pages, site_dir=folder))
    print(Path(folder) / "index.html")


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Makes the tables and pictures of README.md and docs from bench/results: python -m docs.make_figures [--check]

docs/figures.yaml says which figure comes from which result. With --check nothing is written: exit code 1 if a page,
picture or result is not as it must be, or a result is older than the last commit to what it measures, as for a
release."""

from __future__ import annotations

import argparse
import fnmatch
import json
import re
import statistics
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from docs.drawings import PICTURES, stamp_of
from testkit.report import ROOT, git

#: Rows and pictures that were measured before results were kept: they stay until their bench has a result.
FORMER = "former"
#: The largest file of a result [bytes].
MAX_BYTES = 200_000
_PLACE = re.compile(r"\{([^{}]+)\}")


class PageError(Exception):
    """A page cannot be made of the results."""


class Row(NamedTuple):
    """A row of a table in docs/figures.yaml."""

    what: str
    results: list[str]
    cells: list[str]
    former: str


class Pages:
    """The pages of a checkout and their results. Raises PageError."""

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        self.results: dict[str, dict[str, Any]] = {
            file.stem: json.loads(file.read_text()) for file in sorted((root / "bench" / "results").glob("*.json"))
        }
        self.former: dict[str, Any] = self.results.pop(FORMER)
        self._tables = yaml.safe_load(Path(__file__).with_name("figures.yaml").read_text())

    # ---- tables ----

    @cached_property
    def texts(self) -> dict[str, str]:
        """The pages, by path, as they must be."""
        found: dict[str, str] = {}
        for table in self._tables:
            page, begin, end = table["page"], f"<!--{table['name']}-->", "<!--end-->"
            text = found.get(page) or (self.root / page).read_text()
            before, is_there, rest = text.partition(begin)
            if not is_there or end not in rest:
                raise PageError(f"{page}: {begin} ... {end} is missing")
            found[page] = "\n".join((before + begin, self._table(table), end + rest.partition(end)[2]))
        return found

    def _table(self, table: Mapping[str, Any]) -> str:
        head = table["head"]
        lines = dict.fromkeys(
            tuple(self._row(row, table)) for row in self._rows(table)
        )  # some have the same former one
        names = list(dict.fromkeys(name for row in self._rows(table) for name in row.results))
        around = [self._filled(table.get(where, ""), names)[0] for where in ("before", "behind")]
        text = "\n".join((_line(head), "|---" * len(head) + "|", *map(_line, lines)))
        return "\n\n".join(part for part in (around[0], text, around[1]) if part)

    def _rows(self, table: Mapping[str, Any]) -> Iterator[Row]:
        for row in table["rows"]:
            what = row["what"]
            yield Row(what, row.get("from", "").split(), row.get("cells", []), row.get("former", what))

    def _row(self, row: Row, table: Mapping[str, Any]) -> list[str]:
        if self._is_former(row):
            try:
                return [row.former, *self.former[table["name"]][row.former]]
            except KeyError:
                missing = [name for name in row.results if name not in self.results]
                raise PageError(f"{table['page']}: {row.what}: there is no result {', '.join(missing)}") from None
        invalid = [self.results[name]["invalid"] for name in row.results if self.results[name]["invalid"]]
        filled = (
            [self._filled(cell, row.results) for cell in row.cells] if not invalid else [(f"invalid: {invalid[0]}", [])]
        )
        line = [row.what, *(text for text, _ in filled)]
        if "limits" in table:
            limits = dict.fromkeys(number(mark["limit"]) for _, marks in filled for mark in marks)
            line.append("; ".join(limits))
        if "at" in table:
            line.append(self._filled(table["at"], row.results)[0])
        return line

    def _is_former(self, row: Row) -> bool:
        return not row.results or not set(row.results) <= set(self.results)

    def _filled(self, template: str, names: list[str]) -> tuple[str, list[dict[str, Any]]]:
        """A template with values, and the marks among them."""
        used: list[dict[str, Any]] = []

        def value(place: re.Match[str]) -> str:
            name, is_named, key = place[1].rpartition(">")
            some = [self.results[each] for each in ([name] if is_named else names) if each in self.results]
            try:
                text, marks = value_of(key, some)
            except (LookupError, ValueError) as error:
                raise PageError(f"{{{place[1]}}} in {', '.join(names)}: {error}") from None
            used.extend(marks)
            return text

        return _PLACE.sub(value, template), used

    # ---- what is wrong ----

    def problems(self) -> Iterator[str]:
        """What is wrong with pages, pictures and results."""
        try:
            changed = [page for page, text in self.texts.items() if (self.root / page).read_text() != text]
            yield from (f"{page}: a table differs from what the results give; run make figures" for page in changed)
        except PageError as error:
            yield str(error)
        for name, result in self.results.items():
            yield from (f"results/{name}.json: {each}" for each in self._problems_of(result))
            if (self.root / "bench" / "results" / f"{name}.json").stat().st_size > MAX_BYTES:
                yield f"results/{name}.json is larger than {MAX_BYTES} bytes"
        for file, picture in PICTURES.items():
            expected = picture.stamp(self.results) or self.former["pictures"].get(file)
            if stamp_of(self.root / file) != expected:
                yield f"{file} differs from what the results give; run make figures"

    def _problems_of(self, result: Mapping[str, Any]) -> Iterator[str]:
        if not re.fullmatch("[0-9a-f]{40}", result["commit"]) or not is_commit(result["commit"]):
            yield f"the commit {result['commit']} is unknown"
        for mark in result["marks"]:
            if not re.match("reached|missed by|invalid|not measured", mark.get("verdict", "")):
                yield f"the mark {mark['what']!r} has no verdict"

    def old(self) -> Iterator[str]:
        """Results that say nothing about the present commit."""
        for name, result in self.results.items():
            since = git("log", "-1", "--format=%h %s", f"{result['commit']}..HEAD", "--", *result["measures"])
            if since:
                yield f"results/{name}.json is older than {since}"
            if result["is dirty"]:
                yield f"results/{name}.json was measured with uncommitted changes"
        for table in self._tables:
            if former := [row.what for row in self._rows(table) if self._is_former(row)]:
                yield f"{table['page']}: {len(former)} rows of {table['name']} have no result yet: {' | '.join(former)}"

    # ---- writing ----

    def write(self) -> None:
        """Make pages and pictures, and drop the former rows and pictures that have a result now."""
        for page, text in self.texts.items():
            (self.root / page).write_text(text)
        for table in self._tables:
            kept = {row.former for row in self._rows(table) if self._is_former(row)}
            rows = self.former.get(table["name"], {})
            self.former[table["name"]] = {what: cells for what, cells in rows.items() if what in kept}
        for file, picture in PICTURES.items():
            if picture.stamp(self.results):
                picture.write(self.results, self.root / file)
                self.former["pictures"].pop(file, None)
        text = json.dumps(self.former, indent=1, ensure_ascii=False) + "\n"
        (self.root / "bench" / "results" / f"{FORMER}.json").write_text(text)


def _line(cells: Iterable[str]) -> str:
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in cells)


def value_of(key: str, results: list[dict[str, Any]]) -> tuple[str, list[dict[str, Any]]]:
    """The text of a placeholder, and the marks that it names. Raises LookupError if there is nothing of this name."""
    key, _, how = key.partition("|")
    column, *cells = key.split("@")
    date, first = results[0]["date"], results[0]
    facts = {"commit": first["commit"][:8], "month": date[5:7], "day": date[8:10]}
    if key in facts:
        return facts[key], []
    marks = [mark for result in results for mark in result["marks"] if fnmatch.fnmatchcase(mark["what"], key)]
    if marks:
        return (number(marks[0]["limit"]) if how == "limit" else worst(marks)), marks
    rows = [row for result in results for row in result["rows"] if all(_has(row, cell) for cell in cells)]
    values = [row[column] for row in rows if row.get(column) is not None]
    if not values:
        raise LookupError("there is no such mark or column")
    numbers = _numbers(values)
    if not numbers:
        return str(values[0]), []
    if how == "span":
        low, high = number(min(numbers)), number(max(numbers))
        return (low if low == high else f"{low} to {high}"), []
    return number({"max": max, "sum": sum, "": statistics.median}[how](numbers)), []


def _has(row: Mapping[str, Any], wanted: str) -> bool:
    """Whether a row has a text in any column, or COLUMN=CELL."""
    column, is_named, cell = wanted.rpartition("=")
    return str(row.get(column)) == cell if is_named else wanted in row.values()


def _numbers(values: Iterable[Any]) -> list[float]:
    """Those of them that were measured; what is infinite is written as "inf"."""
    return [float(each) if each == "inf" else each for each in values if each == "inf" or not isinstance(each, str)]


def worst(marks: list[dict[str, Any]]) -> str:
    """The value of the mark that is nearest to its limit or farthest beyond it, bold if any was missed."""
    values = _numbers(mark["value"] for mark in marks)
    most = max if marks[0]["relation"] == "at most" else min
    text = number(most(values)) if values else str(marks[0]["value"])
    return text if all(mark["verdict"] == "reached" for mark in marks) else f"**{text}**"


def number(value: float) -> str:
    """A number with three digits; a count with all."""
    return f"{value:,}" if isinstance(value, int) else f"{float(f'{value:.3g}'):,.10g}"


def is_commit(commit: str) -> bool:
    """Whether a commit is one of the present history; where that is not there nobody can say, and it counts as one."""
    return git("rev-parse", "--is-shallow-repository") != "false" or git("merge-base", "HEAD", commit) == commit


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="report what is wrong or old instead")
    pages = Pages()
    if not parser.parse_args().check:
        pages.write()
        return 0
    found = [*pages.problems(), *pages.old()]
    print(*found, sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

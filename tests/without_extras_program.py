"""What runs where packages are not installed: reads their names, modules to import, command lines, and further cases of
names and modules as JSON from the standard input; prints what fails: modules with what is missing, exit code and output
of the command lines, and modules of each case, which has what the first modules have imported."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import sys
from collections.abc import Iterable
from importlib import metadata
from importlib.machinery import ModuleSpec
from typing import Any

missing, modules, lines, cases = json.load(sys.stdin)
found_by_name = metadata.Distribution.from_name
owners_of = metadata.packages_distributions()
absent, tops = set[str](), set[str]()


class Missing:
    """Comes before the finders of Python, and finds none of the packages."""

    def find_spec(self, name: str, *_: Any) -> ModuleSpec | None:
        if name.partition(".")[0] in tops:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def from_name(name: str) -> metadata.Distribution:
    if name in absent:
        raise metadata.PackageNotFoundError(name)
    return found_by_name(name)


def failures(missing: Iterable[str], modules: Iterable[str]) -> dict[str, str]:
    """The modules that can't be imported without these packages, each with what it lacks."""
    absent.clear()
    absent.update(missing)
    tops.clear()
    tops.update(top for top, owners in owners_of.items() if set(owners) <= absent)
    found = {}
    for module in modules:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            found[module] = str(error.name).partition(".")[0]
    return found


sys.meta_path.insert(0, Missing())  # type: ignore[arg-type]
metadata.Distribution.from_name = from_name  # type: ignore[assignment, method-assign]
failed = failures(missing, modules)

from typer.testing import CliRunner  # noqa: E402

from robocorba.commands import command  # noqa: E402

ran = [CliRunner().invoke(command(), line) for line in lines]
outputs = [(result.exit_code, result.output, repr(result.exception)) for result in ran]
with multiprocessing.get_context("fork").Pool(1, maxtasksperchild=1) as pool:
    of_cases = pool.starmap(failures, cases, chunksize=1)
json.dump([sorted(tops), failed, outputs, of_cases], sys.stdout)

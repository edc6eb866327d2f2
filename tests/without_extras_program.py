"""What runs where packages are not installed: reads their names, modules to import and command lines as JSON from the
standard input; prints what fails: modules with what is missing, and exit code and output of the command lines."""

from __future__ import annotations

import importlib
import json
import sys
from importlib import metadata
from importlib.machinery import ModuleSpec
from typing import Any

missing, modules, lines = json.load(sys.stdin)
found_by_name = metadata.Distribution.from_name
tops = {top for top, owners in metadata.packages_distributions().items() if set(owners) <= set(missing)}


class Missing:
    """Comes before the finders of Python, and finds none of the packages."""

    def find_spec(self, name: str, *_: Any) -> ModuleSpec | None:
        if name.partition(".")[0] in tops:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def from_name(name: str) -> metadata.Distribution:
    if name in missing:
        raise metadata.PackageNotFoundError(name)
    return found_by_name(name)


sys.meta_path.insert(0, Missing())  # type: ignore[arg-type]
metadata.Distribution.from_name = from_name  # type: ignore[assignment, method-assign]
failures = {}
for module in modules:
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        failures[module] = str(error.name).partition(".")[0]

from typer.testing import CliRunner  # noqa: E402

from robocorba.commands import command  # noqa: E402

ran = [CliRunner().invoke(command(), line) for line in lines]
outputs = [(result.exit_code, result.output, repr(result.exception)) for result in ran]
json.dump([sorted(tops), failures, outputs], sys.stdout)

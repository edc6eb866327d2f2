"""The reference of the Python API says something of everything that is in it."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import runpy
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

#: The modules of the reference.
MODULES = runpy.run_path(str(Path(__file__).resolve().parents[2] / "docs" / "make_api.py"))["MODULES"]


def modules() -> Iterator[ModuleType]:
    """Those of the reference, with their sub-modules."""
    for name in MODULES:
        module = importlib.import_module(name)
        yield module
        for found in pkgutil.walk_packages(getattr(module, "__path__", []), f"{name}."):
            yield importlib.import_module(found.name)


@pytest.mark.parametrize("module", list(modules()), ids=lambda module: module.__name__)
def test_what_is_public_has_a_docstring(module: ModuleType) -> None:
    assert module.__doc__
    own = [
        (name, value)
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", None) == module.__name__
    ]
    silent = [
        name for name, value in own if (inspect.isclass(value) or inspect.isfunction(value)) and not value.__doc__
    ]
    assert not silent, f"{module.__name__}: {', '.join(silent)}"

"""Which edits change a kernel's digest."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocorba.kernel_digests import kernel_sources, sources_digest

GRIDS = '''"""Grids."""
from typing import NamedTuple

import numpy as np

from house.kernels import kernel
from house.units import METRE

#: Width.
WIDTH = 3 * METRE
LOW, HIGH = 1, 2
SPARE = 7


class Grid(NamedTuple):
    first: int


@kernel
def column(grid: Grid, x: float) -> int:
    """The column."""
    return int(x / WIDTH) + grid.first


@kernel
def other(x):
    return np.floor(x)


def plain():
    return SPARE
'''
SEARCH = """from __future__ import annotations

from house import units
from house.grids import column as column_of
from house.kernels import kernel


@kernel
def search(grid, x):
    return column_of(grid, x)


@kernel
def alone(x):
    return x


def helper():
    return units.METRE
"""
FILES = {
    "__init__.py": "",
    "kernels.py": "def kernel(function):\n    return function\n",
    "units.py": "METRE = 1.0\nINCH = 0.0254\n",
    "grids.py": GRIDS,
    "search.py": SEARCH,
}
KERNELS = {"grids.column", "grids.other", "search.search", "search.alone"}


def digests(folder: Path, environment: str = "", **changed: str) -> dict[str, str]:
    """Digest of each kernel of the package `house` without its name, with other contents of some modules."""
    root = folder / "house"
    root.mkdir(exist_ok=True)
    for name, text in (FILES | {f"{module}.py": text for module, text in changed.items()}).items():
        (root / name).write_text(text)
    return {name.removeprefix("house."): source.digest for name, source in kernel_sources(root, environment).items()}


@pytest.mark.parametrize(
    ("module", "old", "new", "changed"),
    [
        ("grids", "int(x / WIDTH)", "int(x // WIDTH)", {"grids.column", "search.search"}),
        ("grids", "3 * METRE", "4 * METRE", {"grids.column", "search.search"}),
        ("units", "METRE = 1.0", "METRE = 2.0", {"grids.column", "search.search"}),
        ("grids", "first: int", "first: float", {"grids.column", "search.search"}),
        ("grids", "class Grid(NamedTuple)", "class Grid(NamedTuple, Generic)", {"grids.column", "search.search"}),
        ("grids", "import numpy as np", "import jax.numpy as np", {"grids.other"}),
        ("grids", "SPARE = 7", "SPARE = 7\nif SPARE:\n    WIDTH = 9", {"grids.column", "grids.other", "search.search"}),
        ("grids", "LOW, HIGH = 1, 2", "LOW, WIDTH = 1, 2", {"grids.column", "search.search"}),
        ("search", "from house.grids import column as", "from house.grids import other as", {"search.search"}),
        ("search", "return x\n", "return units.METRE\n", {"search.alone"}),
        ("search", "@kernel\ndef alone(x):\n    return x", "@kernel\ndef alone(y):\n    return y", {"search.alone"}),
        # What kernels are not compiled from:
        ("grids", "SPARE = 7", "SPARE = 8", set()),
        ("grids", "return SPARE", "return -SPARE", set()),
        ("grids", "#: Width.", "#: Width, with a comment\n# of two lines.", set()),
        ("grids", '"""The column."""', '"""The column of a point."""', set()),
        ("grids", "LOW, HIGH = 1, 2", "LOW, HIGH = 1, 3", set()),
        ("units", "INCH = 0.0254", "INCH = 1 / 39.37", set()),
        ("kernels", "return function", "return print or function", set()),
        ("search", "units.METRE", "units.INCH", set()),
    ],
)
def test_an_edit_changes_what_is_compiled_from_it(
    tmp_path: Path, module: str, old: str, new: str, changed: set[str]
) -> None:
    before = digests(tmp_path)
    assert before.keys() == KERNELS
    assert len(set(before.values())) == len(KERNELS)
    text = FILES[f"{module}.py"]
    assert text.count(old) == 1
    after = digests(tmp_path, **{module: text.replace(old, new)})
    assert {name for name in KERNELS if before[name] != after[name]} == changed


def test_the_compiler_counts_and_the_folder_does_not(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    first, second = digests(tmp_path / "a"), digests(tmp_path / "b")
    assert first == second
    assert sources_digest(tmp_path / "a" / "house") == sources_digest(tmp_path / "b" / "house")
    assert not set(first.values()) & set(digests(tmp_path / "a", "numba 1.0").values())


def test_a_whole_module_counts_where_it_is_unclear_what_is_used(tmp_path: Path) -> None:
    whole = SEARCH.replace("return x\n", "return units.METRE\n")
    before = digests(tmp_path, search=whole)
    after = digests(tmp_path, search=whole, units=FILES["units.py"].replace("0.0254", "0.03"))
    assert before["search.alone"] != after["search.alone"]
    star = SEARCH.replace("from house import units", "from .units import *").replace("return x\n", "return METRE\n")
    before = digests(tmp_path, search=star)
    after = digests(tmp_path, search=star, units=FILES["units.py"].replace("1.0", "2.0"))
    assert before["search.alone"] != after["search.alone"]


def test_any_edit_changes_the_digest_of_all_sources(tmp_path: Path) -> None:
    digests(tmp_path)
    before = sources_digest(tmp_path / "house")
    digests(tmp_path, units=FILES["units.py"] + "# nothing\n")
    assert sources_digest(tmp_path / "house") != before
